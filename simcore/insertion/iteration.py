"""The parts of an iteration: begin, evaluate, converged, correct."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from simcore.contact.channel import Channel, Phase
from simcore.contact.kernels import ConstraintPoints, Motion, move_nodes, moved_shaft, tissue_moves, to_local, to_world
from simcore.contact.laws import Response, Staircase, solve_laws, staircases
from simcore.contact.line import free_points
from simcore.insertion.compliance import add_columns
from simcore.insertion.residuals import Constraints, Unknowns, residuals
from simcore.insertion.response import NeedleResponse, linear_response, needle_loads, with_forces
from simcore.insertion.state import ActiveSet, Bodies, Goal, Guess, Iterate, Residuals, Workspace
from simcore.needle.model import advance, solve_blocks
from simcore.needle.shaft import Shaft
from simcore.rotations import compose, log_map
from simcore.tissue.model import rotated_stiffness_times

if TYPE_CHECKING:
    from simcore.arrays import Floats, Singles
    from simcore.insertion.model import CoupledModel


def begin(
    model: CoupledModel, workspace: Workspace, channel: Channel, first: Guess, goal: Goal
) -> tuple[ActiveSet, Iterate]:
    """Fix the active elements and their staircases for this step; the iterate begins at `first` and moves its bodies.

    The base's difference from the first iterate is handed to the first correction as a prescribed displacement.
    """
    bodies = first.bodies
    if goal.held_shift_m is not None:
        move_held(model, bodies.x, goal.held_shift_m)
    turn = log_map(compose(goal.base.rotation, bodies.needle_R[0].T))
    elements = channel.active_elements()
    a, contact = len(elements), channel.phase is Phase.CONTACT
    stair, balls = Staircase.of_size(a), channel.balls
    free = free_points(elements, contact=contact, free_tip=model.line.free_tip)
    constraints = Constraints(contact, elements, stair, free, balls, channel.depth_m, channel.active, channel.count)
    active = ActiveSet(channel, contact, elements, balls, stair, free, constraints)
    law, mode, arcs = model.law, first.mode.copy(), channel.arc_m[elements]
    staircases(contact, elements, arcs, model.needle.length_m, law.cutting_n, law.puncture_n, mode, active.stair)
    workspace.compliance.sync(channel)
    points = ConstraintPoints(
        arc=arcs,
        speed=np.ones(a),
        frames=np.zeros((a, 3, 3)),
        gap=np.zeros((a, 3)),
        beams=np.zeros(a, np.int64),
        columns=np.zeros((a, 3, 12)),
        places=np.zeros((a, 3)),
        compliance=np.zeros((a, 3, 3)),
    )
    if contact:
        points.frames[:] = model.surface_frame
    shaft = Shaft(bodies.needle_x, bodies.needle_R, model.needle.element_length_m)
    all_arcs, slide, adhesion = channel.arc_m.copy(), np.zeros(2), np.zeros(a)
    at = Iterate(
        bodies=bodies,
        base_gap=np.concatenate([goal.base.position_m - bodies.needle_x[0], turn]),
        force_n=first.force_n,
        mode=mode,
        points=points,
        all_arcs_m=all_arcs,
        slide=slide,
        adhesion_n=adhesion,
        unknowns=Unknowns(shaft, points, mode, adhesion, all_arcs, slide),
    )
    return active, at


def move_held(model: CoupledModel, x: Floats, shift_m: Floats) -> None:
    """Put the held nodes exactly where they are prescribed; in the first iterate all others go along with them."""
    held = model.tissue.unknown < 0
    places = model.channel.rest_m[held] + shift_m
    x += places[0] - x[held][0]
    x[held] = places


def evaluate(model: CoupledModel, workspace: Workspace, start: Bodies, active: ActiveSet, at: Iterate) -> Residuals:
    """True residuals at the present iterate."""
    tissue, x, dt = model.tissue, at.bodies.x, model.dt_s
    at.min_det_f = workspace.blocks.evaluate(x, workspace.held_n)
    if tissue.stiffness_damping_s > 0.0:
        rotations = workspace.blocks.rotations()
        rotated_stiffness_times((x - start.x) / dt, *tissue.tetrahedra, rotations, workspace.damping_n)
    motion = Motion(x, start.x, start.v, dt)
    of_tissue, force, moment, gap, law, at.inserted_m = residuals(
        model.constants, active.constraints, motion, at.unknowns, at.force_n, workspace.arrays
    )
    of_needle = np.float64(force), np.float64(moment) / model.needle.element_length_m
    return Residuals(max(of_tissue, *of_needle), gap, law)


def converged(model: CoupledModel, at: Iterate, missing: Residuals) -> bool:
    """Whether the base is at its goal and every residual within its tolerance."""
    return (
        not at.base_gap.any()
        and max(missing.force_n, missing.law_n) <= model.tolerances.force_n
        and missing.violation_m <= model.tolerances.violation_m
    )


def correct(model: CoupledModel, workspace: Workspace, active: ActiveSet, at: Iterate) -> bool:
    """One correction of tissue, needle and forces; False if the contact laws found no consistent state."""
    a, points = len(active.elements), at.points
    needle = linear_response(active, points, workspace.beams, workspace.compliance.between_points)
    tissue_step = workspace.compliance.solve(workspace.right)
    needle_step = _needle_step(workspace, needle, at)
    tissue_part, shaft_part = np.empty((a, 3)), np.empty((a, 3, 1))
    tissue_moves(active.elements, active.balls, model.tissue.unknown, tissue_step, tissue_part)
    moved_shaft(points.beams, points.columns, at.base_gap[:, None], needle_step, shaft_part)
    gap = points.gap + to_local(points.frames, tissue_part - shaft_part[:, :, 0])
    force, new_force, new_arc = to_local(points.frames, at.force_n), np.empty((a, 3)), np.empty(a)
    response = Response(needle.w, gap, points.arc, points.speed, force)
    if a > 0 and not solve_laws(response, at.law(model, active), at.mode, at.slide, new_force, new_arc):
        return False
    change = to_world(points.frames, new_force - force)
    at.force_n = at.force_n + change
    points.arc[:] = new_arc
    moves = with_forces(at.base_gap, needle_step, needle.per_force, change)
    advance(at.bodies.needle_x, at.bodies.needle_R, moves)
    at.base_gap = np.zeros(6)
    move_tissue(model, workspace, active, at, tissue_step, change)
    return True


def _needle_step(workspace: Workspace, needle: NeedleResponse, at: Iterate) -> Floats:
    """(n, 6, 1) m, rad: moves of the needle's free nodes under their residual and the prescribed move of the base."""
    step = needle_loads(workspace.needle_rest, workspace.beams.lower[0], at.base_gap)
    solve_blocks(*needle.factor, workspace.beams.upper[1:], step)
    return step


def move_tissue(
    model: CoupledModel, workspace: Workspace, active: ActiveSet, at: Iterate, step: Singles, change: Floats
) -> None:
    """Move the free nodes by `step` (unknowns,) m and by what the `change` (a, 3) N of the forces adds to it."""
    add_columns(active.elements, workspace.compliance.columns, change, step)
    move_nodes(model.tissue.unknown, step, at.bodies.x)
