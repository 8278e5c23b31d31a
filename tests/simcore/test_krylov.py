"""GMRES for several right-hand sides: the solutions, the reported residuals, and the sizes it stops at."""

from __future__ import annotations

import numpy as np

from simcore.krylov import gmres

RNG = np.random.default_rng(11)
MATRIX = np.eye(40) + 0.3 * RNG.normal(size=(40, 40)) / np.sqrt(40.0)
RIGHT = RNG.normal(size=(3, 40))


def test_solves_to_the_allowed_residual_and_reports_it() -> None:
    solution, rest = gmres(lambda v: v @ MATRIX.T, RIGHT, allowed=np.full(3, 1e-9), max_iterations=40)
    residual = np.linalg.norm(RIGHT - solution @ MATRIX.T, axis=1)
    assert (residual <= 1e-9).all()
    assert np.abs(residual - rest).max() < 1e-12


def test_reports_what_is_left_when_the_iterations_run_out() -> None:
    solution, rest = gmres(lambda v: v @ MATRIX.T, RIGHT, allowed=np.zeros(3), max_iterations=4)
    residual = np.linalg.norm(RIGHT - solution @ MATRIX.T, axis=1)
    assert (rest > 1e-4).all()
    assert np.abs(residual - rest).max() < 1e-12


def test_a_zero_side_and_an_exhausted_space_do_no_harm() -> None:
    """A zero right-hand side stays zero; an eigenvector is solved in one iteration, whatever the others need."""
    values, vectors = np.linalg.eigh(MATRIX + MATRIX.T)
    right = np.stack([np.zeros(40), vectors[:, 0], RIGHT[0]])
    solution, rest = gmres(lambda v: v @ (MATRIX + MATRIX.T), right, allowed=np.full(3, 1e-9), max_iterations=40)
    assert not solution[0].any()
    assert np.abs(solution[1] - vectors[:, 0] / values[0]).max() < 1e-12
    assert (rest <= 1e-9).all()


def test_no_number_is_an_infinite_residual() -> None:
    solution, rest = gmres(lambda v: v * np.nan, RIGHT, allowed=np.full(3, 1e-9), max_iterations=4)
    assert not solution.any()
    assert np.isinf(rest).all()
