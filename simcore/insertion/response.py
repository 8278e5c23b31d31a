"""The linear response of needle and constraints: what the correction and the fast Jacobian share."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from simcore.compiled import kernel
from simcore.contact.kernels import ConstraintPoints, local_compliance, moved_shaft, needle_right_sides
from simcore.needle.model import factor_blocks, solve_blocks

if TYPE_CHECKING:
    from simcore.arrays import Floats, Ints


@kernel
def responses(
    elements: Ints,
    points: ConstraintPoints,
    diag: Floats,
    upper: Floats,
    lower: Floats,
    between: Floats,
) -> tuple[Floats, Floats, Floats, Floats]:
    """Of needle and tissue: w (3a, 3a) m/N, gaps per force in local frames; per_force (n, 6, 3a), moves of the needle's
    free nodes per world force on it; the factor of its tangent as two, for `solve_blocks`.

    between: (3P, 3P) m/N, the tissue's compliance between all elements; diag, upper, lower: the needle's tangent.
    """
    a, n = len(elements), len(upper)
    inverses, multipliers = factor_blocks(diag[1:], upper[1:], lower[1:])
    moves = np.empty((n, 6, 3 * a))
    needle_right_sides(points.beams, points.columns, moves)
    solve_blocks(inverses, multipliers, upper[1:], moves)
    shaft, w = np.empty((a, 3, 3 * a)), np.empty((3 * a, 3 * a))
    moved_shaft(points.beams, points.columns, np.zeros((6, 3 * a)), moves, shaft)
    local_compliance(elements, between, shaft, points.frames, points.compliance, w)
    return w, moves, inverses, multipliers


@kernel
def needle_loads(rest: Floats, lower: Floats, base_gap: Floats) -> Floats:
    """(n, 6, 1) loads on the free nodes: their residual (n + 1, 6), and what the prescribed move (6,) of the base does
    to the first of them by lower (6, 6)."""
    loads = np.empty((len(rest) - 1, 6, 1))
    for i in range(len(loads)):
        for c in range(6):
            loads[i, c, 0] = rest[i + 1, c]
    for c in range(6):
        for k in range(6):
            loads[0, c, 0] -= lower[c, k] * base_gap[k]
    return loads


@kernel
def with_forces(base_gap: Floats, step: Floats, per_force: Floats, change: Floats) -> Floats:
    """(n + 1, 6) m, rad: moves of all nodes, step (n, 6, 1) less what the change (a, 3) N of the forces does to them by
    per_force (n, 6, 3a)."""
    moves = np.empty((len(step) + 1, 6))
    for c in range(6):
        moves[0, c] = base_gap[c]
    for i in range(len(step)):
        for c in range(6):
            value = step[i, c, 0]
            for k in range(per_force.shape[2]):
                value -= per_force[i, c, k] * change[k // 3, k % 3]
            moves[i + 1, c] = value
    return moves
