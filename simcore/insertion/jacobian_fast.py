"""The Jacobian of the converged step: how tip and shaft follow the base (after Baksic et al. 2020, `constraint`).

Implicit differentiation with the active set frozen. The FAST form keeps the needle's exact tangent, the friction law's
slope in |lambda_n| and the tissue's kept factor; it drops the turn of the constraint frames times lambda, the slope of
the arc lengths, and the tissue's change of stiffness since its factor was made. Its error against central differences
is measured in the tests.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from simcore.compiled import kernel
from simcore.contact.channel import project
from simcore.contact.kernels import frame_along, moved_shaft, to_local
from simcore.contact.laws import Response, system_rows
from simcore.insertion.response import responses
from simcore.linear_algebra.dense import factor_lu, solve_lu
from simcore.linear_algebra.products import product, times
from simcore.needle.model import solve_blocks
from simcore.needle.shaft import shaft_columns, shaft_frame

if TYPE_CHECKING:
    from simcore.arrays import Floats, Ints
    from simcore.contact.kernels import ConstraintPoints
    from simcore.contact.laws import Law
    from simcore.insertion.model import CoupledModel
    from simcore.insertion.state import Bodies, SolvedStep
    from simcore.needle.beam import BeamForces


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
    offset, frame, beam, h = lateral_offset(model, solved.bodies, solved.at.inserted_m)
    moves = base_moves(model, solved)
    tip = moves.of_node(model.needle.elements - 1)[:3]
    if solved.at.inserted_m == 0.0:
        return Linearisation(tip, None, offset)
    row, passing, ends = np.empty((1, 3, 12)), np.empty((1, 3, 6)), np.empty((1, 6, 6))
    shaft_columns(solved.bodies.needle_R, beam, h, row[0])
    base = np.eye(6) if beam == 0 else moves.of_node(beam - 1)
    ends[0] = moves.of_node(beam)
    moved_shaft(np.zeros(1, np.int64), row, base, ends, passing)
    return Linearisation(tip, product(frame[:2], passing[0]), offset)


class BaseMoves(NamedTuple):
    """How a solved step follows its base, with every mode as it is: moves free (n, 6, 6) of the needle's free nodes
    while the constraint forces stay, per_force (n, 6, 3a) by a world force on each, change (3a, 6) N, world, of those
    forces."""

    free: Floats
    per_force: Floats
    change: Floats

    def of_node(self, node: int) -> Floats:
        """(6, 6) of free node 0 ... n - 1."""
        moved: Floats = self.free[node] - product(self.per_force[node], self.change)
        return moved

    def of_all_nodes(self) -> Floats:
        """(n, 6, 6)."""
        flat = self.per_force.reshape(6 * len(self.free), len(self.change))
        moved: Floats = self.free - product(flat, self.change).reshape(self.free.shape)
        return moved


def base_moves(model: CoupledModel, solved: SolvedStep) -> BaseMoves:
    """About the end of the step. Raises ArithmeticError where the contact laws have no linear response."""
    at, active = solved.at, solved.active
    law = at.law(model, active)
    regular, free, per_force, change = moves_with_base(
        active.elements, at.points, solved.beams, solved.between_m_per_n, law, at.force_n, at.mode, at.slide
    )
    if not regular:
        raise ArithmeticError("the contact laws have no linear response: their matrix is singular or not finite")
    return BaseMoves(free, per_force, change)


@kernel
def moves_with_base(
    elements: Ints,
    points: ConstraintPoints,
    beams: BeamForces,
    between: Floats,
    law: Law,
    force_n: Floats,
    mode: Ints,
    slide: Floats,
) -> tuple[bool, Floats, Floats, Floats]:
    """Whether the laws have a linear response, and the fields of BaseMoves."""
    w, per_force, inverses, multipliers = responses(elements, points, beams.diag, beams.upper, beams.lower, between)
    n, a = len(beams.upper), len(elements)
    free, change, shaft = np.zeros((n, 6, 6)), np.zeros((3 * a, 6)), np.empty((a, 3, 6))
    for i in range(6):
        for j in range(6):
            free[0, i, j] = -beams.lower[0, i, j]
    solve_blocks(inverses, multipliers, beams.upper[1:], free)
    moved_shaft(points.beams, points.columns, np.eye(6), free, shaft)
    force = to_local(points.frames, force_n)
    response = Response(w, points.gap, points.arc, points.speed, force)
    return a == 0 or force_changes(response, law, mode, slide, points.frames, shaft, change), free, per_force, change


@kernel
def answers(law: Law, mode: Ints, slides: bool, element: int, row: int) -> bool:
    """Whether the force of an element along an axis of its frame depends on where the shaft is."""
    if row == 2:
        return bool(mode[element] % 2 == 1)  # it sticks
    return not law.free[element] and not (slides and element == 0)


@kernel
def force_changes(
    response: Response, law: Law, mode: Ints, slide: Floats, frames: Floats, shaft: Floats, change: Floats
) -> bool:
    """Write change (3a, 6) N, world: of the constraint forces when the shaft moves by shaft (a, 3, 6), world, and every
    mode stays. False where they have no linear response."""
    a = len(mode)
    slides = law.contact and (slide[0] != 0.0 or slide[1] != 0.0)
    matrix, right, pivots = np.empty((3 * a, 3 * a)), np.empty(3 * a), np.empty(3 * a, np.int64)
    system_rows(response, law, response.force, mode, slide, slides, matrix, right)
    local = np.zeros((3 * a, 6))
    for i in range(a):
        for r in range(3):
            for k in range(6 if answers(law, mode, slides, i, r) else 0):
                for b in range(3):
                    local[3 * i + r, k] += frames[i, r, b] * shaft[i, b, k]
    if not factor_lu(matrix, pivots):
        return False
    solve_lu(matrix, pivots, local)
    for i in range(a):
        for r in range(3):
            for k in range(6):
                for b in range(3):
                    change[3 * i + r, k] += frames[i, b, r] * local[3 * i + b, k]
    return True
