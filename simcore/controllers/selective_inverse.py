"""The inverse of a Jacobian that has weak directions: selectively damped least squares (Buss and Kim 2005)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from simcore.compiled import kernel
from simcore.linear_algebra.entries import largest_size
from simcore.linear_algebra.singular_values import turn_columns

if TYPE_CHECKING:
    from simcore.arrays import Flags, Floats

TIP_ROWS = 3  # of a Jacobian; the others are those of the remote centre
ZERO = 1e-12  # singular values below it, relative to the largest, are none


def selective_move(jacobian: Floats, error: Floats, largest_m: float) -> Floats:
    """The move x (n,) m, near a solution of J x = e. jacobian: (m, n), three rows of the tip first; error: (m,) m.

    With J = U S V^T, each singular direction is inverted exactly up to a largest move of its own, which does not depend
    on the error and falls with its singular value:

        x = sum_i v_i clamp(u_i . e / s_i, +-g_i),        g_i = g min(1, N_i / M_i),
        N_i = sum_l |u_li|,        M_i = sum_l sum_j |v_ji| |J_lj| / s_i,

    l: the tip and the remote centre, each with its rows. N_i is what a unit step along u_i means for them, M_i what the
    move for it would do to them if nothing cancelled. largest_m: g; a speed times dt, so that no result hangs on dt.
    """
    move = np.zeros(jacobian.shape[1])
    add_directions(np.ascontiguousarray(jacobian, float), np.ascontiguousarray(error, float), largest_m, move)
    return move


@kernel
def add_directions(jacobian: Floats, error: Floats, largest_m: float, move: Floats) -> None:
    """Add every singular direction's part to move (n,), from that of the largest singular value on."""
    m, n = jacobian.shape
    along, left = jacobian.copy(), np.eye(m)  # rows: s_i v_i and u_i
    turn_columns(along, left)
    values = np.empty(m)
    for i in range(m):
        values[i] = length_of(along[i])
    rows = (slice(0, min(TIP_ROWS, m)), slice(min(TIP_ROWS, m), m))
    taken = np.zeros(m, np.bool_)
    first = largest_size(values)
    for _ in range(m):
        i = largest_left(values, taken)
        taken[i] = True
        if not values[i] > ZERO * first:
            return
        wanted, unit, cost = 0.0, 0.0, 0.0
        for row in range(m):
            wanted += left[i, row] * error[row]
        for group in rows:
            unit += length_of(left[i, group])
        for j in range(n):
            reach = 0.0
            for group in rows:
                reach += length_of(jacobian[group, j])
            cost += abs(along[i, j] / values[i]) * reach
        largest = largest_m * min(1.0, unit / (cost / values[i]))
        part = min(max(wanted / values[i], -largest), largest)
        for j in range(n):
            move[j] += along[i, j] / values[i] * part


@kernel
def largest_left(values: Floats, taken: Flags) -> int:
    """Where the first of the largest values (m,) is that are not taken (m,)."""
    found = -1
    for i in range(len(values)):
        if not taken[i] and (found < 0 or values[i] > values[found]):
            found = i
    return found


@kernel
def length_of(vector: Floats) -> float:
    """Euclidean."""
    total = 0.0
    for value in vector:
        total += value * value
    return float(np.sqrt(total))
