"""What ends a run by name, beside what the solver reports of a step: one rule a function.

Each rule answers with a message, or with None where it does not apply.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from simcore.episode.authority import lost_authority
from simcore.errors import Status
from simcore.insertion.stability import is_stable, least_buckling_force_n
from simcore.linear_algebra.products import dot, norm, times
from simcore.needle.shaft import shaft_frame
from simcore.scenario.scenario import ReachTrajectory, Replay
from simcore.tissue.strain import strain_extremes

if TYPE_CHECKING:
    from simcore.arrays import Floats
    from simcore.insertion.insertion import Insertion, InsertionState
    from simcore.scenario.scenario import Scenario

LOST_MM = 10.0  # of 1,600 insertions of the paper's rerun the sound ones never came farther from the target than 6.7 mm
LOST_PER_SUCCESS = 5.0
UNSTEERED_M = 2e-3  # a tip nearer than this to its target is steered, whatever else fails
DEEPER_M = 1e-3  # by which the free shaft may lie deeper than the place where it enters
NEAR_LIMIT = 1.1  # a step that fails within 10 % of the needle's limit point fails because of it
FACES = ("x_min", "x_max", "y_min", "y_max", "z_min", "z_max")

Ending = tuple[Status, str]


def after_failure(
    insertion: Insertion, last: InsertionState, failed: InsertionState, error_m: float, authority: list[Floats]
) -> Ending:
    """The name of a step that failed after the state `last`, `error_m` from its target.

    authority: (2, 2) of every state so far.
    """
    status, message = failed.report.status, failed.report.message
    if status is Status.INVERTED:
        return status, f"{message}; {place_of_inversion(insertion, failed)}"
    if status not in (Status.NOT_CONVERGED, Status.NOT_FINITE):
        return status, message
    if not is_stable(insertion.model, last.solved, load=NEAR_LIMIT):
        return Status.BUCKLED, f"{_buckling(insertion, last)}; {message}"
    lost = lost_authority(authority) if error_m > UNSTEERED_M else None
    return (Status.AUTHORITY_LOST, f"{lost}; {message}") if lost else (status, message)


def after_step(
    scenario: Scenario, insertion: Insertion, state: InsertionState, error_m: float, authority: list[Floats]
) -> Ending:
    """COMPLETED, or why a run cannot go on from a state that converged, `error_m` from its target."""
    if message := buckled(insertion, state):
        return Status.BUCKLED, message
    for status, message in (
        (Status.SHAFT_BESIDE, shaft_beside(insertion, state)),
        (Status.TARGET_LOST, target_lost(scenario, error_m)),
    ):
        if message:
            lost = lost_authority(authority)
            return (Status.AUTHORITY_LOST, f"{lost}; {message}") if lost else (status, message)
    return Status.COMPLETED, ""


def target_lost(scenario: Scenario, error_m: float) -> str | None:
    """The tip is farther from the target of its command than max(10 mm, 5 success_mm). Prescribed poses have none, and
    one without a path is far at first."""
    if isinstance(scenario.trajectory, ReachTrajectory):
        return None
    allowed_mm = max(LOST_MM, LOST_PER_SUCCESS * scenario.success_mm)
    if isinstance(scenario.controller, Replay) or error_m <= allowed_mm * 1e-3:
        return None
    return f"the tip is {error_m * 1e3:.1f} mm from its target, at most {allowed_mm:g} mm"


def buckled(insertion: Insertion, state: InsertionState) -> str | None:
    """The needle is pushed beyond its limit point: the equilibrium is unstable."""
    push = dot(state.base_wrench[:3], state.base.rotation[:, 2])
    free_m = insertion.needle.length_m - state.inserted_m
    if push < least_buckling_force_n(insertion.model, free_m) or is_stable(insertion.model, state.solved):
        return None
    return _buckling(insertion, state)


def _buckling(insertion: Insertion, state: InsertionState) -> str:
    push = dot(state.base_wrench[:3], state.base.rotation[:, 2])
    free_mm = 1e3 * (insertion.needle.length_m - state.inserted_m)
    return f"the needle buckles: {push:.3g} N on {free_mm:.0f} mm of free shaft is its limit point"


def shaft_beside(insertion: Insertion, state: InsertionState) -> str | None:
    """The base or the free shaft lies more than 1 mm deeper than where the shaft enters and than the surface there:
    beside the tissue or in it, where nothing would stop it."""
    bodies, needle, inward = state.bodies, insertion.needle, insertion.model.channel.inward
    free_m = needle.length_m - state.inserted_m
    arcs = needle.element_length_m * np.arange(needle.elements + 1)
    nodes = bodies.needle_x[(arcs < free_m) | (arcs == 0.0)]
    depths = times(nodes - insertion.entry_m, inward)
    if depths.max() <= DEEPER_M:  # of nearly all states, wherever the shaft enters
        return None
    enters, _, _, _, _ = shaft_frame(bodies.needle_x, bodies.needle_R, needle.element_length_m, free_m)
    surface = dot(insertion.held_shift_m(state), inward)
    allowed = max(0.0, surface, dot(enters - insertion.entry_m, inward)) + DEEPER_M
    deepest = int(depths.argmax())
    if depths[deepest] <= allowed:
        return None
    part = "base" if deepest == 0 else "free shaft"
    return f"the needle's {part} is {depths[deepest] * 1e3:.1f} mm below the surface, beside or in the tissue"


def place_of_inversion(insertion: Insertion, state: InsertionState) -> str:
    """Which tetrahedron collapsed: its centre at rest, and how far that is from the entry, the tip, and the nearest
    side of the tissue's bounding box."""
    tissue = insertion.tissue
    rest = tissue.mesh.nodes_m
    blocks = insertion.workspace.blocks
    worst = strain_extremes(state.bodies.x, blocks.corners, blocks.gradients).least_det_tet
    centre = rest[tissue.mesh.tets[worst]].mean(axis=0)
    sides = np.concatenate([centre - rest.min(axis=0), rest.max(axis=0) - centre]).reshape(2, 3).T.ravel()
    nearest = int(sides.argmin())
    x, y, z = 1e3 * centre
    to_entry, to_tip = (1e3 * norm(centre - p) for p in (insertion.entry_m, state.tip_m))
    return (
        f"the tetrahedron at ({x:.1f}, {y:.1f}, {z:.1f}) mm, {to_entry:.1f} mm from the entry, {to_tip:.1f} mm from "
        f"the tip, {1e3 * sides[nearest]:.1f} mm from {FACES[nearest]}"
    )
