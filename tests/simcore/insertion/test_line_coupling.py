"""The coupling along the line in the coupled step: energy, moments, points that are created, dropped and taken up, and
a limit: spacing, ball and mesh hardly move the tip."""

from __future__ import annotations

from functools import cache, partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from simcore.scenario.build import insertion_of
from simcore.scenario.scenario import Scenario
from tests.simcore.block import (
    AHEAD,
    Trip,
    bare_gaps,
    block_scenario,
    curved_pose,
    curved_trip,
    held,
    line_energy,
    travel,
    works,
)
from tests.verification import verify

if TYPE_CHECKING:
    from simcore.insertion.insertion import InsertionState
    from simcore.insertion.state import Bodies
    from simcore.needle.model import NeedleModel

Vector = np.ndarray
CUTTING_N = 0.1  # the default of the scenario
DIAMETER_MM = 1.27  # of 18G, the default
SMOOTH = {"friction": 0.0, "adhesion_n_per_mm": 0.0}
PUSH_M = np.arange(1, 61) * 5e-4
FIRST_M = np.arange(1, 10) * 5e-5  # while the tip begins to cut, its force rises within a step
THERE_AND_BACK_M = np.concatenate(
    [FIRST_M, PUSH_M, np.full(3, 0.03), 0.03 - np.arange(1, 81) * 5e-4, -0.01 + np.arange(1, 91) * 5e-4]
)  # push 30 mm, hold, 40 mm out, back and 5 mm beyond
check = partial(verify, "coupled")


@cache
def smooth_trip(spacing_mm: float) -> Trip:
    """Without friction and adhesion, on the curved way."""
    return curved_trip(THERE_AND_BACK_M, interaction={"spacing_mm": spacing_mm, **SMOOTH})


# energy


def beam_energy(needle: NeedleModel, bodies: Bodies) -> float:
    """J: of straight beams whose ends turn by theta against the chord, m1 = near theta1 + far theta2 (Battini and
    Pacoste 2002)."""
    s, energy = needle.section, 0.0
    length, phi = s.element_length_m, s.shear_parameter
    near, far = ((n + sign * phi) * s.bending_nm2 / (length * (1 + phi)) for n, sign in ((4, 1), (2, -1)))
    for i in range(needle.elements):
        chord, first, second = bodies.needle_x[i + 1] - bodies.needle_x[i], bodies.needle_R[i], bodies.needle_R[i + 1]
        axis = chord / np.linalg.norm(chord)
        across = np.cross(axis, first[:, 0] + second[:, 0])
        across /= np.linalg.norm(across)
        frame = np.column_stack([np.cross(across, axis), across, axis])
        one, two = (Rotation.from_matrix(frame.T @ end).as_rotvec() for end in (first, second))
        energy += float(near / 2 * (one[:2] @ one[:2] + two[:2] @ two[:2]) + far * (one[:2] @ two[:2]))
        energy += 0.5 * s.torsion_nm2 / length * (two[2] - one[2]) ** 2
        energy += 0.5 * s.axial_n / length * (np.linalg.norm(chord) - length) ** 2
    return energy


def stored(trip: Trip) -> Vector:
    """(s, 3) J in tissue, needle and line."""
    tissue, needle = trip.insertion.tissue, trip.insertion.needle
    return np.array([[held(tissue, s.bodies.x)[2], beam_energy(needle, s.bodies), line_energy(s)] for s in trip.states])


@pytest.mark.slow
@pytest.mark.parametrize(("spacing_mm", "share"), [(6.0, 0.15), (3.0, 0.05)])
def test_energy_closes_over_push_hold_withdrawal_and_re_entry(spacing_mm: float, share: float) -> None:
    """Without friction, quasi-static: work of the robot = energies of tissue, needle and line + f_cut times the way
    that the tip cuts. What is left is the trapezoidal rule, and the cell of the last point: it grows with the tip while
    its spring is drawn, l g^2 / 2 G, the more the longer the spacing. Shares are of the largest stored energy, which is
    a twentieth of the work."""
    trip = smooth_trip(spacing_mm)
    length = trip.insertion.needle.length_m
    ways = [max(length - s.solved.at.all_arcs_m[0], 0.0) for s in trip.states]
    inside = stored(trip)
    rest = works(trip.states) - inside.sum(axis=1) - CUTTING_N * np.cumsum(ways)
    largest = inside.sum(axis=1).max()
    assert (inside.max(axis=0) > [5e-5, 1e-6, 5e-5]).all()  # each of them counts
    source = "first law, quasi-static"
    text = f"frictionless push, hold, withdrawal, re-entry, spacing {spacing_mm:g} mm: energy"
    check(f"{text} not accounted for / stored", expected=0, measured=rest / largest, tolerance=share, source=source)
    begun = [i for i, (a, b) in enumerate(pairwise(trip.states)) if new_points(a, b)]
    assert len(begun) > 4
    gained = np.maximum(-np.diff(rest)[begun], 0.0) / largest
    check(f"{text} from points that begin / stored", expected=0, measured=gained, tolerance=0.02, source=source)


def new_points(before: InsertionState, after: InsertionState) -> set[int]:
    """Elements that constrain in `after` and did not before."""
    return set(after.solved.active.elements) - set(before.solved.active.elements)


# moments


@pytest.mark.slow
def test_the_moment_of_the_gap_is_the_only_one_that_is_not_balanced() -> None:
    """Force on the ball = force on the shaft point, which is g farther; the base bears all forces, and the moments of
    all points about their balls plus the moment of g x F of what acts along the shaft and is carried across the gap."""
    trip = curved_trip(PUSH_M)
    misses, turns, shares = [], [], []
    for state in trip.states[2:]:
        at, base = state.solved.at, state.base_wrench
        misses.append(base[:3] - state.point_forces_n.sum(axis=0))
        arms = state.points_m - state.base.position_m
        gap = bare_gaps(state)
        about_balls = np.cross(arms, at.force_n).sum(axis=0)
        carried = np.cross(gap, at.force_n).sum(axis=0)
        turns.append(base[3:] - about_balls + carried)
        shares.append(np.linalg.norm(carried))
    numbers: dict[str, Any] = {"expected": 0, "source": "Newton's third law"}
    check("compliant line: base force - point forces", measured=misses, tolerance=5e-8, unit="N", **numbers)
    text = "compliant line: base moment - moment about the balls + moment of gap x force"
    check(text, measured=turns, tolerance=5e-9, unit="N m", **numbers)
    assert max(shares) > 1e-7  # it is there


@pytest.mark.slow
def test_a_free_tip_bears_no_lateral_force_and_the_others_obey_their_compliance() -> None:
    """Whole curved trip: at X_c P F = 0; at each other point ball - shaft = -C lambda across the shaft, C = G / l, l
    the lengths that add up to the inserted length, at the entry what the bevel lacks to be in as well."""
    trip = curved_trip(PUSH_M)
    line, largest = trip.insertion.model.line, 0.0
    for state in trip.states[2:]:
        at, elements = state.solved.at, state.solved.active.elements
        local = np.einsum("aij,aj->ai", at.points.frames, at.force_n)
        tip = int(np.flatnonzero(elements == 0)[0])
        assert np.abs(local[tip, :2]).max() < 1e-9  # the force tolerance: the frame turns with the last correction
        lengths = at.adhesion_n / trip.insertion.model.law.adhesion_n_per_m
        assert lengths.sum() == pytest.approx(state.inserted_m, abs=1e-12)
        for i in np.flatnonzero(elements > 0):
            turned = at.points.frames[i] @ line.compliance_m2_per_n @ at.points.frames[i].T
            lacking = max(line.bevel_m - state.inserted_m, 0.0) if elements[i] == 1 else 0.0
            expected = turned[:2, :2] / max(lengths[i] + lacking, 1e-6)
            np.testing.assert_allclose(at.points.compliance[i, :2, :2], expected, rtol=1e-9, atol=1e-9 * expected.max())
        largest = max(largest, float(np.abs(local[:, :2]).max()))
    assert largest > 0.02


# the channel


@pytest.mark.slow
def test_a_point_one_diameter_deep_resolves_what_the_bevel_cut() -> None:
    """Points of the shaft: entry, one needle diameter, then multiples of the spacing; hard ones and points closer than
    the diameter are multiples alone. Each is where the tip was at that depth of the channel."""
    depths = smooth_trip(3.0).states[-1].channel.depth_m[1:6]
    np.testing.assert_allclose(1e3 * depths, [0.0, DIAMETER_MM, 3.0, 6.0, 9.0], atol=1e-9)
    for interaction in ({"spacing_mm": 1.0}, {"line_compliance": False, "tip": "held", "spacing_mm": 10.0}):
        model = insertion_of(block_scenario(interaction=interaction)).model.channel
        np.testing.assert_allclose(np.diff(model.depths_m), model.spacing_m, rtol=1e-9)


@pytest.mark.slow
def test_points_come_and_go_without_a_force_of_their_own() -> None:
    """The largest force of any point at its first step, and at its last one before it is dropped, is a small share of
    the largest of all, and falls with the step: C = G / l is infinite where l is 0."""
    firsts, lasts, largest = list[float](), list[float](), 0.0
    for before, after in pairwise(smooth_trip(3.0).states):
        old, new = set(before.solved.active.elements), set(after.solved.active.elements)
        for state, ones, into in ((after, new - old, firsts), (before, old - new, lasts)):
            place = {e: i for i, e in enumerate(state.solved.active.elements)}
            lateral = np.linalg.norm(state.point_forces_n[:, :2], axis=1)
            into += [lateral[place[e]] for e in ones if e > 1]
        largest = max(largest, float(np.linalg.norm(after.point_forces_n[:, :2], axis=1).max(initial=0.0)))
    assert len(firsts) > 15
    assert len(lasts) > 8
    text, source = "share of the largest lateral force", "C = G / l, l = 0 at the tip"
    check(f"points that begin: {text}", expected=0, measured=np.array(firsts) / largest, tolerance=0.1, source=source)
    check(f"points that end: {text}", expected=0, measured=np.array(lasts) / largest, tolerance=0.1, source=source)


# the limit


@cache
def end_of_short_path(spacing_mm: float, spread_mm: float, element_mm: float) -> Vector:
    """(3,) mm: the tip after a curved way of 40 mm in the paper's block, open loop, 0.8 mm a step."""
    scenario = Scenario.load(
        {
            "dt_s": 0.04,
            "tissue": {"element_size_mm": element_mm},
            "needle": {"elements": 12},
            "interaction": {"spacing_mm": spacing_mm, "spread_mm": spread_mm},
        }
    )
    insertion = insertion_of(scenario)
    start = insertion.initial_state(AHEAD)
    poses = [curved_pose(start.base, depth) for depth in np.arange(1, 51) * 8e-4]
    return 1e3 * travel(insertion, start, poses)[-1].tip_m


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "setting", "bound_mm"),
    [
        ("spacing 4 mm", (4.0, 6.0, 6.0), 0.05),
        ("spacing 2 mm", (2.0, 6.0, 6.0), 0.06),
        ("spacing 1 mm", (1.0, 6.0, 6.0), 0.05),
        ("ball of 4 mm", (3.0, 4.0, 6.0), 0.1),
        ("h = 8 mm", (3.0, 6.0, 8.0), 0.1),
    ],
)
def test_spacing_ball_and_mesh_hardly_move_the_tip(
    name: str, setting: tuple[float, float, float], bound_mm: float
) -> None:
    """End of an open-loop way of 40 mm, which bends the needle and drags the entry by 1 mm, against the default of 3, 6
    and 6 mm. Without a point one diameter deep, spacings of 4 and 3 mm are 0.3 and 0.2 mm from those of 2 and 1 mm."""
    apart = np.linalg.norm(end_of_short_path(*setting) - end_of_short_path(3.0, 6.0, 6.0))
    text, source = f"open loop over 40 mm, {name} against spacing 3, ball 6, h 6 mm: tip", "a coupling with a limit"
    check(text, expected=0, measured=apart, tolerance=bound_mm, source=source, unit="mm")
