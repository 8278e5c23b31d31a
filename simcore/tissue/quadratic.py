"""Linear elasticity at rest on quadratic tetrahedra over the same mesh: what the linear ones are measured against.

Quadratic tetrahedra contain the linear ones, so under any load they give way at least as much; on a mesh that linear
ones leave 10 to 30 % too stiff they are within 1 to 3 % (tests/simcore/contact/test_line.py).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from simcore.compiled import kernel
from simcore.linear_algebra.band import empty_band, factor_band, solve_band
from simcore.linear_algebra.products import dot, norm
from simcore.tissue.model import TissueModel, assemble_band

if TYPE_CHECKING:
    from collections.abc import Callable

    from simcore.arrays import Flags, Floats, Ints

CORNERS = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])  # of the edges that carry the nodes 4 to 9
GAUSS = (0.5854101966249685, 0.1381966011250105)  # barycentric coordinates of four points, exact to degree 2
TOLERANCE = 1e-9  # of the residual, relative to the load
MAX_ITERATIONS = 2000


@dataclass(frozen=True)
class QuadraticTissue:
    """edges: (e, 2) corner nodes of each midside node, which are numbered after the n corners. tets: (t, 10). held:
    (n + e,). All else is in the linear tissue."""

    linear: TissueModel
    edges: Ints
    tets: Ints
    held: Flags

    @classmethod
    def of(cls, linear: TissueModel) -> QuadraticTissue:
        """Over the same mesh; a midside node is held if both of its corners are."""
        corners = linear.mesh.tets
        pairs = np.sort(corners[:, CORNERS].reshape(-1, 2), axis=1)
        edges, numbers = np.unique(pairs, axis=0, return_inverse=True)
        midside = len(linear.mesh.nodes_m) + numbers.reshape(len(corners), 6)
        held = linear.unknown < 0
        return cls(linear, edges, np.hstack([corners, midside]), np.concatenate([held, held[edges].all(axis=1)]))

    def prolonged(self, corners: Floats) -> Floats:
        """(n + e, 3): the linear field with these nodal values (n, 3), in the quadratic nodes."""
        return np.concatenate([corners, 0.5 * (corners[self.edges[:, 0]] + corners[self.edges[:, 1]])])

    def restricted(self, load: Floats) -> Floats:
        """(n, 3): what a load (n + e, 3) is on the linear nodes; the transpose of `prolonged`."""
        n = len(self.linear.mesh.nodes_m)
        corners = load[:n].copy()
        for end in range(2):
            np.add.at(corners, self.edges[:, end], 0.5 * load[n:])
        return corners

    def held_back(self, load: Floats) -> Floats:
        """The load (n + e, 3) without what acts on held nodes."""
        free = load.copy()
        free[self.held] = 0.0
        return free

    def stiffness_times(self, moves: Floats) -> Floats:
        """(n + e, 3) N: K u for moves u (n + e, 3) m, which must be 0 in held nodes."""
        t = self.linear
        out = np.zeros_like(moves)
        add_quadratic_forces(self.tets, t.gradients, t.volumes_m3, t.mu_pa, t.lambda_pa, moves, out)
        return self.held_back(out)

    def diagonal(self) -> Floats:
        """(n + e, 3) N/m: of K; 1 in held nodes."""
        t = self.linear
        out = np.zeros((len(self.held), 3))
        add_quadratic_diagonal(self.tets, t.gradients, t.volumes_m3, t.mu_pa, t.lambda_pa, out)
        out[self.held] = 1.0
        return out

    def solve(self, load: Floats) -> tuple[Floats, Floats]:
        """Moves under a load (n + e, 3) N: of the quadratic tissue (n + e, 3) m, and of the linear one in the same
        nodes.

        Conjugate gradients with the diagonal and the linear tissue's factor as preconditioner (two levels); the linear
        answer by iterative refinement with that factor alone. Raises ArithmeticError where it does not converge.
        """
        load, coarse, diagonal = self.held_back(load), _linear_solver(self), self.diagonal()
        linear = np.zeros_like(load)
        for _ in range(4):
            linear += coarse(load - self.stiffness_times(linear))
        moves, rest = linear.copy(), load - self.stiffness_times(linear)
        better = rest / diagonal + coarse(rest)
        along, size = better.copy(), dot(rest, better)
        for _ in range(MAX_ITERATIONS):
            if norm(rest) <= TOLERANCE * norm(load):
                return moves, linear
            force = self.stiffness_times(along)
            share = size / dot(along, force)
            moves += share * along
            rest -= share * force
            better = rest / diagonal + coarse(rest)
            before, size = size, dot(rest, better)
            along = better + (size / before) * along
        raise ArithmeticError(f"the quadratic reference did not converge in {MAX_ITERATIONS} iterations")


def _linear_solver(quadratic: QuadraticTissue) -> Callable[[Floats], Floats]:
    """P A^-1 P^T of a load (n + e, 3) N, by the banded factor of the linear tissue at rest, in single precision."""
    t = quadratic.linear
    factor = empty_band(t.unknowns, t.band)
    still = np.tile(np.eye(3).ravel(), (len(t.mesh.tets), 1))
    assemble_band(t.tetrahedra, still, t.unknown, 1.0, np.zeros(len(t.unknown)), factor)
    if factor_band(factor) > 0:
        raise ArithmeticError("the tissue at rest is not positive definite: nothing holds it")
    free = np.flatnonzero(t.unknown >= 0)

    def solve(load: Floats) -> Floats:
        right = np.zeros((t.unknowns // 3, 3))
        right[t.unknown[free]] = quadratic.restricted(load)[free]
        scale = float(np.abs(right).max()) or 1.0
        answer = (right / scale).reshape(1, -1).astype(np.float32)
        solve_band(factor, answer)
        moves = np.zeros((len(t.unknown), 3))
        moves[free] = scale * answer.astype(float).reshape(-1, 3)[t.unknown[free]]
        return quadratic.held_back(quadratic.prolonged(moves))

    return solve


def quadratic_shapes(linear: Floats) -> Floats:
    """(k, 10) quadratic shape functions where the linear ones are (k, 4)."""
    return np.hstack([linear * (2.0 * linear - 1.0), 4.0 * linear[:, CORNERS[:, 0]] * linear[:, CORNERS[:, 1]]])


@kernel
def quadratic_gradients(gradients: Floats, point: int, out: Floats) -> None:
    """Write out (10, 3): gradients of the quadratic shapes at one of the four Gauss points of a tetrahedron, whose
    linear ones have `gradients` (4, 3)."""
    place = np.full(4, GAUSS[1])
    place[point] = GAUSS[0]
    for a in range(4):
        for i in range(3):
            out[a, i] = (4.0 * place[a] - 1.0) * gradients[a, i]
    for edge in range(6):
        a, b = CORNERS[edge, 0], CORNERS[edge, 1]
        for i in range(3):
            out[4 + edge, i] = 4.0 * (place[a] * gradients[b, i] + place[b] * gradients[a, i])


@kernel
def add_quadratic_forces(
    tets: Ints, gradients: Floats, volumes: Floats, mu: float, lam: float, moves: Floats, out: Floats
) -> None:
    """Add K u to out (n, 3) N: sum over Gauss points of V / 4 (lambda tr e I + 2 mu e) grad N_a, e = sym grad u."""
    shape, strain = np.empty((10, 3)), np.empty((3, 3))
    for t in range(len(tets)):
        for point in range(4):
            quadratic_gradients(gradients[t], point, shape)
            for i in range(3):
                for j in range(3):
                    strain[i, j] = 0.0
                    for a in range(10):
                        node = tets[t, a]
                        strain[i, j] += 0.5 * (moves[node, i] * shape[a, j] + moves[node, j] * shape[a, i])
            pressure = lam * (strain[0, 0] + strain[1, 1] + strain[2, 2])
            weight = 0.25 * volumes[t]
            for a in range(10):
                for i in range(3):
                    force = pressure * shape[a, i]
                    for j in range(3):
                        force += 2.0 * mu * strain[i, j] * shape[a, j]
                    out[tets[t, a], i] += weight * force


@kernel
def add_quadratic_diagonal(tets: Ints, gradients: Floats, volumes: Floats, mu: float, lam: float, out: Floats) -> None:
    """Add the diagonal of K to out (n, 3) N/m."""
    shape = np.empty((10, 3))
    for t in range(len(tets)):
        for point in range(4):
            quadratic_gradients(gradients[t], point, shape)
            for a in range(10):
                square = shape[a, 0] ** 2 + shape[a, 1] ** 2 + shape[a, 2] ** 2
                for i in range(3):
                    out[tets[t, a], i] += 0.25 * volumes[t] * (mu * square + (mu + lam) * shape[a, i] ** 2)
