"""The inverse of a Jacobian that has weak directions: selectively damped least squares (Buss and Kim 2005)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from simcore.linear_algebra.products import times
from simcore.linear_algebra.singular_values import decomposed

if TYPE_CHECKING:
    from simcore.arrays import Floats

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
    u, s, vt = decomposed(jacobian)
    kept = s > ZERO * s[0]
    u, s, vt = u[:, kept], s[kept], vt[kept]
    groups = [rows for rows in (slice(TIP_ROWS), slice(TIP_ROWS, None)) if len(jacobian[rows])]
    unit = np.sum([np.linalg.norm(u[rows], axis=0) for rows in groups], axis=0)
    cost = times(np.abs(vt), np.sum([np.linalg.norm(jacobian[rows], axis=0) for rows in groups], axis=0)) / s
    largest = largest_m * np.minimum(1.0, unit / cost)
    move: Floats = times(vt.T, np.clip(times(u.T, error) / s, -largest, largest))
    return move
