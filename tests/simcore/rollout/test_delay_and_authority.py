"""A delay shifts the commands of a run; the authority of the remote centre is in its series and in its warnings."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from simcore.errors import Status
from simcore.insertion.insertion import Insertion
from simcore.rollout.authority import AUTHORITY, authority_arrays, authority_warnings
from simcore.rollout.digest import digest
from simcore.rollout.rollout import run
from simcore.scenario.scenario import InverseFem, OpenLoop
from tests.simcore.short_run import LINE, STEPS, replay, short

if TYPE_CHECKING:
    from simcore.insertion.insertion import InsertionState
    from simcore.insertion.state import Pose

Series = dict[str, np.ndarray]

# ---- delay


@pytest.mark.slow
@pytest.mark.parametrize("steps", [1, 4])
def test_a_delayed_run_is_the_run_whose_commands_are_shifted(steps: int) -> None:
    """To the bit, in every array but the commands, which stand where they were made."""
    poses = [[12.0 + 0.02 * i, 20.0, -80.0 + 0.5 * (i + 1), 1.0, 0.0, 0.0, 0.0] for i in range(17)]
    first = [12.0, 20.0, -80.0, 1.0, 0.0, 0.0, 0.0]
    delayed = run(short(trajectory=LINE, controller={**replay(poses), "delay_s": 0.1 * steps}))
    shifted = run(short(trajectory=LINE, controller=replay([*[first] * steps, *poses[:-steps]])))
    assert delayed.status is shifted.status is Status.COMPLETED
    commands = {name: delayed.series[name] for name in ("command_position_m", "command_rotation")}
    assert digest({**shifted.series, **commands}) == delayed.digest
    assert delayed.digest != run(short(trajectory=LINE, controller=replay(poses))).digest


@pytest.mark.slow
def test_open_loop_with_a_delay_is_open_loop_later() -> None:
    now, late = (run(short(trajectory=LINE, controller={"kind": "open_loop", "delay_s": d})) for d in (0.0, 0.5))
    for name in ("base_position_m", "tip_m", "base_force_n", "depth_m"):
        np.testing.assert_allclose(late.series[name][5:], now.series[name][:-5], atol=1e-9, err_msg=name)
        np.testing.assert_allclose(late.series[name][:6], [now.series[name][0]] * 6, atol=1e-9, err_msg=name)


def test_a_delay_longer_than_the_run_never_moves_the_base() -> None:
    series = run(
        short(trajectory={**LINE, "target_mm": [12, 20, 5]}, controller={"kind": "ifem", "delay_s": 1.0})
    ).series
    assert len(series["t_s"]) == 6
    np.testing.assert_array_equal(series["base_position_m"], [series["base_position_m"][0]] * 6)


@pytest.mark.slow
def test_a_delay_costs_accuracy() -> None:
    rmse = [
        run(short(noise_mm=0.0, controller={"kind": "ifem", "delay_s": d})).metrics["rmse_commanded_mm"]
        for d in (0.0, 0.1, 0.2)
    ]
    assert rmse[0] < rmse[1] < rmse[2]


# ---- the authority in the series


def test_the_series_tells_the_authority_of_every_state_that_was_linearised() -> None:
    found = run(short())
    authority, sigma = (found.series[name] for name in AUTHORITY)
    guided = found.series["depth_m"] > 0.0
    known = np.isfinite(authority).all(axis=(1, 2))
    np.testing.assert_array_equal(known[:-1], guided[:-1])
    assert not known[-1]  # nothing is commanded from the last state
    np.testing.assert_array_equal(np.isfinite(sigma), known)
    for matrix, smallest in zip(authority[known], sigma[known], strict=True):
        gram = matrix @ matrix.T
        lowest = 0.5 * (np.trace(gram) - math.sqrt(np.trace(gram) ** 2 - 4.0 * np.linalg.det(gram)))
        assert smallest == pytest.approx(math.sqrt(lowest), rel=1e-5)
    below = found.series["tip_m"][known, 2]
    share = -authority[known][:, [0, 1], [0, 1]] / (below / (0.08 - below))[:, None]
    assert ((share > 0.2) & (share < 1.02)).all()  # of a rigid lever's, with its sign: all of it only at the entry


@pytest.mark.slow
def test_a_failed_step_keeps_the_authority_that_it_was_commanded_with(monkeypatch: pytest.MonkeyPatch) -> None:
    whole, step = run(short()), Insertion.step

    def failing(self: Insertion, state: InsertionState, base: Pose) -> InsertionState:
        found = step(self, state, base)
        if found.steps < 21:
            return found
        return replace(found, report=replace(found.report, status=Status.NOT_CONVERGED, message="made to fail"))

    monkeypatch.setattr(Insertion, "step", failing)
    found = run(short())
    assert (found.status, len(found.series["t_s"])) == (Status.NOT_CONVERGED, 21)
    assert np.isfinite(found.series["rcm_authority"][-1]).all()
    for name in AUTHORITY:
        np.testing.assert_array_equal(found.series[name], whole.series[name][:21])


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["open_loop", "rigid", "frozen"])
def test_a_controller_that_linearises_nothing_has_no_authority(kind: str) -> None:
    found = run(short(controller={"kind": kind}))
    assert len(found.series["t_s"]) == STEPS + 1
    assert all(np.isnan(found.series[name]).all() for name in AUTHORITY)
    assert found.warnings == []


def test_the_authority_is_in_no_digest() -> None:
    found = run(short())
    without = {name: array for name, array in found.series.items() if name not in AUTHORITY}
    assert digest(without) == found.digest


# ---- its warnings


def series_of(depth_mm: list[float], x: list[float], y: list[float]) -> Series:
    """A series with a diagonal authority; NaN in its last row, as in a completed run."""
    authority = [np.diag(pair) for pair in zip(x, y, strict=True)]
    return {"depth_m": 1e-3 * np.array([*depth_mm, depth_mm[-1]]), **authority_arrays(authority, len(depth_mm) + 1)}


def told(x: list[float], y: list[float]) -> list[str]:
    return authority_warnings(series_of([10.0 * i for i in range(len(x))], x, y), InverseFem())


def test_the_rise_behind_the_entry_is_no_warning() -> None:
    assert told([math.nan, -0.01, -0.06, -0.1], [math.nan, -0.01, -0.05, -0.2]) == []


def test_a_fall_into_weakness_names_both_depths() -> None:
    (line,) = told([-0.01, -0.1, -0.2, -0.2, -0.2], [-0.01, -0.1, -0.04, -0.003, -0.01])
    assert "smallest singular value falls below 0.05 at a depth of 20.0 mm" in line
    assert "at least 0.003, at 30.0 mm" in line


def test_an_authority_that_is_always_weak_is_told() -> None:
    (line,) = told([-0.01, -0.04, -0.02], [-0.01, -0.03, -0.02])
    assert "never reaches 0.05 (at most 0.03, at a depth of 10.0 mm)" in line


def test_each_direction_that_changes_sign_is_named_with_its_depth() -> None:
    first, second, third = told([-0.1, -0.2, -0.2, -0.01, 0.1], [-0.1, -0.1, 0.01, 0.1, 0.1])
    assert "its x component changes sign at a depth of 40.0 mm" in first
    assert "its y component changes sign at a depth of 20.0 mm" in second
    assert "falls below 0.05 at a depth of 20.0 mm" in third


def test_nothing_known_is_no_warning() -> None:
    nothing = series_of([0.0, 1.0], [math.nan] * 2, [math.nan] * 2)
    assert authority_warnings(nothing, InverseFem()) == []
    weak = series_of([0.0, 1.0], [-0.01] * 2, [-0.01] * 2)
    assert authority_warnings(weak, OpenLoop()) == []
    assert len(authority_warnings(weak, InverseFem())) == 1


def test_a_result_carries_the_warnings_of_its_run() -> None:
    """A needle that would yield, and a friction that the scenario warns of."""
    found = run(short(needle={"yield_mpa": 1.0}, interaction={"friction": 0.4}))
    friction, stress, *others = found.result()["warnings"]
    assert friction.startswith("interaction.friction")
    assert stress.startswith("the needle's stress")
    assert found.warnings == [stress, *others]
