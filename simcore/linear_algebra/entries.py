"""Entries of arrays one by one. NumPy's words for the same inside kernels bring arrays of answers and the wording of
error messages with them, and cost seconds of compilation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from simcore.compiled import kernel

if TYPE_CHECKING:
    from simcore.arrays import Floats


@kernel
def all_finite(values: Floats) -> bool:
    """Whether each of values (n,) is a number."""
    finite = True
    for i in range(len(values)):
        finite = finite and bool(np.isfinite(values[i]))
    return finite


@kernel
def largest_size(values: Floats) -> float:
    """Of values (n,): NaN if one is, 0 if there is none."""
    most = 0.0
    for i in range(len(values)):
        size: float = abs(values[i])
        if np.isnan(size):
            return size
        most = max(most, size)
    return most


@kernel
def copy_rows(values: Floats, out: Floats) -> None:
    """Write the first columns of out (n, k) = values (n, m), m <= k."""
    for i in range(len(values)):
        for j in range(values.shape[1]):
            out[i, j] = values[i, j]


@kernel
def copy_entries(values: Floats, out: Floats) -> None:
    """Write the first entries of out (m,) = values (n,), n <= m."""
    for i in range(len(values)):
        out[i] = values[i]


@kernel
def add_diagonal(blocks: Floats, out: Floats) -> None:
    """Add blocks (n, k, k) to those on the diagonal of out (n k, n k)."""
    k = blocks.shape[1]
    for block in range(len(blocks)):
        for i in range(k):
            for j in range(k):
                out[block * k + i, block * k + j] += blocks[block, i, j]
