"""What a step cannot do ends by name and changes nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from simcore.errors import Status
from simcore.scenario.build import insertion_of
from tests.simcore.block import (
    AHEAD,
    advanced,
    block_scenario,
    moved,
    straight_trip,
)

if TYPE_CHECKING:
    from simcore.insertion.insertion import Insertion, InsertionState


# failures


def deep_state(**blocks: Any) -> tuple[Insertion, InsertionState]:
    trip = straight_trip(np.arange(1, 21) * 1e-3, **blocks)
    return trip.insertion, trip.states[-1]


def contents(state: InsertionState) -> list[np.ndarray]:
    return [v for part in (state.bodies, state.channel) for k, v in vars(part).items() if isinstance(v, np.ndarray)]


def test_an_absurd_turn_does_not_converge_and_changes_nothing() -> None:
    """Named, with numbers; the old state stays."""
    insertion, state = deep_state()
    before = [array.copy() for array in contents(state)]
    after = insertion.step(state, moved(state.base, np.zeros(3), np.array([0.0, 1.5, 0.0])))
    assert after.report.status is Status.NOT_CONVERGED
    assert after.report.message
    assert all(np.array_equal(a, b) for a, b in zip(before, contents(state), strict=True))


def test_a_surface_that_is_never_punctured_inverts() -> None:
    """Pushed in without being punctured, linear tissue folds at about 1 N: min det F <= 0.1 has a name."""
    insertion = insertion_of(block_scenario(interaction={"puncture_n": 10.0}))
    state = insertion.initial_state(np.array([0.0, 0.0, 1.0]))
    for _ in range(100):
        before = [array.copy() for array in contents(state)]
        after = insertion.step(state, moved(state.base, np.array([0.0, 0.0, 5e-4])))
        if after.report.status is not Status.COMPLETED:
            break
        state = after
    assert after.report.status is Status.INVERTED
    assert after.report.min_det_f <= 0.1 < state.report.min_det_f
    assert all(np.array_equal(a, b) for a, b in zip(before, contents(state), strict=True))


DIVERGING = [
    ([0.0, 0.0, 0.0], [0.0, 1.5, 0.0]),
    ([0.0, 0.0, 0.0], [-1.5, 0.0, 0.0]),
    ([0.05, 0.0, 0.0], [0.0, 0.0, 0.0]),
]


@pytest.mark.slow
@pytest.mark.parametrize(
    "absurd",
    [
        pytest.param(DIVERGING, id="diverging"),
        pytest.param([([0.0, 0.0, 0.5], [0.0, 0.0, 0.0])], id="overflowing"),
    ],
)
def test_the_step_after_a_failed_one_is_as_if_nothing_happened(absurd: list[tuple[np.ndarray, np.ndarray]]) -> None:
    """`step` is a function of its arguments: a retry from the good state finds the same equilibrium."""
    insertion, state = deep_state()
    good = moved(state.base, np.array([1e-4, 0.0, 1e-3]))
    expected = advanced(insertion, state, good)
    for shift, turn in absurd:
        assert insertion.step(state, moved(state.base, np.array(shift), turn)).report.status is not Status.COMPLETED
        again = advanced(insertion, state, good)
        np.testing.assert_allclose(again.tip_m, expected.tip_m, atol=1e-10)
        np.testing.assert_allclose(again.base_wrench, expected.base_wrench, atol=1e-7)


def test_too_few_iterations_are_a_named_failure() -> None:
    """max_iterations = 1 on a jump of 3 mm: NOT_CONVERGED with residual, violation and what was allowed."""
    insertion = insertion_of(block_scenario(solver={"max_iterations": 1}))
    start = insertion.initial_state(AHEAD)
    after = insertion.step(start, moved(start.base, np.array([1e-3, 0.0, 3e-3])))
    assert after.report.status is Status.NOT_CONVERGED
    assert after.report.residual_n > insertion.model.tolerances.force_n
    assert "1e-09" in after.report.message


@pytest.mark.slow
@pytest.mark.parametrize("shift", [[-0.02, 0.0, 0.0], [0.0, 0.0, 0.065]], ids=["beside the block", "out of the back"])
def test_a_tip_that_leaves_the_tissue_is_a_named_failure(shift: list[float]) -> None:
    """Outside the rest shape there is nothing to touch or to cut; a skin that is not nicked lets the tip slide off."""
    insertion = insertion_of(block_scenario(interaction={"puncture_n": 0.1}))
    state = insertion.initial_state(np.array([0.0, 0.0, 1.0]))
    for share in np.linspace(0.02, 1.0, 50):
        base = moved(insertion.initial_base(np.array([0.0, 0.0, 1.0])), share * np.array(shift))
        state = insertion.step(state, base)
        if state.report.status is not Status.COMPLETED:
            break
    assert state.report.status is Status.TISSUE_LEFT
    assert "outside" in state.report.message


def test_outside_the_tissue_nothing_is_dragged() -> None:
    """Pulled out by 1 mm and moved sideways, the needle touches nothing."""
    insertion, state = deep_state()
    out = state.tip_m[2] + 1e-3
    for _ in range(20):
        state = advanced(insertion, state, moved(state.base, np.array([0.0, 0.0, -out / 20])))
    state = advanced(insertion, state, moved(state.base, np.array([5e-3, 0.0, 0.0])))
    assert state.inserted_m == 0.0
    assert np.abs(state.base_wrench).max() < 1e-7
