"""Products of vectors and matrices, summed in one order whatever the processor.

BLAS, behind `@`, `dot` and the norm of a vector, sums in the order that suits the processor.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from simcore.arrays import Floats, Singles

TERMS = 1_000_000  # of a product that are held at once


def dot(a: Floats, b: Floats) -> float:
    """The sum of products of two arrays of one shape."""
    return float((a * b).sum())


def norm(a: Floats) -> float:
    """Euclidean length of a vector, Frobenius norm of a matrix."""
    return math.sqrt(dot(a, a))


def times(matrix: Floats, vector: Floats) -> Floats:
    """(..., m): matrix (..., m, n) times vector (n,)."""
    found: Floats = (matrix * vector).sum(axis=-1)
    return found


def product(a: Floats | Singles, b: Floats) -> Floats:
    """(m, n): a (m, k) times b (k, n)."""
    out = np.empty((len(a), b.shape[1]))
    rows = max(1, TERMS // max(1, b.size))
    for start in range(0, len(a), rows):
        np.sum(a[start : start + rows, :, None] * b, axis=1, out=out[start : start + rows])
    return out
