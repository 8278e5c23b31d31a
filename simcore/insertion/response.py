"""The linear response of needle and constraints: what the correction and the fast Jacobian share."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from simcore.arrays import Floats
from simcore.contact.kernels import ConstraintPoints, local_compliance, moved_shaft, needle_right_sides
from simcore.insertion.state import ActiveSet
from simcore.needle.beam import BeamForces
from simcore.needle.model import factor_blocks, solve_blocks


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
    a, n = len(active.elements), len(beams.upper)
    factor = factor_blocks(beams.diag[1:], beams.upper[1:], beams.lower[1:])
    moves = np.empty((n, 6, 3 * a))
    needle_right_sides(points.beams, points.columns, moves)
    solve_blocks(*factor, beams.upper[1:], moves)
    shaft, w = np.empty((a, 3, 3 * a)), np.empty((3 * a, 3 * a))
    moved_shaft(points.beams, points.columns, np.zeros((6, 3 * a)), moves, shaft)
    local_compliance(active.elements, between_m_per_n, shaft, points.frames, w)
    return NeedleResponse(w, moves, factor)
