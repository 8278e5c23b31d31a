"""Dense matrices in kernels: products, LU with partial pivoting, and whether a matrix is positive definite.

Golub and Van Loan, "Matrix computations", 2013, algorithms 3.4.1 and 4.2.1, a row at a time.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from simcore.compiled import kernel

if TYPE_CHECKING:
    from simcore.arrays import Floats, Ints


@kernel
def factor_lu(matrix: Floats, pivots: Ints) -> bool:
    """Replace matrix (n, n) by L and U of its rows exchanged: row k with pivots[k] (n,), one after the other.

    The diagonal holds the inverses of U's. False for a matrix that is singular or not finite.
    """
    n = len(matrix)
    for k in range(n):
        best, largest = k, abs(matrix[k, k])
        for i in range(k + 1, n):
            if abs(matrix[i, k]) > largest:
                best, largest = i, abs(matrix[i, k])
        if not 0.0 < largest < np.inf:
            return False
        pivots[k] = best
        if best != k:
            for j in range(n):
                matrix[k, j], matrix[best, j] = matrix[best, j], matrix[k, j]
        matrix[k, k] = 1.0 / matrix[k, k]
        eliminate(matrix, k)
    return True


@kernel
def eliminate(matrix: Floats, k: int) -> None:
    """Take from the rows below row k as much of it as makes their column k zero, and write how much there."""
    pivot = matrix[k, k + 1 :]
    for i in range(k + 1, len(matrix)):
        share = matrix[i, k] * matrix[k, k]
        matrix[i, k] = share
        if share != 0.0:
            row = matrix[i, k + 1 :]
            for j in range(len(row)):
                row[j] -= share * pivot[j]


@kernel
def solve_lu(matrix: Floats, pivots: Ints, right: Floats) -> None:
    """Replace right (n, m) by the solutions of its m systems; matrix, pivots: from `factor_lu`."""
    n, m = right.shape
    for k in range(n):
        if pivots[k] != k:
            for c in range(m):
                right[k, c], right[pivots[k], c] = right[pivots[k], c], right[k, c]
    for c in range(m):
        for i in range(n):
            value = right[i, c]
            for k in range(i):
                value -= matrix[i, k] * right[k, c]
            right[i, c] = value
        for i in range(n - 1, -1, -1):
            value = right[i, c]
            for k in range(i + 1, n):
                value -= matrix[i, k] * right[k, c]
            right[i, c] = value * matrix[i, i]


def solved_system(matrix: Floats, right: Floats) -> Floats:
    """matrix^-1 right, (n, m). Raises ArithmeticError for a matrix (n, n) that is singular or not finite."""
    factor, pivots = np.array(matrix, float, order="C"), np.empty(len(matrix), np.int64)
    if not factor_lu(factor, pivots):
        raise ArithmeticError("the matrix is singular or not finite")
    solution: Floats = np.array(right, float, order="C")
    solve_lu(factor, pivots, solution)
    return solution


@kernel
def is_positive_definite(matrix: Floats) -> bool:
    """Whether a symmetric matrix (n, n) is; its lower half counts, and is overwritten."""
    for i in range(len(matrix)):
        for j in range(i + 1):
            value = matrix[i, j]
            for k in range(j):
                value -= matrix[i, k] * matrix[j, k]
            if j < i:
                matrix[i, j] = value / matrix[j, j]
            elif not 0.0 < value < np.inf:
                return False
            else:
                matrix[i, i] = np.sqrt(value)
    return True


@kernel
def add_product(a: Floats, b: Floats, out: Floats) -> None:
    """Add to out (m, n): a (m, k) times b (k, n)."""
    for i in range(len(a)):
        row = out[i]
        for k in range(len(b)):
            factor, other = a[i, k], b[k]
            for j in range(len(row)):
                row[j] += factor * other[j]
