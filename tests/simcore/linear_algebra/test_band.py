"""The banded Cholesky factor in single precision and its two sweeps: against LAPACK, and in one order of summation."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg.lapack import spbtrf, spbtrs

from simcore.linear_algebra.band import PANEL, empty_band, factor_band, solve_band
from simcore.linear_algebra.lanes import LANES

Single = NDArray[np.float32]
SIZES = [(1, 0), (3, 2), (4, 3), (21, 5), (50, 16), (64, 17), (90, 40), (333, 60)]


def matrix_of(n: int, half: int, seed: int = 0) -> tuple[Single, Single]:
    """A positive definite band matrix: as (n, n), and its lower band."""
    rng = np.random.default_rng(seed)
    lower = np.tril(rng.uniform(-1.0, 1.0, (n, n)))
    lower[np.subtract.outer(np.arange(n), np.arange(n)) > half] = 0.0
    full = lower @ lower.T + (half + 1.0) * np.eye(n)
    band = empty_band(n, half)
    for j in range(n):
        column = full[j : min(n, j + half + 1), j]
        band[j, : len(column)] = column
    return full.astype(np.float32), band


@pytest.mark.parametrize(("n", "half"), SIZES)
def test_the_factor_is_lapacks(n: int, half: int) -> None:
    full, band = matrix_of(n, half)
    compact = np.zeros((half + 1, n), np.float32)
    for d in range(half + 1):
        compact[d, : n - d] = np.diagonal(full, -d)
    expected, info = spbtrf(compact, lower=1)
    assert factor_band(band) == info == 0
    found = band[:n, : half + 1].T.copy()
    found[0] = 1.0 / found[0]
    assert np.abs(found - expected).max() < 4e-6 * np.abs(expected).max()
    right = np.random.default_rng(1).uniform(-1.0, 1.0, (3, n)).astype(np.float32)
    solution = right.copy()
    solve_band(band, solution)
    assert np.abs(solution - spbtrs(expected, right.T, lower=1)[0].T).max() < 1e-5 * np.abs(solution).max()


@pytest.mark.parametrize(("n", "half"), SIZES)
def test_the_factor_takes_its_terms_one_after_the_other(n: int, half: int) -> None:
    """To the bit: the panels are only an order of work. Entry by entry after Golub and Van Loan, algorithm 4.3.5."""
    _, band = matrix_of(n, half)
    plain = band[:n].copy()
    for j in range(n):
        plain[j, 0] = np.float32(1.0) / np.sqrt(plain[j, 0])
        plain[j, 1:] *= plain[j, 0]
        for c in range(j + 1, min(n, j + half + 1)):
            plain[c, : half + 1 - (c - j)] -= plain[j, c - j] * plain[j, c - j : half + 1]
    assert factor_band(band) == 0
    np.testing.assert_array_equal(band[:n, : half + 1], plain[:, : half + 1])


@pytest.mark.parametrize("half", [1, 15, 16, 40])
def test_a_sweep_upwards_adds_as_many_partial_sums_as_there_are_lanes(half: int) -> None:
    """To the bit: lane k sums terms k, k + LANES, ... below the panel; then halves are added."""
    n = 4 * (half + PANEL)
    _, band = matrix_of(n, half)
    assert factor_band(band) == 0
    x = np.zeros(len(band) + band.shape[1], np.float32)
    x[:n] = np.random.default_rng(2).uniform(-1.0, 1.0, n)
    solution = x[None, :n].copy()
    solve_band(band, solution)
    for j in range(0, len(band), 1):
        x[j] *= band[j, 0]
        x[j + 1 : j + band.shape[1]] -= x[j] * band[j, 1:]
    for j in range(len(band) - PANEL, -1, -PANEL):
        for c in range(j, j + PANEL):
            lanes, start = np.zeros(LANES, np.float32), j + PANEL - c
            for k in range(0, band.shape[1] - PANEL, LANES):
                lanes += band[c, start + k : start + k + LANES] * x[j + PANEL + k : j + PANEL + k + LANES]
            while len(lanes) > 1:
                lanes = lanes[: len(lanes) // 2] + lanes[len(lanes) // 2 :]
            x[c] -= lanes[0]
        for c in range(j + PANEL - 1, j - 1, -1):
            for i in range(c + 1, j + PANEL):
                x[c] -= band[c, i - c] * x[i]
            x[c] *= band[c, 0]
    np.testing.assert_array_equal(solution[0], x[:n])


@pytest.mark.parametrize(("row", "entry"), [(0, -1.0), (17, 0.0), (40, np.nan)])
def test_a_matrix_that_is_not_positive_definite_names_its_row(row: int, entry: float) -> None:
    _, band = matrix_of(50, 8)
    band[row, 0] = entry
    assert factor_band(band) == row + 1


def test_a_solution_that_overflows_is_infinite_and_warns_of_nothing() -> None:
    _, band = matrix_of(30, 4)
    assert factor_band(band) == 0
    right = np.full((1, 30), 3e38, np.float32)
    band[:, 0] *= 10.0
    solve_band(band, right)
    assert not np.isfinite(right).all()
