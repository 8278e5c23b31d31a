"""The studies: replayed poses, sweeps, what is read off a run and off a force curve."""

from __future__ import annotations

import csv
import io
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks import observed_run
from benchmarks.builtin_scenarios import benchmark_scenario, is_supported, with_blocks
from benchmarks.observed_run import ObservedRun, observe
from benchmarks.studies.forces import Curve, push_hold_pull, read_off
from benchmarks.studies.replayed_poses import replay_block, slerp
from benchmarks.studies.sweeps import Sweep, _replay, _rows, at_times, sweeps
from benchmarks.studies.sweeps_report import MEASURES, study_part
from simcore.rotations import exp_map, quaternion_from_matrix
from simcore.scenario.presets import preset
from simcore.scenario.scenario import Replay, Scenario

if TYPE_CHECKING:
    from pathlib import Path

Vector = NDArray[np.float64]


# ---- scenarios


@pytest.mark.parametrize("name", ["line", "sine"])
def test_what_is_measured_is_the_built_in_scenario(name: str) -> None:
    assert benchmark_scenario(name, quick=False) == preset(name)
    quick = benchmark_scenario(name, quick=True)
    assert quick.steps < 0.11 * preset(name).steps
    assert (quick.interaction.spacing_mm, quick.tissue.element_size_mm) == (3.0, 10.0)


def test_changes_keep_the_rest_and_let_the_spacing_follow_the_mesh() -> None:
    base = preset("sine")
    coarse = with_blocks(base, tissue={"element_size_mm": 9.0}, dt_s=0.02)
    assert (coarse.interaction.spacing_mm, coarse.dt_s, coarse.trajectory) == (3.0, 0.02, base.trajectory)
    hard = with_blocks(base, interaction={"line_compliance": False, "spacing_mm": None})
    assert with_blocks(hard, tissue={"element_size_mm": 9.0}).interaction.spacing_mm == 9.0
    assert with_blocks(base, controller={"kind": "open_loop"}).controller.kind == "open_loop"
    assert is_supported("controller.gain=0.5")
    assert not is_supported("controller.no_such_field=1")
    assert not is_supported("controller.gain=wrong")


# ---- poses


def turning(steps: int, rate: float) -> dict[str, Vector]:
    """A base that moves along z and turns about a skew axis, both at constant speed."""
    i = np.arange(steps + 1)
    axis = np.array([1.0, 2.0, -1.0]) / np.sqrt(6.0)
    turned = np.array([quaternion_from_matrix(exp_map(rate * k * axis)) for k in i])
    return {"base_position_m": np.column_stack([0 * i, 0 * i, 1e-3 * i]), "base_rotation": turned}


def test_poses_at_the_same_step_are_those_of_the_run() -> None:
    series = turning(5, 0.1)
    poses = np.array(replay_block(series, dt_s=0.01, new_dt_s=0.01)["poses"])
    np.testing.assert_array_equal(poses[:, :3], 1e3 * series["base_position_m"][1:])
    np.testing.assert_array_equal(poses[:, 3:], series["base_rotation"][1:])


@pytest.mark.parametrize("new_dt", [0.005, 0.002, 0.0012, 0.007, 0.02])
def test_resampled_poses_lie_on_a_motion_of_constant_speed(new_dt: float) -> None:
    poses = np.array(replay_block(turning(12, 0.1), dt_s=0.01, new_dt_s=new_dt)["poses"])
    at = np.minimum(np.arange(1, len(poses) + 1) * new_dt / 0.01, 12.0)
    assert at[-1] == 12.0
    assert at[-2] < 12.0
    np.testing.assert_allclose(poses[:, 2], at, atol=1e-12)
    axis = np.array([1.0, 2.0, -1.0]) / np.sqrt(6.0)
    expected = np.array([quaternion_from_matrix(exp_map(0.1 * a * axis)) for a in at])
    np.testing.assert_allclose(np.abs((poses[:, 3:] * expected).sum(axis=1)), 1.0, atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(poses[:, 3:], axis=1), 1.0, atol=1e-15)


def test_slerp_takes_the_shorter_way_and_bears_equal_rotations() -> None:
    a = np.array([[1.0, 0.0, 0.0, 0.0]] * 2)
    b = -np.array([[np.cos(0.1), np.sin(0.1), 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]])
    half = slerp(a, b, np.array([0.5, 0.3]))
    np.testing.assert_allclose(half, [[np.cos(0.05), np.sin(0.05), 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]], atol=1e-15)


# ---- runs


@pytest.fixture(scope="module")
def tiny() -> Scenario:
    changes = ("trajectory.target_mm=[19,32,3]", "recording.enabled=false", "tissue.element_size_mm=15")
    return benchmark_scenario("line", quick=True, changes=("interaction.spacing_mm=15", *changes))


@pytest.mark.slow
def test_a_job_leaves_what_an_observed_run_has(tiny: Scenario, tmp_path: Path) -> None:
    here = observe(tiny)
    result = observed_run.job({"scenario": tiny.resolved()}, tmp_path)
    there = observed_run.load(tmp_path, result)
    assert here.status == there.status == "completed"
    assert here.metrics == there.metrics
    assert set(here.series) == set(there.series)
    for name in ("tip_m", "entry_force_n", "lateral_sum_n"):
        np.testing.assert_array_equal(here.series[name], there.series[name])
    entry = here.series["entry_force_n"]
    assert len(entry) == tiny.steps + 1
    assert entry[0] == 0.0
    assert (entry <= here.series["lateral_sum_n"] * (1 + 1e-12)).all()
    assert entry.max() > 0.0


@pytest.mark.slow
def test_a_replay_of_a_run_is_that_run(tiny: Scenario) -> None:
    led = observe(tiny)
    again = observe(_replay(tiny, led, {}, "again"))
    np.testing.assert_allclose(again.series["tip_m"], led.series["tip_m"], atol=1e-8)
    finer = _replay(tiny, led, {"dt_s": 0.005}, "finer")
    assert isinstance(finer.controller, Replay)
    assert finer.steps == 2 * tiny.steps


# ---- sweeps


@pytest.mark.parametrize("quick", [False, True])
def test_every_sweep_has_one_default_one_reference_and_valid_scenarios(quick: bool) -> None:
    base = benchmark_scenario("sine", quick=quick)
    found = sweeps(quick=quick)
    assert len({sweep.name for sweep in found}) == len(found)
    for sweep in found:
        labels = [label for label, _, _ in sweep.values]
        assert len(set(labels)) == len(labels)
        assert {sweep.default, sweep.reference} <= set(labels)
        variants = {label: with_blocks(base, **changes) for label, _, changes in sweep.values}
        assert variants[sweep.default] == base


def test_the_full_study_covers_what_was_asked_for() -> None:
    places = {sweep.name: [place for _, place, _ in sweep.values] for sweep in sweeps(quick=False)}
    assert places["mesh"] == [10.0, 8.0, 6.0, 5.0, 4.0]
    assert places["dt"] == pytest.approx([10.0, 5.0, 2.0, 1.2])
    assert (min(places["spacing"]), max(places["spacing"])) == (1.0, 12.0)
    assert max(places["tolerance"]) / min(places["tolerance"]) == pytest.approx(1e4)


def made_run(tip_offset_mm: float, dt: float, *, steps: int = 100) -> ObservedRun:
    """A tip that moves along z at 10 mm/s, beside its path by an offset; forces that grow with time."""
    t = dt * np.arange(steps + 1)
    series = {
        "t_s": t,
        "tip_m": np.column_stack([np.full_like(t, 1e-3 * tip_offset_mm), 0 * t, 0.01 * t]),
        "entry_force_n": 0.1 * t,
        "insertion_force_n": 0.2 * t + tip_offset_mm,
        "lateral_sum_n": 0.3 * t,
    }
    metrics = {
        "steps_completed": steps,
        "steps": steps,
        "rmse_commanded_mm": 0.5,
        "lambda_ratio": None,
        "min_det_f": 0.9,
    }
    return ObservedRun("completed", "", metrics, {"iterations_mean": 2.0}, series)


def test_rows_and_files_of_a_made_up_study() -> None:
    values: tuple[tuple[str, float, dict[str, Any]], ...] = (("a", 1.0, {}), ("b", 2.0, {}), ("c", 4.0, {}))
    sweep = Sweep("mesh", "h, mm", values, "b", "c")
    runs = {("mesh", "a"): made_run(0.3, 0.02), ("mesh", "b"): made_run(0.1, 0.01), ("mesh", "c"): made_run(0.0, 0.01)}
    rows = _rows(sweep, runs, 10.0)
    assert [row.tip_max_mm for row in rows] == pytest.approx([0.3, 0.1, 0.0])
    assert [row.push_apart_n for row in rows] == pytest.approx([0.3, 0.1, 0.0])
    assert [row.entry_max_n for row in rows] == pytest.approx([0.1, 0.1, 0.1])
    part = study_part(preset("sine"), runs["mesh", "b"], [("mesh", "h, mm", False, False)], rows, {"1": made_run(0, 1)})
    assert part.figures[0].key == "sweeps.mesh.tip_mm"
    assert part.figures[0].median == pytest.approx(0.1)
    records = list(csv.DictReader(io.StringIO(part.files["sweeps.csv"])))
    assert [record["variant"] for record in records] == ["a", "b", "c"]
    assert "b (default)" in part.files["sweeps.md"]
    for name in ("sweeps.svg", "sweeps_depth.svg"):
        ElementTree.fromstring(part.files[name])
    assert {name for name, _, _ in MEASURES} <= set(records[0])


def test_series_between_steps_are_linear() -> None:
    run = made_run(0.0, 0.1)
    np.testing.assert_allclose(at_times(run, "tip_m", np.array([0.05]))[0], [0.0, 0.0, 5e-4], atol=1e-15)
    assert at_times(run, "entry_force_n", np.array([0.25]))[0] == pytest.approx(0.025)


# ---- the force curve


def test_a_made_up_curve_is_read_off() -> None:
    """Indentation of 2 mm to 0.4 N, then 0.1 N + 0.02 N/mm, a hold, elastic return over 3 mm, -0.02 N/mm, nothing."""
    travel = np.concatenate([np.arange(0, 50.01, 0.1), np.full(10, 50.0), np.arange(49.9, -5.01, -0.1)])
    held, pulled = 501, 511
    depth, force = np.zeros_like(travel), np.zeros_like(travel)
    for i, s in enumerate(travel):
        if i < held:
            depth[i] = s if s > 2.0 + 1e-9 else 0.0
            force[i] = 0.1 + 0.02 * s if depth[i] else 0.2 * s
        elif i < pulled:
            depth[i], force[i] = 50.0, 1.1
        else:
            depth[i] = max(0.0, min(50.0, s + 1.5))
            force[i] = max(-0.02 * depth[i], 1.1 - 2.1 / 3.0 * (50.0 - s))
    shape = read_off(Curve(np.linspace(0.0, 10.0, len(travel)), travel, depth, force, held, pulled))
    assert shape.puncture_n == pytest.approx(0.4)
    assert shape.puncture_travel_mm == pytest.approx(2.0)
    assert shape.cutting_n == pytest.approx(0.1)
    assert shape.push_slope == pytest.approx(0.02)
    assert shape.pull_slope == pytest.approx(-0.02)
    assert shape.after_hold_n == pytest.approx(1.1)
    assert shape.reversal_mm == pytest.approx(1.6, abs=0.051)
    assert shape.work_j > 0.0


def test_the_base_pushes_holds_and_pulls() -> None:
    scenario = push_hold_pull(preset("replay"), 10.0, edge_mm=10.0)
    assert isinstance(scenario.controller, Replay)
    z = np.array(scenario.controller.poses)[:, 2] + 180.0
    assert scenario.steps == 100 + 100 + 150
    assert scenario.interaction.puncture_n == 0.1
    assert (z[0], z[99], z[199], z[-1]) == pytest.approx((0.1, 10.0, 10.0, -5.0))
    assert np.abs(np.diff(z)).max() == pytest.approx(0.1)
