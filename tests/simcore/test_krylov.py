"""GMRES for several right-hand sides: the solutions, the reported residuals, and the sizes it stops at."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from simcore.krylov import gmres

Vector = NDArray[np.float64]

RNG = np.random.default_rng(11)
MATRIX = np.eye(40) + 0.3 * RNG.normal(size=(40, 40)) / np.sqrt(40.0)
RIGHT = RNG.normal(size=(3, 40))


def same(vector: Vector) -> Vector:
    return vector


def rounded(vector: Vector) -> Vector:
    """An inverse of another matrix, in single precision."""
    inverse = np.linalg.inv(MATRIX + 0.01 * np.eye(40)).astype(np.float32)
    return (vector.astype(np.float32) @ inverse.T).astype(float)


def test_solves_to_the_allowed_residual_and_reports_it() -> None:
    solution, rest = gmres(
        lambda v: v @ MATRIX.T, RIGHT, precondition=same, allowed=np.full(3, 1e-9), max_iterations=40
    )
    residual = np.linalg.norm(RIGHT - solution @ MATRIX.T, axis=1)
    assert (residual <= 1e-9).all()
    assert np.abs(residual - rest).max() < 1e-12


def test_a_rounded_preconditioner_costs_iterations_only() -> None:
    """Far fewer of them, and the residual is the true one far below the rounding of single precision."""
    allowed = np.full(3, 1e-12)
    solution, rest = gmres(lambda v: v @ MATRIX.T, RIGHT, precondition=rounded, allowed=allowed, max_iterations=10)
    assert (rest <= 1e-12).all()
    assert np.linalg.norm(RIGHT - solution @ MATRIX.T, axis=1).max() < 1e-12 * 10


def test_reports_what_is_left_when_the_iterations_run_out() -> None:
    solution, rest = gmres(lambda v: v @ MATRIX.T, RIGHT, precondition=same, allowed=np.zeros(3), max_iterations=4)
    residual = np.linalg.norm(RIGHT - solution @ MATRIX.T, axis=1)
    assert (rest > 1e-4).all()
    assert np.abs(residual - rest).max() < 1e-12


def test_a_zero_side_and_an_exhausted_space_do_no_harm() -> None:
    """A zero right-hand side stays zero; an eigenvector is solved in one iteration, whatever the others need."""
    values, vectors = np.linalg.eigh(MATRIX + MATRIX.T)
    right = np.stack([np.zeros(40), vectors[:, 0], RIGHT[0]])
    solution, rest = gmres(
        lambda v: v @ (MATRIX + MATRIX.T), right, precondition=same, allowed=np.full(3, 1e-9), max_iterations=40
    )
    assert not solution[0].any()
    assert np.abs(solution[1] - vectors[:, 0] / values[0]).max() < 1e-12
    assert (rest <= 1e-9).all()


def test_no_number_is_an_infinite_residual() -> None:
    solution, rest = gmres(lambda v: v * np.nan, RIGHT, precondition=same, allowed=np.full(3, 1e-9), max_iterations=4)
    assert not solution.any()
    assert np.isinf(rest).all()
