"""Flexible GMRES (Saad 1993) for several right-hand sides: each has its own Krylov space, all share a sweep.

The preconditioner may be anything, rounded or inexact: the solution is made of its very answers.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from simcore.linear_algebra.least_squares import least_squares

if TYPE_CHECKING:
    from collections.abc import Callable

    from simcore.arrays import Floats

BREAKDOWN = 1e-13  # a new direction smaller than this, relative to the vector it came from, is rounding


def gmres(
    times: Callable[[Floats], Floats],
    right: Floats,
    *,
    precondition: Callable[[Floats], Floats],
    allowed: Floats,
    max_iterations: int,
) -> tuple[Floats, Floats]:
    """Solutions (k, m) of times(z) = right (k, n), and the norms (k,) of their residuals.

    precondition: z (k, m) with times(z) near its argument (k, n); both are linear and act on each row by itself.

    Stops when no norm exceeds its `allowed` (k,), or after `max_iterations` sweeps: the caller looks at the norms. They
    are infinite if `times` gave no number.
    """
    count = len(right)
    size = np.linalg.norm(right, axis=1)
    basis = [right / np.where(size > 0.0, size, 1.0)[:, None]]
    answers: list[Floats] = []
    hessenberg = np.zeros((count, max_iterations + 1, max_iterations))
    weights, rest = np.zeros((count, 0)), size
    for j in range(max_iterations):
        if (rest <= allowed).all():
            break
        answers.append(precondition(basis[j]))
        vector = times(answers[j])
        before = np.linalg.norm(vector, axis=1)
        for i, direction in enumerate(basis):
            share = np.einsum("kn,kn->k", vector, direction)
            hessenberg[:, i, j] = share
            vector = vector - share[:, None] * direction
        after = np.linalg.norm(vector, axis=1)
        if not np.isfinite(after).all():
            return np.zeros_like(answers[0]), np.full(count, np.inf)
        after[after <= BREAKDOWN * before] = 0.0
        hessenberg[:, j + 1, j] = after
        basis.append(vector / np.where(after > 0.0, after, np.inf)[:, None])
        weights, rest = _least_squares(hessenberg[:, : j + 2, : j + 1], size)
    if not answers:
        return np.zeros_like(precondition(right)), rest
    return sum((weights[:, i, None] * answer for i, answer in enumerate(answers)), np.zeros_like(answers[0])), rest


def _least_squares(hessenberg: Floats, size: Floats) -> tuple[Floats, Floats]:
    """Weights (k, j) of the basis that minimise each residual, and its norm (k,)."""
    goal = np.zeros(hessenberg.shape[:2])
    goal[:, 0] = size
    weights = np.stack([least_squares(h, g[:, None])[:, 0] for h, g in zip(hessenberg, goal, strict=True)])
    rest = goal - np.einsum("kij,kj->ki", hessenberg, weights)
    return weights, np.linalg.norm(rest, axis=1)
