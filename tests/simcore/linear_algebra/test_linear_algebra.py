"""Products, systems, singular values and least squares in one order of summation: against NumPy's, and by what defines
them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from simcore.linear_algebra.dense import add_product, is_positive_definite, solved_system
from simcore.linear_algebra.least_squares import least_squares
from simcore.linear_algebra.products import TERMS, dot, norm, product, times
from simcore.linear_algebra.singular_values import decomposed, nearest_rotation, smallest_of_pairs

Vector = NDArray[np.float64]
seeds, sizes = st.integers(0, 2**32 - 1), st.integers(1, 40)


def deviates(seed: int, *shape: int) -> Vector:
    return np.random.default_rng(seed).normal(size=shape)


@given(seeds, sizes, sizes, sizes)
def test_products_are_numpys_to_rounding(seed: int, m: int, k: int, n: int) -> None:
    a, b = deviates(seed, m, k), deviates(seed + 1, k, n)
    sizes_of_terms, into = np.abs(a) @ np.abs(b), np.ones((m, n))
    add_product(a, b, into)
    for found in (product(a, b), into - 1.0):
        assert (np.abs(found - a @ b) <= 1e-13 * (1.0 + sizes_of_terms)).all()
    assert np.allclose(times(a, b[:, 0]), a @ b[:, 0], rtol=0.0, atol=1e-13 * (1.0 + sizes_of_terms.max()))
    assert dot(a, a) == pytest.approx(np.vdot(a, a), rel=1e-13)
    assert norm(a[0]) == pytest.approx(np.linalg.norm(a[0]), rel=1e-13)


def test_a_product_of_more_terms_than_are_held_at_once_is_the_same() -> None:
    a, b = deviates(1, TERMS // 20, 9), deviates(2, 9, 7)
    np.testing.assert_array_equal(product(a, b)[-3:], product(a[-3:], b))
    assert np.abs(product(a, b) - a @ b).max() < 1e-13


@given(seeds, sizes, st.integers(1, 6))
def test_a_dense_system_is_solved_backwards_stably(seed: int, n: int, m: int) -> None:
    """|A x - b| <= c eps |A| |x|, however the matrix is conditioned (Higham 2002, theorem 9.4)."""
    matrix, right = deviates(seed, n, n) * 10.0 ** np.linspace(-6, 6, n)[:, None], deviates(seed + 1, n, m)
    solution = solved_system(matrix, right)
    bound = 1e-14 * n * np.abs(matrix).max(axis=1)[:, None] * (1.0 + np.abs(solution).max(axis=0))
    assert (np.abs(matrix @ solution - right) <= bound * n + 1e-13).all()


def test_rows_are_exchanged_where_a_pivot_is_zero() -> None:
    matrix = np.array([[0.0, 2.0, 0.0], [0.0, 0.0, 3.0], [4.0, 0.0, 0.0]])
    np.testing.assert_array_equal(solved_system(matrix, np.array([[2.0], [6.0], [12.0]])), [[3.0], [1.0], [2.0]])


@pytest.mark.parametrize("entry", [0.0, np.nan, np.inf])
def test_a_matrix_without_an_inverse_is_refused(entry: float) -> None:
    with pytest.raises(ArithmeticError, match="singular or not finite"):
        solved_system(np.array([[1.0, 0.0], [0.0, entry]]), np.ones((2, 1)))


@given(seeds, st.integers(2, 20))
def test_definiteness_is_the_sign_of_the_smallest_eigenvalue(seed: int, n: int) -> None:
    root = deviates(seed, n, n)
    matrix = root @ root.T + np.eye(n)
    least = np.linalg.eigvalsh(matrix)[0]
    assert is_positive_definite(matrix - 0.99 * least * np.eye(n))
    assert not is_positive_definite(matrix - 1.01 * least * np.eye(n))
    matrix[-1, -1] = np.nan
    assert not is_positive_definite(matrix)


@given(seeds, st.integers(1, 6), st.integers(0, 3))
def test_singular_values_are_numpys_and_the_vectors_are_orthonormal(seed: int, m: int, more: int) -> None:
    matrix = deviates(seed, m, m + more) * 10.0 ** np.linspace(0, -5, m)[:, None]
    u, s, vt = decomposed(matrix)
    assert np.abs(s - np.linalg.svd(matrix, compute_uv=False)).max() < 1e-14 * s[0]
    assert np.abs((u * s) @ vt - matrix).max() < 1e-14 * s[0]
    assert np.abs(u.T @ u - np.eye(m)).max() < 1e-13
    assert np.abs(vt @ vt.T - np.eye(m)).max() < 1e-13


def test_a_small_singular_value_has_all_of_its_digits() -> None:
    """Rows of very different lengths, perpendicular: their lengths are the values, as no bidiagonalisation has them."""
    turn = np.linalg.qr(deviates(3, 5, 5))[0]
    lengths = 10.0 ** -np.array([0.0, 5.0, 10.0, 15.0, 20.0])
    assert decomposed(lengths[:, None] * turn)[1] == pytest.approx(lengths, rel=1e-14)


def test_a_matrix_of_zeros_has_values_of_zero() -> None:
    u, s, vt = decomposed(np.zeros((3, 6)))
    np.testing.assert_array_equal(u, np.eye(3))
    assert not s.any()
    assert not vt.any()


@given(seeds)
def test_the_smaller_value_of_a_pair_of_rows(seed: int) -> None:
    matrices = deviates(seed, 20, 2, 2)
    expected = np.linalg.svd(matrices, compute_uv=False)[:, -1]
    assert np.abs(smallest_of_pairs(matrices) - expected).max() < 1e-14
    assert smallest_of_pairs(np.zeros((1, 2, 2)))[0] == 0.0


@given(seeds)
def test_the_nearest_rotation_is_the_polar_factor_without_its_reflection(seed: int) -> None:
    matrix, found = deviates(seed, 3, 3), np.empty((3, 3))
    nearest_rotation(matrix, found)
    u, _, vt = np.linalg.svd(matrix)
    expected = u @ np.diag([1.0, 1.0, np.linalg.det(u) * np.linalg.det(vt)]) @ vt
    assert np.abs(found - expected).max() < 1e-8 / max(1e-3, np.linalg.svd(matrix)[1][1])


@pytest.mark.parametrize("values", [(2, 1, 0), (2, 0, 0), (0, 0, 0), (1, 1, -0.5), (-1, -1, -1), (1e-200, 1e-201, 0)])
def test_a_flat_or_folded_matrix_has_a_nearest_rotation_too(values: tuple[float, ...]) -> None:
    found, turn = np.empty((3, 3)), np.linalg.qr(deviates(5, 3, 3))[0]
    nearest_rotation(turn @ np.diag(values) @ turn.T, found)
    assert np.abs(found.T @ found - np.eye(3)).max() < 1e-14
    assert np.linalg.det(found) == pytest.approx(1.0, abs=1e-14)


@given(seeds, st.integers(1, 12), st.integers(0, 30), st.integers(1, 3))
def test_least_squares_leave_a_rest_across_every_column(seed: int, n: int, more: int, k: int) -> None:
    matrix, right = deviates(seed, n + more, n), deviates(seed + 1, n + more, k)
    rest = matrix @ (found := least_squares(matrix, right)) - right
    assert np.abs(matrix.T @ rest).max() < 1e-11 * (1.0 + np.abs(found).max())


def test_a_dependent_column_gets_no_share_and_costs_nothing() -> None:
    matrix, right = deviates(7, 30, 4), deviates(8, 30, 1)
    matrix[:, 2] = 2.0 * matrix[:, 0]
    found = least_squares(matrix, right)
    assert found[2, 0] == 0.0
    expected = np.linalg.lstsq(matrix, right)[0]
    assert np.linalg.norm(matrix @ found - right) == pytest.approx(np.linalg.norm(matrix @ expected - right), rel=1e-12)
