"""The Jacobian of the converged step: how tip and shaft follow the base (after Baksic et al. 2020, `constraint`).

Implicit differentiation with the active set frozen. The FAST form keeps the needle's exact tangent, the friction law's
slope in |lambda_n| and the tissue's kept factor; it drops the turn of the constraint frames times lambda, the slope of
the arc lengths, and the tissue's change of stiffness since its factor was made. Its error against central differences
is measured in the tests.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from simcore.contact.channel import project
from simcore.contact.kernels import frame_along, moved_shaft, to_local
from simcore.contact.laws import Response, system_rows
from simcore.insertion.response import linear_response
from simcore.linear_algebra.dense import solved_system
from simcore.linear_algebra.products import product, times
from simcore.needle.model import solve_blocks
from simcore.needle.shaft import shaft_columns, shaft_frame

if TYPE_CHECKING:
    from simcore.arrays import Floats
    from simcore.insertion.model import CoupledModel
    from simcore.insertion.state import Bodies, SolvedStep


@dataclass(frozen=True)
class Linearisation:
    """First-order response of the needle to its base: rows m per (m, m, m, rad, rad, rad), world.

    The base's rotation is a spatial spin about the base. tip: (3, 6). rcm: (2, 6) lateral distances of the shaft to the
    remote centre of motion, rcm_error_m: (2,) their values; None before puncture, where the shaft is not guided.
    """

    tip: Floats
    rcm: Floats | None
    rcm_error_m: Floats


def lateral_offset(model: CoupledModel, bodies: Bodies, inserted_m: float) -> tuple[Floats, Floats, int, Floats]:
    """Where the shaft passes the entry: lateral offsets (2,) m of the shaft in its own frame, the frame (3, 3), and
    beam and weights (4,) of that shaft point. Beyond the tip the end tangent is continued."""
    b, length = bodies, model.needle.element_length_m
    guess = model.needle.length_m - inserted_m
    s = project(b.needle_x, b.needle_R, length, model.entry_m, guess)
    c, dc, _, beam, h = shaft_frame(b.needle_x, b.needle_R, length, s)
    frame = np.empty((3, 3))
    frame_along(dc, frame)
    return times(frame[:2], c - model.entry_m), frame, beam, h


def linearise(model: CoupledModel, solved: SolvedStep) -> Linearisation:
    """Differentiate a solved step."""
    free, _ = base_response(model, solved)
    offset, frame, beam, h = lateral_offset(model, solved.bodies, solved.at.inserted_m)
    if solved.at.inserted_m == 0.0:
        return Linearisation(free[-1, :3], None, offset)
    row, beams = np.empty((1, 3, 12)), np.array([beam])
    shaft_columns(solved.bodies.needle_R, beam, h, row[0])
    passing = np.empty((1, 3, 6))
    moved_shaft(beams, row, np.eye(6), free, passing)
    return Linearisation(free[-1, :3], product(frame[:2], passing[0]), offset)


def base_response(model: CoupledModel, solved: SolvedStep) -> tuple[Floats, Floats]:
    """Moves (n, 6, 6) of the needle's free nodes and changes (3a, 6) N, world, of the constraint forces, per move of
    the base: about the end of the step, with every mode as it is."""
    points, beams, a = solved.at.points, solved.beams, len(solved.active.elements)
    needle = linear_response(solved.active, points, beams, solved.between_m_per_n)
    free = np.zeros((model.needle.elements, 6, 6))
    free[0] = -beams.lower[0]
    solve_blocks(*needle.factor, beams.upper[1:], free)
    if not a:
        return free, np.zeros((0, 6))
    shaft = np.empty((a, 3, 6))
    moved_shaft(points.beams, points.columns, np.eye(6), free, shaft)
    change = _force_response(model, solved, needle.w, shaft)
    return free - product(needle.per_force.reshape(-1, 3 * a), change).reshape(free.shape), change


def _force_response(model: CoupledModel, solved: SolvedStep, w: Floats, shaft_moves: Floats) -> Floats:
    """(3a, 6) N per base move, world: change of the constraint forces when the shaft moves and every mode stays."""
    at, active = solved.at, solved.active
    points, a, slides = at.points, len(active.elements), active.contact and bool(at.slide.any())
    force = to_local(points.frames, at.force_n)
    matrix, right = np.empty((3 * a, 3 * a)), np.empty(3 * a)
    response = Response(w, points.gap, points.arc, points.speed, force)
    system_rows(response, at.law(model, active), force, at.mode, at.slide, slides, matrix, right)
    local = np.einsum("iab,ibk->iak", points.frames, shaft_moves)
    local[at.mode % 2 == 0, 2] = 0.0  # a sliding element's force does not depend on where it slides
    local[active.free, :2] = 0.0
    if slides:
        local[0, :2] = 0.0
    change = solved_system(matrix, local.reshape(3 * a, 6)).reshape(a, 3, 6)
    world: Floats = np.einsum("iba,ibk->iak", points.frames, change)
    return world.reshape(3 * a, 6)
