"""Cholesky's factor of a symmetric band matrix, in single precision, and its two triangular sweeps.

Golub and Van Loan, "Matrix computations", 2013, algorithm 4.3.5, PANEL columns at once, which reads and writes the rest
of the matrix PANEL times less often. An entry takes its terms one after the other, and a sweep upwards adds partial
sums that are as many on every processor.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from simcore.compiled import kernel
from simcore.linear_algebra.lanes import LANES, lane_dot

if TYPE_CHECKING:
    from simcore.arrays import Singles

PANEL = 4  # columns


def empty_band(unknowns: int, half_bandwidth: int) -> Singles:
    """Room for the lower band of a matrix: row j is column j from its diagonal down, [j, i - j] = A[i, j].

    Filled up with rows of the unit matrix to whole panels, and with zeros to whole lanes below a panel: no loop over a
    panel has a remainder.
    """
    rows, reach = -(-unknowns // PANEL) * PANEL, -(-half_bandwidth // LANES) * LANES
    band = np.zeros((rows, reach + PANEL), np.float32)
    band[unknowns:, 0] = 1.0
    return band


@kernel
def factor_band(band: Singles) -> int:
    """Replace a matrix by its factor L, whose diagonal holds inverses: 0, or the row, from 1, that is not positive."""
    n, width = band.shape
    for j in range(0, n, PANEL):
        for c in range(j, j + PANEL):
            column = band[c]
            for a in range(j, c):
                subtract(band[a, c - a :], column)
            if not column[0] > 0.0:
                return c + 1
            column[0] = np.float32(1.0) / np.sqrt(column[0])
            for i in range(1, width):
                column[i] *= column[0]
        for c in range(j + PANEL, min(n, j + width)):
            subtract_panel(band, j, c)
    return 0


@kernel
def subtract(column: Singles, target: Singles) -> None:
    """Take from a column what one before it, cut to begin in the same row, does to it."""
    share = column[0]
    for i in range(len(column)):
        target[i] -= share * column[i]


@kernel
def subtract_panel(band: Singles, j: int, c: int) -> None:
    """Take from column c what the columns of the panel from j on do to it, one after the other."""
    width = band.shape[1]
    target, first, second = band[c, : width - (c - j)], band[j, c - j :], band[j + 1, c - j - 1 : width - 1]
    third, fourth = band[j + 2, c - j - 2 : width - 2], band[j + 3, c - j - 3 : width - 3]
    a, b, d, e = first[0], second[0], third[0], fourth[0]
    for i in range(len(target)):
        target[i] = target[i] - a * first[i] - b * second[i] - d * third[i] - e * fourth[i]


@kernel
def solve_band(factor: Singles, right: Singles) -> None:
    """Replace the rows of right (m, unknowns) by the solutions of their systems; factor: from `factor_band`."""
    rows, width = factor.shape
    x = np.zeros(rows + width - PANEL, np.float32)
    for r in range(len(right)):
        for i in range(right.shape[1]):
            x[i] = right[r, i]
        sweep_down(factor, x)
        sweep_up(factor, x)
        for i in range(right.shape[1]):
            right[r, i] = x[i]


@kernel
def sweep_down(factor: Singles, x: Singles) -> None:
    """Solve L y = x in place; x: (n + reach,), zeros beyond the rows."""
    n, width = factor.shape
    for j in range(0, n, PANEL):
        for c in range(j, j + PANEL):
            x[c] *= factor[c, 0]
            for i in range(c + 1, j + PANEL):
                x[i] -= x[c] * factor[c, i - c]
        below = x[j + PANEL : j + width]
        first, second = factor[j, PANEL:], factor[j + 1, PANEL - 1 : width - 1]
        third, fourth = factor[j + 2, PANEL - 2 : width - 2], factor[j + 3, PANEL - 3 : width - 3]
        a, b, d, e = x[j], x[j + 1], x[j + 2], x[j + 3]
        for i in range(len(below)):
            below[i] = below[i] - a * first[i] - b * second[i] - d * third[i] - e * fourth[i]


@kernel
def sweep_up(factor: Singles, x: Singles) -> None:
    """Solve L^T y = x in place."""
    n, width = factor.shape
    for j in range(n - PANEL, -1, -PANEL):
        below = x[j + PANEL : j + width]
        for c in range(j, j + PANEL):
            x[c] -= lane_dot(factor[c, j + PANEL - c : j + width - c], below)
        for c in range(j + PANEL - 1, j - 1, -1):
            for i in range(c + 1, j + PANEL):
                x[c] -= factor[c, i - c] * x[i]
            x[c] *= factor[c, 0]
