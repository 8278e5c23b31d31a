"""Least squares by Householder's reflections: Golub and Van Loan, "Matrix computations", 2013, algorithm 5.3.2."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from simcore.compiled import kernel

if TYPE_CHECKING:
    from simcore.arrays import Floats

DEPENDENT = 1e-13  # a column of which no more than this share is left depends on those before it


def least_squares(matrix: Floats, right: Floats) -> Floats:
    """(n, k): argmin |matrix x - right|, of matrix (m, n), m at least n, and right (m, k).

    A column that depends on those before it gets no share.
    """
    solution = np.zeros((matrix.shape[1], right.shape[1]))
    write_least_squares(np.array(matrix, float, order="C"), np.array(right, float, order="C"), solution)
    return solution


@kernel
def write_least_squares(matrix: Floats, right: Floats, out: Floats) -> None:
    """`least_squares` into out, which is zero; matrix and right are overwritten."""
    m, n = matrix.shape
    reflector, diagonal, rows = np.empty(m), np.zeros(n), np.zeros(n, np.int64)
    top = 0
    for j in range(n):
        whole, below = 0.0, 0.0
        for i in range(m):
            whole += matrix[i, j] ** 2
            if i >= top:
                below += matrix[i, j] ** 2
                reflector[i] = matrix[i, j]
        if not np.sqrt(below) > DEPENDENT * np.sqrt(whole):
            continue
        diagonal[j], rows[j] = -np.sqrt(below) if matrix[top, j] >= 0.0 else np.sqrt(below), top
        reflector[top] -= diagonal[j]
        scale = -1.0 / (diagonal[j] * reflector[top])
        reflect(reflector, scale, top, j + 1, matrix)
        reflect(reflector, scale, top, 0, right)
        top += 1
    for j in range(n - 1, -1, -1):
        for c in range(out.shape[1] if diagonal[j] != 0.0 else 0):
            value = right[rows[j], c]
            for i in range(j + 1, n):
                value -= matrix[rows[j], i] * out[i, c]
            out[j, c] = value / diagonal[j]


@kernel
def reflect(reflector: Floats, scale: float, top: int, left: int, matrix: Floats) -> None:
    """Replace the part of matrix (m, k) from row `top` and column `left` on by (I - scale v v^T) of it, v the reflector
    (m,) from there on."""
    shares = np.zeros(matrix.shape[1])
    for i in range(top, len(matrix)):
        for c in range(left, len(shares)):
            shares[c] += reflector[i] * matrix[i, c]
    for i in range(top, len(matrix)):
        for c in range(left, len(shares)):
            matrix[i, c] -= scale * shares[c] * reflector[i]
