"""Where an iteration begins: what constrains, the iterate, the held nodes at their places."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from simcore.contact.channel import Channel, Phase
from simcore.contact.kernels import ConstraintPoints
from simcore.contact.laws import Staircase, staircases
from simcore.contact.line import free_points
from simcore.insertion.residuals import Constraints, Unknowns
from simcore.insertion.state import ActiveSet, Goal, Guess, Iterate, Workspace
from simcore.needle.shaft import Shaft
from simcore.rotations import compose, log_map

if TYPE_CHECKING:
    from simcore.arrays import Floats
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
    base_gap, force = np.concatenate([goal.base.position_m - bodies.needle_x[0], turn]), first.force_n.copy()
    at = Iterate(
        bodies=bodies,
        base_gap=base_gap,
        force_n=force,
        mode=mode,
        points=points,
        all_arcs_m=all_arcs,
        slide=slide,
        adhesion_n=adhesion,
        unknowns=Unknowns(shaft, points, mode, adhesion, all_arcs, slide, force, base_gap),
    )
    return active, at


def move_held(model: CoupledModel, x: Floats, shift_m: Floats) -> None:
    """Put the held nodes exactly where they are prescribed; in the first iterate all others go along with them."""
    held = model.tissue.unknown < 0
    places = model.channel.rest_m[held] + shift_m
    x += places[0] - x[held][0]
    x[held] = places
