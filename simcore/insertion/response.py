"""The linear response of needle and constraints: what the correction and the fast Jacobian share."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from simcore.compiled import kernel
from simcore.contact.kernels import ConstraintPoints, local_compliance, moved_shaft, needle_right_sides
from simcore.needle.model import factor_blocks, solve_blocks

if TYPE_CHECKING:
    from simcore.arrays import Floats, Ints
    from simcore.insertion.state import ActiveSet
    from simcore.needle.beam import BeamForces


class NeedleResponse(NamedTuple):
    """w (3a, 3a) m/N: gaps per force in local frames, tissue and needle together. per_force (n, 6, 3a): moves of the
    needle's free nodes per world force on it. factor: of its tangent, for `solve_blocks`."""

    w: Floats
    per_force: Floats
    factor: tuple[Floats, Floats]


def linear_response(
    active: ActiveSet, points: ConstraintPoints, beams: BeamForces, between_m_per_n: Floats
) -> NeedleResponse:
    """Of the needle at its tangent `beams`, and of the tissue by its compliance (3P, 3P) between all elements."""
    w, moves, *factor = responses(active.elements, points, beams.diag, beams.upper, beams.lower, between_m_per_n)
    return NeedleResponse(w, moves, (factor[0], factor[1]))


@kernel
def responses(
    elements: Ints,
    points: ConstraintPoints,
    diag: Floats,
    upper: Floats,
    lower: Floats,
    between: Floats,
) -> tuple[Floats, Floats, Floats, Floats]:
    """The fields of NeedleResponse, its factor as two: in one kernel, since Python costs more than its parts."""
    a, n = len(elements), len(upper)
    inverses, multipliers = factor_blocks(diag[1:], upper[1:], lower[1:])
    moves = np.empty((n, 6, 3 * a))
    needle_right_sides(points.beams, points.columns, moves)
    solve_blocks(inverses, multipliers, upper[1:], moves)
    shaft, w = np.empty((a, 3, 3 * a)), np.empty((3 * a, 3 * a))
    moved_shaft(points.beams, points.columns, np.zeros((6, 3 * a)), moves, shaft)
    local_compliance(elements, between, shaft, points.frames, points.compliance, w)
    return w, moves, inverses, multipliers
