"""The Jacobian of the converged step: how tip and shaft follow the base (after Baksic et al. 2020, `constraint`).

Implicit differentiation with the active set frozen. The FAST form keeps the needle's exact tangent, the friction law's
slope in |lambda_n| and the tissue's kept factor; it drops the turn of the constraint frames times lambda, the slope of
the arc lengths, and the tissue's change of stiffness since its factor was made. Its error against central differences
is measured in the tests.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simcore.arrays import Floats
from simcore.contact.channel import project
from simcore.contact.kernels import frame_along, moved_shaft, to_local
from simcore.contact.laws import system_rows
from simcore.insertion.insertion import Insertion, InsertionState
from simcore.insertion.solver import Coupled
from simcore.needle.model import solve_blocks
from simcore.needle.shaft import shaft_columns, shaft_frame


@dataclass(frozen=True)
class Linearisation:
    """First-order response of the needle to its base: rows m per (m, m, m, rad, rad, rad), world.

    The base's rotation is a spatial spin about the base. tip: (3, 6). rcm: (2, 6) lateral distances of the shaft to the
    remote centre of motion, rcm_error_m: (2,) their values; None before puncture, where the shaft is not guided.
    """

    tip: Floats
    rcm: Floats | None
    rcm_error_m: Floats


def lateral_offset(insertion: Insertion, state: InsertionState, point_m: Floats) -> tuple[Floats, Floats, int, Floats]:
    """Where the shaft passes a point (3,) m, world: lateral offsets (2,) m of the shaft in its own frame, the frame
    (3, 3), and beam and weights (4,) of that shaft point. Beyond the tip the end tangent is continued."""
    b, length = state.bodies, insertion.needle.element_length_m
    guess = insertion.needle.length_m - state.inserted_m
    s = project(b.needle_x, b.needle_R, length, point_m, guess)
    c, dc, _, beam, h = shaft_frame(b.needle_x, b.needle_R, length, s)
    frame = np.empty((3, 3))
    frame_along(dc, frame)
    return frame[:2] @ (c - point_m), frame, beam, h


def linearise(insertion: Insertion, state: InsertionState) -> Linearisation:
    """Differentiate the step that led to `state`, the one that was solved last."""
    free, _ = base_response(insertion.solved(state))
    offset, frame, beam, h = lateral_offset(insertion, state, insertion.entry_m)
    if state.inserted_m == 0.0:
        return Linearisation(free[-1, :3], None, offset)
    row, beams = np.empty((1, 3, 12)), np.array([beam])
    shaft_columns(state.bodies.needle_R, beam, h, row[0])
    passing = np.empty((1, 3, 6))
    moved_shaft(beams, row, np.eye(6), free, passing)
    return Linearisation(free[-1, :3], frame[:2] @ passing[0], offset)


def base_response(c: Coupled) -> tuple[Floats, Floats]:
    """Moves (n, 6, 6) of the needle's free nodes and changes (3a, 6) N, world, of the constraint forces, per move of
    the base: about the last evaluated state, with every mode as it is."""
    w, per_force = c.linear_response()
    free = np.zeros((c.needle.elements, 6, 6))
    free[0] = -c.lower[0]
    solve_blocks(*c.needle_factor, c.upper[1:], free)
    if not len(c.elements):
        return free, np.zeros((0, 6))
    shaft = np.empty((len(c.elements), 3, 6))
    moved_shaft(c.beams, c.columns, np.eye(6), free, shaft)
    change = _force_response(c, w, shaft)
    return free - per_force @ change, change


def _force_response(c: Coupled, w: Floats, shaft_moves: Floats) -> Floats:
    """(3a, 6) N per base move, world: change of the constraint forces when the shaft moves and every mode stays."""
    a = len(c.elements)
    force = to_local(c.frames, c.force)
    matrix, right = np.empty((3 * a, 3 * a)), np.empty(3 * a)
    system_rows(
        w, c.gap, c.arc, c.speed, force, force, c.mode, c.breaks, c.sign, c.extra, c.base_friction,
        0.0 if c.contact else c.law.friction, c.slide, c.contact and bool(c.slide.any()),
        c.law.friction, matrix, right,
    )  # fmt: skip
    local = np.einsum("iab,ibk->iak", c.frames, shaft_moves)
    local[c.mode % 2 == 0, 2] = 0.0  # a sliding element's force does not depend on where it slides
    if c.contact and c.slide.any():
        local[0, :2] = 0.0
    change = np.linalg.solve(matrix, local.reshape(3 * a, 6)).reshape(a, 3, 6)
    world: Floats = np.einsum("iba,ibk->iak", c.frames, change)
    return world.reshape(3 * a, 6)
