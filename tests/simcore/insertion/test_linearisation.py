"""The fast Jacobian of the converged step against central differences of that same step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from simcore.insertion.jacobian_fast import Linearisation, lateral_offset, linearise
from simcore.scenario.build import insertion_of
from tests.simcore.block import AHEAD, HARD, advanced, block_scenario, curved_pose, moved
from tests.verification import verify

if TYPE_CHECKING:
    from simcore.insertion.insertion import Insertion, InsertionState
    from simcore.insertion.state import Pose

Vector = np.ndarray
LEVER_M = 0.1  # makes rotations comparable with translations, as in the controller
COLUMN = np.array([1.0, 1.0, 1.0, LEVER_M, LEVER_M, LEVER_M])
PUSH_M = np.arange(1, 61) * 5e-4
PUSH_PULL_M = np.concatenate([PUSH_M, 0.03 - np.arange(1, 21) * 2.5e-4])


@dataclass(frozen=True)
class Case:
    """One step on the curved way: before, its base, and its derivative by the fast form."""

    insertion: Insertion
    before: InsertionState
    after: InsertionState
    base: Pose
    fast: Linearisation

    def differences(self, delta_m: float) -> tuple[Vector, Vector]:
        """(3, 6) of the tip and (2, 6) of the offsets at the entry, per m and per lever of rotation."""
        columns = []
        for unit in np.eye(6):
            ends = []
            for sign in (1.0, -1.0):
                change = sign * delta_m * unit / COLUMN
                state = advanced(self.insertion, self.before, moved(self.base, change[:3], change[3:]))
                offset = lateral_offset(self.insertion.model, state.bodies, state.inserted_m)[0]
                ends.append(np.concatenate([state.tip_m, offset]))
            columns.append((ends[0] - ends[1]) / (2 * delta_m))
        both = np.array(columns).T
        return both[:3], both[3:]


def case(step: int, **blocks: Any) -> Case:
    """Step number `step` of a curved push to 30 mm (steps 0 to 59) and pull of 5 mm (60 to 79), with hard rows."""
    interaction = {**HARD, **blocks.pop("interaction", {})}
    insertion = insertion_of(block_scenario(interaction=interaction, **blocks))
    state = insertion.initial_state(AHEAD)
    first = state.base
    for depth in PUSH_PULL_M[:step]:
        state = advanced(insertion, state, curved_pose(first, depth))
    base = curved_pose(first, PUSH_PULL_M[step])
    after = advanced(insertion, state, base)
    return Case(insertion, state, after, base, linearise(insertion.model, after.solved))


def error(found: Vector, expected: Vector) -> float:
    """Frobenius norm of the difference of (k, 6) rows against the expected one; rotations scaled by the lever."""
    return float(np.linalg.norm(found / COLUMN - expected) / np.linalg.norm(expected))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("step", "modes", "lateral", "axial", "rcm"),
    [
        (11, [2], 0.020, 1e-4, 0.016),  # 5 mm deep, cutting
        (29, [2, 2], 0.050, 1e-4, 0.023),  # 13 mm
        (59, [2, 2, 2], 0.046, 1e-4, 0.009),  # 28 mm
        (61, [1, 1, 1], 0.013, 1e-4, 0.004),  # sticking after the reversal
        (79, [0, 0, 0], 0.062, 1e-4, 0.015),  # withdrawing, all slip
    ],
)
def test_fast_form_against_differences(step: int, modes: list[int], lateral: float, axial: float, rcm: float) -> None:
    """Implicit differentiation (Baksic et al. 2020) less the terms that the module names: its error, bounded a fifth
    above what it is. spec of the controllers: fast forms were seen 8 to 33 % off on lateral rows of a curved path."""
    c = case(step)
    assert list(c.after.channel.mode[c.before.channel.active_elements()]) == modes
    tip, offset = c.differences(1e-6)
    assert c.fast.rcm is not None
    for name, found, expected, bound in (
        ("lateral rows of the tip", c.fast.tip[:2], tip[:2], lateral),
        ("axial row of the tip", c.fast.tip[2:], tip[2:], axial),
        ("remote-centre rows", c.fast.rcm, offset, rcm),
    ):
        text = f"fast Jacobian, step {step}, modes {modes}: error of the {name}"
        source = "central differences of the same step (after Baksic et al. 2020)"
        verify("coupled", text, expected=0, measured=error(found, expected), tolerance=bound, source=source)


def test_differences_do_not_depend_on_their_step() -> None:
    """The yardstick itself: 1e-5 m and 1e-6 m agree to 1e-5, no mode changes between them."""
    c = case(29)
    for coarse, fine in zip(c.differences(1e-5), c.differences(1e-6), strict=True):
        assert np.linalg.norm(coarse - fine) < 1e-5 * np.linalg.norm(fine)


@pytest.mark.parametrize(
    ("step", "friction", "bound"), [(0, 0.0, 3e-5), (1, 0.0, 1e-4), (0, 1.0, 4e-3), (1, 1.0, 7e-3)]
)
def test_before_puncture(step: int, friction: float, bound: float) -> None:
    """A tip that glides freely or sticks to the surface, after 0.5 and 1 mm: no frame turns; the tissue's change of
    stiffness since its factor is left. No remote-centre rows before the puncture."""
    c = case(step, interaction={"friction": friction, "puncture_n": 1.0})
    tip, _ = c.differences(1e-6)
    assert c.fast.rcm is None
    text, source = f"fast Jacobian before puncture, step {step}, mu = {friction:g}: error", "central differences"
    verify("coupled", text, expected=0, measured=error(c.fast.tip, tip), tolerance=bound, source=source)


def test_a_free_needle_follows_rigidly() -> None:
    """Nothing touches a skin that is not nicked: d tip = dX - (tip - X) x dw, from the base alone."""
    insertion = insertion_of(block_scenario(interaction={"puncture_n": 0.1}))
    start = insertion.initial_state(AHEAD)
    after = advanced(insertion, start, moved(start.base, np.array([1e-3, 2e-3, -0.02]), np.array([0.2, -0.1, 0.3])))
    arm = after.tip_m - after.base.position_m
    expected = np.column_stack([np.eye(3), np.cross(np.eye(3), arm).T])
    text, found = "Jacobian of a free needle", linearise(insertion.model, after.solved).tip
    verify("coupled", text, expected=expected, measured=found, tolerance=1e-9, source="rigid body, dX - (tip - X) x dw")


@pytest.mark.slow
@pytest.mark.parametrize("step", [11, 59])
def test_remote_centre_error_is_the_distance_of_the_shaft(step: int) -> None:
    """The two offsets span the shortest way from the world-fixed entry to the shaft: dense sampling of the shaft."""
    c = case(step)
    needle, b = c.insertion.needle, c.after.bodies
    length = needle.element_length_m
    share = np.linspace(0.0, 1.0, 2001)[:, None]
    curve = np.concatenate([hermite(b.needle_x, b.needle_R, i, length, share) for i in range(needle.elements)])
    nearest = np.linalg.norm(curve - c.insertion.entry_m, axis=1).min()
    assert np.linalg.norm(c.fast.rcm_error_m) == pytest.approx(nearest, abs=1e-7)
    assert nearest > 1e-5


def hermite(x: Vector, R: Vector, i: int, length: float, u: Vector) -> Vector:
    """(k, 3) m: the cubic between nodes i and i + 1 with the nodal axes as tangents, u (k, 1) in [0, 1]."""
    ends = (2 * u**3 - 3 * u**2 + 1) * x[i] + (3 * u**2 - 2 * u**3) * x[i + 1]
    return ends + length * ((u**3 - 2 * u**2 + u) * R[i, :, 2] + (u**3 - u**2) * R[i + 1, :, 2])
