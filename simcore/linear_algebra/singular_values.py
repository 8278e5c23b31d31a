"""Singular values by Hestenes' one-sided Jacobi rotations: every column is turned against every other until all are
perpendicular.

J. Demmel and K. Veselic, "Jacobi's method is more accurate than QR", SIAM J. Matrix Anal. Appl. 13 (1992) 1204: each
small value has as many correct digits as the data give it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from simcore.compiled import kernel

if TYPE_CHECKING:
    from simcore.arrays import Floats

SWEEPS = 60  # a few are enough, convergence is quadratic
PERPENDICULAR = 1e-15  # cosine of two columns below which they are as perpendicular as rounding allows
TINY = 1e-280  # squared length of a vector without a direction
DIRECTIONLESS = 1e-3  # share of a vector that must be across the first one: it is perpendicular but for rounding


@kernel
def turn_columns(columns: Floats, turns: Floats) -> None:
    """Turn the rows of columns (m, n), columns of a matrix, in place until they are perpendicular; the same turns are
    applied to the rows of turns (m, k)."""
    m, n = columns.shape
    for _ in range(SWEEPS):
        settled = True
        for i in range(m):
            for j in range(i + 1, m):
                a, b, c = 0.0, 0.0, 0.0
                for k in range(n):
                    a += columns[i, k] * columns[i, k]
                    b += columns[j, k] * columns[j, k]
                    c += columns[i, k] * columns[j, k]
                if not abs(c) > PERPENDICULAR * np.sqrt(a * b):
                    continue
                settled = False
                zeta = (b - a) / (2.0 * c)
                tangent = (1.0 if zeta >= 0.0 else -1.0) / (abs(zeta) + np.sqrt(1.0 + zeta * zeta))
                cosine = 1.0 / np.sqrt(1.0 + tangent * tangent)
                turn_rows(columns[i], columns[j], cosine, cosine * tangent)
                turn_rows(turns[i], turns[j], cosine, cosine * tangent)
        if settled:
            return


@kernel
def turn_rows(first: Floats, second: Floats, cosine: float, sine: float) -> None:
    """Both rows, (n,), in their plane."""
    for k in range(len(first)):
        first[k], second[k] = cosine * first[k] - sine * second[k], sine * first[k] + cosine * second[k]


def decomposed(matrix: Floats) -> tuple[Floats, Floats, Floats]:
    """U (m, m), s (m,) from the largest, V^T (m, n) of matrix (m, n) = U S V^T, m at most n.

    A row of V^T whose value is zero is zero.
    """
    columns, turns = np.array(matrix, float, order="C"), np.eye(len(matrix))
    turn_columns(columns, turns)
    values = np.linalg.norm(columns, axis=1)
    order = np.argsort(-values, kind="stable")
    values, columns = values[order], columns[order]
    return turns[order].T, values, columns / np.where(values > 0.0, values, 1.0)[:, None]


@kernel
def nearest_rotation(matrix: Floats, out: Floats) -> None:
    """Write out (3, 3) = U V^T of matrix (3, 3) = U S V^T, the smallest value negative where a rotation needs it."""
    u, v = matrix.T.copy(), np.eye(3)  # rows: s_i u_i and v_i
    turn_columns(u, v)
    for i, j in ((0, 1), (1, 2), (0, 1)):
        if squared_length(u[i]) < squared_length(u[j]):
            for k in range(3):
                u[i, k], u[j, k] = u[j, k], u[i, k]
                v[i, k], v[j, k] = v[j, k], v[i, k]
    right_handed(u)
    right_handed(v)
    for i in range(3):
        for j in range(3):
            out[i, j] = u[0, i] * v[0, j] + u[1, i] * v[1, j] + u[2, i] * v[2, j]


@kernel
def squared_length(vector: Floats) -> float:
    """Of a vector (3,)."""
    return float(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2)


@kernel
def right_handed(frame: Floats) -> None:
    """Make the rows (3, 3) a right-handed orthonormal frame: by the first two, from the largest; any, where they have
    no direction."""
    for row in range(2):
        for axis in range(-1, 3):  # the row itself, then the axes in place of it
            if axis >= 0:
                frame[row, :] = 0.0
                frame[row, axis] = 1.0
            before = squared_length(frame[row])
            if row == 1:
                along = frame[0, 0] * frame[1, 0] + frame[0, 1] * frame[1, 1] + frame[0, 2] * frame[1, 2]
                for k in range(3):
                    frame[1, k] -= along * frame[0, k]
            size = np.sqrt(squared_length(frame[row]))
            if before > TINY and size > DIRECTIONLESS * np.sqrt(before):
                break
        for k in range(3):
            frame[row, k] /= size
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        frame[2, i] = frame[0, j] * frame[1, k] - frame[0, k] * frame[1, j]


def smallest_of_pairs(matrices: Floats) -> Floats:
    """(n,): the smaller singular value of each matrix (n, 2, 2), |det| over the larger one."""
    (a, b), (c, d) = np.moveaxis(matrices, 0, -1)
    larger = 0.5 * (np.sqrt((a + d) ** 2 + (b - c) ** 2) + np.sqrt((a - d) ** 2 + (b + c) ** 2))
    found: Floats = np.abs(a * d - b * c) / np.where(larger > 0.0, larger, 1.0)
    return found
