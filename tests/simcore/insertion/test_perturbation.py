"""The perturbation Jacobian: its own order, the same map as the others, and a plant that does not notice."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np
import pytest
from numpy.typing import NDArray

from simcore.errors import Status
from simcore.insertion.jacobian_exact import linearise_exactly
from simcore.insertion.jacobian_perturbation import Perturbation
from simcore.rollout.records import Silent
from simcore.rollout.rollout import _Loop, run
from simcore.scenario.build import insertion_of
from tests.simcore.block import AHEAD, advanced, block_scenario, curved_pose, straight_trip
from tests.verification import verify

if TYPE_CHECKING:
    from simcore.controllers import Observation
    from simcore.insertion.insertion import Insertion, InsertionState
    from simcore.insertion.jacobian_fast import Linearisation
    from simcore.insertion.state import Pose
    from simcore.rollout.result import Rollout
    from simcore.scenario.scenario import Scenario

Vector = NDArray[np.float64]

LEVER_M = 0.1
SOURCE = "one-sided differences, first order (Adagolodjo et al. 2016, 2019)"


def rows(response: Linearisation) -> Vector:
    """(5, 6), columns in metres at the lever arm."""
    assert response.rcm is not None
    return np.vstack([response.tip, response.rcm]) / [1.0, 1.0, 1.0, LEVER_M, LEVER_M, LEVER_M]


def curved_insertion() -> tuple[Insertion, InsertionState, InsertionState]:
    """States before and after the last of 40 steps on a curved way; every element slips."""
    insertion = insertion_of(block_scenario())
    before = state = insertion.initial_state(AHEAD)
    first = state.base
    for i in range(40):
        before, state = state, advanced(insertion, state, curved_pose(first, 1e-3 * (i + 1)))
    return insertion, before, state


@pytest.mark.slow
def test_error_falls_with_the_first_order_of_the_shift() -> None:
    """One-sided differences against the exact Jacobian: halving the shift halves the error, a fitted order of 1."""
    insertion, before, state = curved_insertion()
    exact = rows(linearise_exactly(insertion.model, state.solved))
    shifts = 5e-5 * np.array([4.0, 2.0, 1.0])
    errors = []
    for shift in shifts:
        response = Perturbation(insertion, shift_m=shift, lever_arm_m=LEVER_M).linearise(before, state)
        errors.append(np.linalg.norm(rows(response) - exact))
    order = np.polyfit(np.log(shifts), np.log(errors), 1)[0]
    text, share = "perturbation Jacobian against the exact one", errors[-1] / np.linalg.norm(exact)
    verify("coupled", f"{text}: order over the shift", expected=1, measured=order, tolerance=0.1, source=SOURCE)
    verify("coupled", f"{text}: error at 0.05 mm", expected=0, measured=share, tolerance=2e-3, source=SOURCE)


def test_rotations_turn_by_the_shift_over_the_lever_arm() -> None:
    """With a tenfold lever arm a rotation is ten times smaller, and so is the error of its columns."""
    insertion, before, state = curved_insertion()
    exact = rows(linearise_exactly(insertion.model, state.solved))
    near, far = (
        rows(Perturbation(insertion, shift_m=4e-4, lever_arm_m=lever).linearise(before, state)) - exact
        for lever in (LEVER_M, 10.0 * LEVER_M)
    )
    assert np.abs(far[:, :3]).max() == pytest.approx(np.abs(near[:, :3]).max(), rel=1e-3)
    assert np.abs(far[:, 3:]).max() < 0.2 * np.abs(near[:, 3:]).max()


def short_scenario(**controller: object) -> Scenario:
    return block_scenario(
        controller={"kind": "ifem", **controller},
        trajectory={"kind": "line", "target_mm": [14.0, 22.0, 10.0]},
        dt_s=0.02,
        noise_mm=0.1,
    )


def test_remote_centre_rows_are_off_before_the_puncture() -> None:
    insertion = insertion_of(block_scenario(interaction={"puncture_n": 0.1}))
    state = insertion.initial_state(AHEAD)
    response = Perturbation(insertion, shift_m=5e-5, lever_arm_m=LEVER_M).linearise(state, state)
    assert response.rcm is None
    assert response.tip[2, 2] == pytest.approx(1.0, abs=1e-2)


class _Watched(_Loop):
    """A loop whose steps are also perturbed, to no use."""

    computed = 0

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario, Silent(), time.perf_counter)
        self.perturbation = Perturbation(self.episode.insertion, shift_m=1e-4, lever_arm_m=LEVER_M)
        self.commanded = self.controller.command
        self.controller.command = self.command  # type: ignore[method-assign]

    def command(self, observation: Observation) -> Pose:
        assert np.isfinite(self.perturbation.linearise(self.episode.before, self.episode.state).tip).all()
        self.computed += 1
        return self.commanded(observation)


def watched(scenario: Scenario) -> Rollout:
    loop = _Watched(scenario)
    rollout = loop.run()
    assert loop.computed == scenario.steps
    return rollout


@pytest.mark.slow
def test_an_unused_perturbation_leaves_the_plant_bit_identical() -> None:
    scenario = short_scenario()
    plain = run(scenario)
    assert plain.status is Status.COMPLETED
    different = int(watched(scenario).digest != plain.digest)
    text, source = "digests that differ: perturbed at every step, to no use", "definition: it takes back what it does"
    verify("reproducibility", text, expected=0, measured=different, tolerance=0, source=source)


@pytest.mark.slow
def test_steers_like_the_exact_jacobian() -> None:
    """The same map linearised in two ways: tips within a hundredth of a step, and not the same bits."""
    exact, perturbed = run(short_scenario(derivative="exact")), run(short_scenario(jacobian="perturbation"))
    assert perturbed.status is Status.COMPLETED
    apart = np.abs(exact.series["tip_m"][20:] - perturbed.series["tip_m"][20:]).max()
    assert apart > 0.0
    text, source = "I-FEM by perturbation against the exact Jacobian: tip", "one map, linearised twice"
    verify("control", text, expected=0, measured=1e3 * apart, tolerance=2e-3, source=source, unit="mm")
    assert run(short_scenario(jacobian="perturbation")).digest == perturbed.digest


def test_a_step_that_cannot_be_solved_again_ends_the_run_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("simcore.insertion.jacobian_perturbation.FORCE_TOLERANCE_N", 1e-16)
    rollout = run(short_scenario(jacobian="perturbation"))
    assert rollout.status is Status.NOT_CONVERGED
    assert "the controller's model: perturbation Jacobian: residual" in rollout.message


def test_a_needle_out_of_the_tissue_has_a_jacobian_too() -> None:
    """Pulled out again, nothing constrains it: tip and base move as one rigid body, within the one-sided error."""
    depths = np.concatenate([np.arange(1, 25) * 5e-4, 0.012 - np.arange(1, 41) * 5e-4])
    trip = straight_trip(depths)
    before, state = trip.states[-2:]
    assert not len(state.solved.active.elements)
    response = Perturbation(trip.insertion, shift_m=5e-5, lever_arm_m=LEVER_M).linearise(before, state)
    np.testing.assert_allclose(response.tip[:, :3], np.eye(3), atol=1e-6)
    np.testing.assert_allclose(linearise_exactly(trip.insertion.model, state.solved).tip[:, :3], np.eye(3), atol=1e-9)
