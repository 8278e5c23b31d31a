"""What a job will cost, and what is refused for it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from service.admission.cost import Cost, check_cost, cost_of, time_limit_s
from service.admission.cost import _size_of as size_of
from service.settings import Limits
from simcore.errors import ScenarioError
from simcore.scenario.build import tissue_model
from simcore.scenario.presets import preset
from simcore.scenario.scenario import Scenario
from tests.service.http import idle_service
from tests.simcore.mesh.test_mesh_file import write_box

if TYPE_CHECKING:
    from pathlib import Path

JOBS = "/api/v1/jobs"


@pytest.mark.parametrize(
    "tissue",
    [
        {},
        {"element_size_mm": 10},
        {"element_size_mm": 5, "fixed_faces": ["x_min", "z_max"]},
        {"size_mm": [60, 30, 40], "element_size_mm": 7, "fixed_faces": ["x_min", "x_max"]},
    ],
)
def test_the_size_of_a_block_is_that_of_the_model_that_is_made(tissue: dict[str, Any]) -> None:
    target = {"entry_mm": [15, 15, 0], "target_mm": [15, 15, 30]}
    block = Scenario.load({"tissue": tissue, "trajectory": target, "interaction": {"spacing_mm": 12}}).tissue
    model, size = tissue_model(block), size_of(block)
    assert size.nodes == len(model.mesh.nodes_m)
    assert size.unknowns == model.unknowns
    assert model.band <= size.band <= 1.05 * model.band + 12


@pytest.mark.slow
def test_the_size_of_a_file_is_that_of_the_model_that_is_made(tmp_path: Path) -> None:
    path, _ = write_box(tmp_path, "box.vtk")
    tissue = {"mesh_file": str(path), "fixed_faces": ["y_min", "y_max"]}
    trajectory = {"entry_mm": [10, 20, 0], "target_mm": [10, 20, 30]}
    block = Scenario.load(
        {"tissue": tissue, "trajectory": trajectory, "interaction": {"spacing_mm": 11}, "needle": {"length_mm": 90}}
    ).tissue
    model, size = tissue_model(block), size_of(block)
    assert (size.nodes, size.unknowns, size.band) == (len(model.mesh.nodes_m), model.unknowns, model.band)


def test_finer_exact_and_separate_cost_more() -> None:
    def step_ms(**changes: Any) -> float:
        return cost_of(Scenario.load({"trajectory": {"target_mm": [18, 31, 30]}, **changes})).step_ms

    plain = step_ms()
    assert step_ms(controller={"kind": "open_loop"}) == plain
    assert step_ms(tissue={"element_size_mm": 4}) > 3 * plain
    assert step_ms(controller={"derivative": "exact"}) > 5 * plain
    assert step_ms(controller={"jacobian": "perturbation"}) > 5 * plain
    assert step_ms(controller={"model": {"kind": "separate"}}) == pytest.approx(2 * plain)


def test_a_long_recording_and_a_fine_mesh_need_memory() -> None:
    def memory_mb(**changes: Any) -> float:
        return cost_of(Scenario.load({"trajectory": {"target_mm": [18, 31, 122]}, **changes})).memory_mb

    plain = memory_mb()
    assert memory_mb(tissue={"element_size_mm": 2}) > plain + 2000
    assert memory_mb(dt_s=1e-4) > memory_mb(dt_s=1e-4, recording={"enabled": False}) + 100


DEMO = preset("demo").resolved()
FINE = {"tissue": {"element_size_mm": 3}, "trajectory": {"target_mm": [18, 31, 100]}}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scenario", "limits", "field", "told"),
    [
        (DEMO, Limits(nodes=1000), "tissue.element_size_mm", "gives 1617 nodes, at most 1000 are allowed here"),
        (DEMO, Limits(steps=100), "dt_s", "at most 100 are allowed here"),
        (DEMO, Limits(job_hours=0.001), "dt_s", "hours, at most 0.001 are allowed here"),
        (FINE, Limits(job_memory_mb=750), "tissue.element_size_mm", "MB, at most 750 are allowed here"),
    ],
    ids=["nodes", "steps", "time", "memory"],
)
def test_a_job_beyond_a_limit_is_refused_with_its_estimate(
    tmp_path: Path, scenario: dict[str, Any], limits: Limits, field: str, told: str
) -> None:
    with pytest.raises(ScenarioError) as caught:
        check_cost(Scenario.load(scenario), limits)
    (problem,) = caught.value.problems
    assert (problem.field, told in problem.message) == (field, True), problem.message
    estimate = f"({cost_of(Scenario.load(scenario))})"
    assert estimate in problem.message
    with idle_service(tmp_path, limits=limits) as (http, _):
        answer = http.post(JOBS, json={"scenario": scenario})
    assert (answer.status_code, answer.json()["errors"][0]["field"]) == (422, field)
    assert estimate in answer.json()["detail"]


LONG = {"dt_s": 1e-3, "controller": {"derivative": "exact"}, "trajectory": {"target_mm": [18, 31, 122]}}


@pytest.mark.slow
def test_a_long_job_may_take_four_times_its_estimate_and_a_short_one_an_hour(tmp_path: Path) -> None:
    cost = cost_of(Scenario.load({**LONG, "dt_s": 1e-4}))
    assert 3600 < 4 * cost.time_s < 86400
    with idle_service(tmp_path) as (http, _):
        for scenario, asked, given in (
            ({**LONG, "dt_s": 1e-4}, {}, 4 * cost.time_s),
            ({**LONG, "dt_s": 1e-4}, {"timeout_s": None}, 4 * cost.time_s),
            ({**LONG, "dt_s": 1e-4}, {"timeout_s": 60.0}, 60.0),
            ("demo", {}, 3600.0),
        ):
            answer = http.post(JOBS, json={"scenario": scenario, **asked})
            assert (answer.status_code, answer.json()["timeout_s"]) == (202, pytest.approx(given))
        grid = {"scenario": LONG, "grid": {"dt_s": [0.01, 1e-4]}}
        made = http.post("/api/v1/campaigns", json=grid)
        assert (made.status_code, made.json()["timeout_s"]) == (202, pytest.approx(4 * cost.time_s))


def test_an_estimate_in_words() -> None:
    cost = Cost(steps=1_000, nodes=1_617, step_ms=36.0, memory_mb=512.4)
    assert str(cost) == "estimate: 1617 nodes, 1000 steps of 36 ms, 0.01 h, 512 MB"


def test_no_time_limit_is_longer_than_a_day() -> None:
    cost = Cost(steps=10**6, nodes=1000, step_ms=80.0, memory_mb=100.0)
    assert time_limit_s(None, cost) == 86400.0


def test_the_built_in_scenarios_are_within_the_limits() -> None:
    for name in ("demo", "line", "sine", "replay"):
        check_cost(preset(name), Limits())
