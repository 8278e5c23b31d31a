"""A run that is watched, stopped by its observer, or failing by name is that of an undisturbed one."""

from __future__ import annotations

import json
from dataclasses import fields

import numpy as np
import pytest

from simcore.errors import ScenarioError, Status
from simcore.rollout.records import StepRecord
from simcore.rollout.result import FRAMES, TIMES, Rollout
from simcore.rollout.rollout import run
from tests.simcore.rollout.watcher import MAY_BE_NAN, Watcher, state_of
from tests.simcore.short_run import LINE, STEPS, replay, short


@pytest.mark.parametrize("hold_s", [0.01, 0.25])
def test_a_hold_that_is_no_multiple_of_the_step_is_refused(hold_s: float) -> None:
    with pytest.raises(ScenarioError, match=rf"noise_hold_s = {hold_s}: must be a multiple of dt_s = 0.1 s"):
        short(noise_hold_s=hold_s)


# ---- the observer


@pytest.mark.slow
def test_the_observer_sees_the_rows_of_the_series(plain: Rollout) -> None:
    watcher = Watcher()
    found = run(short(), watcher)
    assert watcher.calls == ["begin", *["step"] * STEPS, "end"]
    assert watcher.rollout is found
    assert [record.step for record in watcher.records] == list(range(STEPS + 1))
    for field in fields(StepRecord):
        if field.name in found.series and field.name not in (*TIMES, *FRAMES):
            seen = np.array([getattr(record, field.name) for record in watcher.records])
            np.testing.assert_array_equal(seen, found.series[field.name], err_msg=field.name)
    frames = [record.step for record in watcher.records if record.tissue_m is not None]
    assert frames == list(found.series["tissue_frame_step"]) == [0, 10, 20, 30, 40, 41]


def test_the_observer_sees_the_scene_first() -> None:
    watcher = Watcher()
    found = run(short(), watcher)
    scene = watcher.scene
    assert scene is not None
    assert scene.scenario == short()
    assert scene.steps == STEPS
    np.testing.assert_array_equal(scene.tissue_rest_m, found.series["tissue_rest_m"])
    np.testing.assert_array_equal(scene.tissue_tets, found.series["tissue_tets"])
    np.testing.assert_allclose(scene.entry_m, [0.012, 0.02, 0.0])
    np.testing.assert_allclose(scene.path_m[[0, -1]], [[0.012, 0.02, 0.0], [0.012, 0.022, 0.04]], atol=1e-12)
    assert scene.needle_radius_m == pytest.approx(0.635e-3)


def test_records_own_their_arrays() -> None:
    watcher = Watcher()
    run(short(), watcher)
    tips = np.array([record.tip_m for record in watcher.records])
    shafts = np.array([record.shaft_m for record in watcher.records])
    np.testing.assert_array_equal(shafts[:, -1], tips)
    np.testing.assert_allclose(shafts[:, 0], [record.base_position_m for record in watcher.records], atol=1e-15)
    assert all(record.points_m.shape == record.point_forces_n.shape for record in watcher.records)
    assert watcher.records[0].points_m.shape[0] <= 1
    assert watcher.records[-1].points_m.shape[0] >= 3


class StoppedError(Exception):
    """What a cancelling observer raises."""


@pytest.mark.slow
@pytest.mark.parametrize("step", [1, 17, STEPS])
@pytest.mark.parametrize("error", [StoppedError(), KeyboardInterrupt(), SystemExit(3)])
def test_an_observer_that_raises_stops_the_run(plain: Rollout, step: int, error: BaseException) -> None:
    watcher = Watcher(stop_at=step, error=error)
    with pytest.raises(type(error)):
        run(short(), watcher)
    assert watcher.calls == ["begin", *["step"] * step]
    np.testing.assert_array_equal(watcher.records[-1].tip_m, plain.series["tip_m"][step])


@pytest.mark.slow
def test_a_run_after_a_stopped_one_is_the_same(plain: Rollout) -> None:
    with pytest.raises(StoppedError):
        run(short(), Watcher(stop_at=20, error=StoppedError()))
    assert run(short()).digest == plain.digest


@pytest.mark.slow
def test_the_observers_time_is_recording_time() -> None:
    now = [0.0]

    class Slow(Watcher):
        def step(self, record: StepRecord) -> None:
            now[0] += 0.25

    found = run(short(), Slow(), clock=lambda: now[0])
    assert found.timing["recording"]["median_ms"] == found.timing["recording"]["max_ms"] == pytest.approx(250.0)
    assert found.timing["plant"]["max_ms"] == found.timing["command"]["max_ms"] == 0.0
    assert found.timing["loop_wall_s"] == pytest.approx(0.25 * STEPS)
    assert found.timing["realtime_factor"] == pytest.approx(0.1 / 0.25)


# ---- failures have names and keep the last good state


def test_a_step_that_does_not_converge_ends_the_run_by_name() -> None:
    watcher = Watcher()
    found = run(short(solver={"max_iterations": 1}), watcher)
    done = len(found.series["t_s"]) - 1
    assert found.status is Status.NOT_CONVERGED
    assert done < STEPS
    assert f"step {done + 1} of {STEPS}, depth" in found.message
    assert (found.metrics["stable"], found.metrics["success"]) == (False, False)
    assert watcher.calls == ["begin", *["step"] * done, "end"]
    assert found.series["tissue_frame_step"][-1] == done
    assert all(np.isfinite(array).all() for name, array in found.series.items() if name not in MAY_BE_NAN)
    assert found.series["residual_n"].max() <= 1e-5
    json.dumps(found.result(), allow_nan=False)


def test_the_last_good_row_is_that_of_an_undisturbed_run() -> None:
    """Sane poses, then one that no needle survives: the rows before are those of the sane poses alone."""
    sane = [[12.0, 20.0, -80.0 + 0.5 * (i + 1), 1.0, 0.0, 0.0, 0.0] for i in range(6)]
    broken = [*sane, [5000.0, 20.0, -80.0, 1.0, 0.0, 0.0, 0.0], *sane]
    with np.errstate(over="ignore", invalid="ignore"):
        bad = run(short(controller=replay(broken), trajectory=LINE))
    good = run(short(controller=replay(sane), trajectory=LINE))
    assert bad.status is not Status.COMPLETED
    assert bad.message.startswith("step 7 of 13, depth")
    assert good.status is Status.COMPLETED
    for name, array in state_of(good).items():
        np.testing.assert_array_equal(bad.series[name], array, err_msg=name)
    np.testing.assert_array_equal(bad.series["tissue_m"][-1], good.series["tissue_m"][-1])


def test_a_run_whose_first_step_fails_has_one_row() -> None:
    deep = replay([[12.0, 20.0, -40.0, 1.0, 0.0, 0.0, 0.0]])
    found = run(short(controller=deep, trajectory=LINE, solver={"max_iterations": 1}))
    assert found.status is not Status.COMPLETED
    assert len(found.series["t_s"]) == len(found.series["tissue_m"]) == 1
    result = json.loads(json.dumps(found.result(), allow_nan=False))
    assert result["metrics"]["rmse_commanded_mm"] is None
    assert result["timing"]["plant"]["median_ms"] is None
    assert result["solver"]["iterations_max"] == 0
