"""The tissue's factor, kept from step to step, and its compliance at the constraint points.

The factor belongs to an EARLIER configuration, often the rest one: the coupled solve iterates on the true residual, so
a stale factor costs iterations, never accuracy. For the same reason single precision is enough for it, at half the
memory traffic. Columns A^-1 B^T are kept with it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from simcore.compiled import kernel
from simcore.linear_algebra.band import empty_band, factor_band, solve_band
from simcore.tissue.model import TissueModel, assemble_band

if TYPE_CHECKING:
    from simcore.arrays import Floats, Ints, Singles
    from simcore.contact.ball import Balls
    from simcore.contact.channel import Channel

TIP_COLUMN_REUSE_M = 0.5e-3  # the channel end may move so far before its columns are computed anew


def inertia(tissue: TissueModel, dt_s: float) -> Floats:
    """(n,) kg/s2: M (1 / dt^2 + alpha / dt) of each node."""
    diagonal: Floats = tissue.masses_kg * (1.0 / dt_s**2 + tissue.mass_damping_per_s / dt_s)
    return diagonal


def solve_factored(factor: Singles, right: Floats | Singles) -> Singles:
    """A^-1 right, (unknowns,) or (k, unknowns), in single precision, by a banded Cholesky factor of A; a diverging step
    overflows to infinity."""
    with np.errstate(over="ignore", invalid="ignore"):
        solution: Singles = np.array(right, np.float32, order="C")
    solve_band(factor, np.atleast_2d(solution))
    return solution


class NotPositiveDefiniteError(ArithmeticError):
    """The matrix to be factored is not positive definite: nothing holds the tissue."""


class Compliance:
    """Banded Cholesky factor of A = (1 + beta / dt) sum R_e K_e R_e^T + M (1 / dt^2 + alpha / dt); columns of A^-1."""

    def __init__(self, tissue: TissueModel, dt_s: float, capacity: int) -> None:
        self.tissue = tissue
        self.scale = 1.0 + tissue.stiffness_damping_s / dt_s
        self.diagonal = inertia(tissue, dt_s)
        self.columns = np.zeros((capacity, 3, tissue.unknowns), np.float32)
        self.column_rest_m = np.full((capacity, 3), np.nan)
        self.between_points = np.zeros((3 * capacity, 3 * capacity))
        self.refactor(np.tile(np.eye(3).ravel(), (len(tissue.mesh.tets), 1)))

    def refactor(self, rotations: Floats) -> None:
        """Factor at the present rotations (t, 9); forgets every column. Raises NotPositiveDefiniteError."""
        t = self.tissue
        band = empty_band(t.unknowns, t.band)
        assemble_band(t.tetrahedra, rotations, t.unknown, self.scale, self.diagonal, band)
        if (row := factor_band(band)) > 0:
            raise NotPositiveDefiniteError(f"the stiffness is not positive definite in row {row}")
        self.factor = band
        self.column_rest_m[:] = np.nan
        self.rotations = rotations.copy()

    def turned_by(self, rotations: Floats) -> float:
        """Largest change of an entry of any element's rotation, (t, 9), since the factor was made."""
        return float(np.abs(rotations - self.rotations).max())

    def solve(self, right: Floats | Singles) -> Singles:
        """A^-1 right, (unknowns,) or (k, unknowns), in single precision; a diverging step overflows to infinity."""
        return solve_factored(self.factor, right)

    def sync(self, channel: Channel) -> None:
        """Bring columns and the compliance between points (3P, 3P) m/N up to date with the channel's elements."""
        stale, balls = self._stale(channel), channel.balls
        for j in stale:
            self._compute_columns(channel, j)
        for j in [*stale, 0]:
            compliance_rows(j, channel.count, balls, self.tissue.unknown, self.columns, self.between_points)

    def _stale(self, channel: Channel) -> list[int]:
        """Created elements that are not where their columns were computed, the channel end last."""
        n = channel.count
        moved = np.abs(self.column_rest_m[:n] - channel.rest_m[:n]).max(axis=1)
        kept = moved <= np.where(np.arange(n) == 0, TIP_COLUMN_REUSE_M, 0.0)
        return [int(j) for j in np.flatnonzero(channel.created[:n] & ~kept)[::-1]]

    def _compute_columns(self, channel: Channel, element: int) -> None:
        right = np.zeros((3, self.tissue.unknowns), np.float32)
        for k in range(channel.touched[element]):
            rank = self.tissue.unknown[channel.nodes[element, k]]
            if rank >= 0:
                for i in range(3):
                    right[i, 3 * rank + i] += channel.weights[element, k]
        self.columns[element] = self.solve(right)
        self.column_rest_m[element] = channel.rest_m[element]


@kernel
def compliance_rows(element: int, count: int, balls: Balls, unknown: Ints, columns: Singles, between: Floats) -> None:
    """Displacement of one element's ball under unit forces on every element: its rows of `between`, and by symmetry."""
    _, nodes, weights, touched = balls
    for j in range(count):
        for b in range(3):
            for a in range(3):
                value = 0.0
                for k in range(touched[element]):
                    rank = unknown[nodes[element, k]]
                    if rank >= 0:
                        value += weights[element, k] * columns[j, b, 3 * rank + a]
                between[3 * element + a, 3 * j + b] = value
                between[3 * j + b, 3 * element + a] = value


@kernel
def add_columns(elements: Ints, columns: Singles, change: Floats, moves: Singles) -> None:
    """Add to moves (unknowns,) m what the change (a, 3) N of the forces on the elements (a,) does to the tissue."""
    for i in range(len(elements)):
        first, second, third = columns[elements[i], 0], columns[elements[i], 1], columns[elements[i], 2]
        x, y, z = np.float32(change[i, 0]), np.float32(change[i, 1]), np.float32(change[i, 2])
        for k in range(len(moves)):
            moves[k] += x * first[k] + y * second[k] + z * third[k]
