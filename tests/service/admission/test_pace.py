"""What a service says a job will take, from the insertions that it ran."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from service.admission.cost import cost_of
from service.admission.pace import LATEST, PaceMeter, pace_of
from simcore.scenario.scenario import Scenario
from tests.service.http import idle_service

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from starlette.testclient import TestClient

    from service.api.context import Service


@pytest.fixture
def both(tmp_path: Path) -> Iterator[tuple[TestClient, Service]]:
    with idle_service(tmp_path) as pair:
        yield pair


def test_a_band_holds_most_of_what_was_measured_and_is_never_narrow() -> None:
    ratios = [0.5, 1.0, 1.0, 1.1, 1.2, 1.2, 1.3, 1.4, 1.5, 9.0]
    pace = pace_of(ratios)
    assert (pace.middle, pace.insertions) == (1.2, 10)
    assert sum(pace.low <= ratio <= pace.high for ratio in ratios) == 8
    alike = pace_of([2.0] * 5)
    assert alike.low < 2.0 == alike.middle < alike.high
    assert alike.seconds(10.0) == (16.0, 20.0, 25.0)
    nothing = pace_of([])
    assert (nothing.middle, nothing.insertions) == (1.0, 0)
    assert nothing.low < 0.5 < 2.0 < nothing.high


class Finished:
    """A store of insertions that took `factor` times their estimate."""

    def __init__(self, scenarios: list[dict[str, Any]], factor: float) -> None:
        self.scenarios, self.factor, self.read = scenarios, factor, 0

    def latest_finished(self, limit: int) -> list[tuple[str, float]]:
        assert limit == LATEST
        times = [cost_of(Scenario.load(one)).time_s if "mesh_file" not in str(one) else 1.0 for one in self.scenarios]
        return [(str(i), self.factor * time_s) for i, time_s in enumerate(times)]

    def get(self, job_id: str) -> Any:
        self.read += 1
        return type("Job", (), {"spec": {"scenario": self.scenarios[int(job_id)]}})


def test_the_pace_carries_over_to_other_meshes_and_paths_and_each_job_is_read_once() -> None:
    fine: dict[str, Any] = {"tissue": {"element_size_mm": 4}, "dt_s": 0.01}
    store: Any = Finished([{}, fine, {"tissue": {"element_size_mm": 12}, "controller": {"kind": "elm"}}], 3.0)
    meter = PaceMeter(store)
    assert meter.pace().middle == pytest.approx(3.0)
    assert meter.pace().insertions == 3
    assert store.read == 3
    coarse = cost_of(Scenario.load({"tissue": {"element_size_mm": 15}}))
    assert cost_of(Scenario.load(fine)).time_s > 5 * coarse.time_s


def test_insertions_in_meshes_from_files_are_passed_over() -> None:
    store: Any = Finished([{"tissue": {"mesh_file": "artefact:" + "0" * 64 + ".vtk"}}, {}], 2.0)
    assert PaceMeter(store).pace().insertions == 1


@pytest.mark.slow
def test_a_dry_run_says_what_a_job_would_take_and_queues_nothing(both: tuple[TestClient, Service]) -> None:
    http, service = both
    told = http.post("/api/v1/jobs", params={"dry_run": 1}, json={"scenario": "line"})
    assert told.status_code == 200
    body = told.json()
    assert (body["name"], body["steps"], body["nodes"], body["measured_on"]) == ("line", 1226, 1617, 0)
    assert 0.0 < body["seconds_low"] < body["seconds"] < body["seconds_high"]
    assert service.store.page().items == []
    wrong = http.post("/api/v1/jobs", params={"dry_run": 1}, json={"scenario": {"tissue": {"young_kpa": -1}}})
    assert wrong.status_code == 422
    assert wrong.json()["errors"][0]["field"] == "tissue.young_kpa"
    two = {"grid": {"controller.kind": ["ifem", "elm"]}}
    plan = http.post("/api/v1/campaigns", params={"dry_run": 1}, json=two).json()
    assert plan["seconds_low"] < plan["seconds"] < plan["seconds_high"]
    assert plan["seconds"] == pytest.approx(2 * body["seconds"] / service.settings.workers, rel=0.5)
