"""The inverse with weak directions: exact where it may be, bounded everywhere, the same at every time step."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simcore.controllers.selective_inverse import selective_move
from tests.budget import examples

Vector = np.ndarray

quick = settings(max_examples=examples(100), deadline=None)
seeds = st.integers(0, 10_000)


def random_jacobian(seed: int, rows: int = 5, smallest: float = 1.0) -> Vector:
    """(rows, 6) with its smallest singular value times `smallest`."""
    u, s, vt = np.linalg.svd(np.random.default_rng(seed).normal(size=(rows, 6)), full_matrices=False)
    s[-1] *= smallest
    return np.asarray((u * s) @ vt)


@pytest.mark.slow
@quick
@given(seeds, st.sampled_from([3, 5]))
def test_without_a_weak_direction_it_is_the_pseudo_inverse(seed: int, rows: int) -> None:
    jacobian, error = random_jacobian(seed, rows), np.random.default_rng(seed + 1).normal(size=rows)
    np.testing.assert_allclose(selective_move(jacobian, error, 1e9), np.linalg.pinv(jacobian) @ error, rtol=1e-7)


def test_two_directions_worked_by_hand() -> None:
    """J = diag(1, 0.5, 0.1): N_i = M_i = 1 along each axis, so each may move by all of g: 2 and 4 stay, 10 does not."""
    jacobian = np.diag([1.0, 0.5, 0.1])
    np.testing.assert_allclose(selective_move(jacobian, np.array([2.0, 2.0, -1.0]), 5.0), [2.0, 4.0, -5.0])


def test_a_direction_that_cancels_is_slow() -> None:
    """Both joints move the tip alike, their difference hardly: v = (1, -1) / sqrt 2, |J_j| = 1, s = e / sqrt 2, so that
    M = sqrt 2 / s, and the direction may move by g s / sqrt 2 = g e / 2."""
    small = 0.01
    jacobian = np.array([[1.0, 1.0], [0.5 * small, -0.5 * small], [0.0, 0.0]])
    move = selective_move(jacobian, np.array([0.0, 1.0, 0.0]), 3.0)
    np.testing.assert_allclose(move, 3.0 * small / 2.0 * np.array([1.0, -1.0]) / np.sqrt(2.0), rtol=1e-4)


@pytest.mark.slow
@quick
@given(seeds, st.floats(1e-6, 1.0), st.floats(0.1, 1e6))
def test_no_direction_moves_by_more_than_its_bound(seed: int, smallest: float, size: float) -> None:
    jacobian = random_jacobian(seed, smallest=smallest)
    move = selective_move(jacobian, size * np.random.default_rng(seed + 1).normal(size=5), 0.01)
    along = np.abs(np.linalg.svd(jacobian)[2] @ move)
    assert along.max() <= 0.01 * (1.0 + 1e-9)
    assert along[5] < 1e-12  # nothing along the direction that changes nothing
    # M >= |J v| / s summed over both objectives >= 1, N <= sqrt 2: the weakest falls with its singular value
    s, reach = np.linalg.svd(jacobian)[1][-1], np.abs(np.linalg.svd(jacobian)[2][4]) @ np.linalg.norm(jacobian, axis=0)
    assert along[4] <= 0.01 * np.sqrt(2.0) * s / reach * (1.0 + 1e-9)


@pytest.mark.slow
@quick
@given(seeds)
def test_a_useless_direction_leaves_the_others_alone(seed: int) -> None:
    """As a singular value goes to zero the move goes to the one without it, and is finite at zero."""
    error = np.random.default_rng(seed + 1).normal(size=5)
    whole, weak, gone = (
        selective_move(random_jacobian(seed, smallest=smallest), error, 1e3) for smallest in (1.0, 1e-9, 0.0)
    )
    np.testing.assert_allclose(weak, gone, atol=1e-5)
    kept = np.linalg.svd(random_jacobian(seed), full_matrices=False)[2][:4]
    np.testing.assert_allclose(kept @ gone, kept @ whole, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("shape", [(3, 3), (3, 6), (5, 6)])
def test_a_jacobian_of_zeros_moves_nothing(shape: tuple[int, int]) -> None:
    assert not selective_move(np.zeros(shape), np.ones(shape[0]), 1.0).any()


def test_small_errors_are_scaled_with_the_step() -> None:
    """Both the error of a step and its bound fall with dt, and so does the move: its speed does not hang on dt."""
    jacobian, error = random_jacobian(3, smallest=1e-3), np.random.default_rng(4).normal(size=5)
    for share in (0.5, 0.1):
        half = selective_move(jacobian, share * error, share * 0.3)
        np.testing.assert_allclose(half, share * selective_move(jacobian, error, 0.3), rtol=1e-12)
