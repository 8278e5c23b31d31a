"""The frozen unit L0: one back-solve of SciPy's SuperLU and one pass of a plain scalar force loop. Never improve it.

Every cost of a step is given in L0, measured in the same run on the same mesh, so that a faster kernel in `simcore`
moves the figure and never the unit. Nothing here is shared with `simcore` but the mesh; a test pins the source.

Back-solve. SuperLU in symmetric mode on sum V B^T C B at rest, in double precision. METIS is not a dependency; two
orderings that need nothing but SciPy and numpy are factored and the one with fewer entries is kept, which is the one
that solves faster (a solve reads each entry once): SuperLU's minimum degree on A^T + A, and nested dissection of the
box, computed below. Entries of L + U, millions, at 918 / 1,617 / 2,600 / 5,270 nodes: minimum degree 0.36 / 1.01 / 2.26
/ 8.10, dissection 0.51 / 1.23 / 2.56 / 7.58, COLAMD 0.52 / 1.79 / 3.75 / 11.65.

Force loop. One tetrahedron after the other, exact polar rotation by Newton's method from the last rotation, in a smooth
deformation that stays: the cheapest pass there is, 82 ns a tetrahedron on a 3 GHz core (a pass that has moved by 0.1 %
takes one Newton iteration more, 112 ns). Both choices make L0 small and its multiples large.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar, cast

import numpy as np
import scipy.sparse
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

import simcore.compiled  # noqa: F401  (decides where numba keeps its cache, before numba is imported)

import numba  # isort: skip

if TYPE_CHECKING:
    from simcore.mesh.mesh import BoxMesh

Vector = NDArray[np.float64]
Indices = NDArray[np.int64]
Function = TypeVar("Function", bound=Callable[..., object])

UNIT = "L0/1"
LEAF_NODES = 4  # a piece this small is numbered as it is
BEND = 0.08  # displacement over length of the deformation in which the forces are evaluated


def _frozen_kernel(function: Function) -> Function:
    """Numba as it stood when L0 was frozen; independent of `simcore.compiled.kernel`."""
    return cast(Function, numba.njit(cache=True, error_model="numpy")(function))


class ReferenceStep:
    """L0 on one mesh. held: (k,) nodes that do not move; mu, lam: Lame parameters, Pa."""

    def __init__(self, mesh: BoxMesh, held: Indices, *, mu_pa: float, lambda_pa: float) -> None:
        self.mesh, self.mu_pa, self.lambda_pa = mesh, mu_pa, lambda_pa
        self.gradients, self.volumes_m3 = shape_gradients(mesh.nodes_m, mesh.tets)
        free = np.setdiff1d(np.arange(len(mesh.nodes_m)), held)
        matrix = _stiffness(mesh, self.gradients, self.volumes_m3, mu_pa, lambda_pa)
        self.matrix, self.factor, self.ordering = _sparsest_factor(matrix, mesh, free)
        self.right = np.random.default_rng(0).normal(size=self.matrix.shape[0])
        self.position_m = _deformed(mesh, BEND)
        self.rotations = np.tile(np.eye(3).ravel(), (len(mesh.tets), 1))
        self.forces = np.zeros_like(mesh.nodes_m)
        for _ in range(4):
            self.run()

    def run(self) -> None:
        """One L0."""
        self.solve()
        self.evaluate()

    def seconds(self, clock: Callable[[], float] = time.perf_counter) -> float:
        """How long one L0 takes now."""
        started = clock()
        self.run()
        return clock() - started

    def solve(self) -> Vector:
        """The back-solve: (unknowns,) m under a fixed load."""
        solution: Vector = self.factor.solve(self.right)
        return solution

    def evaluate(self) -> Vector:
        """The force pass: (n, 3) N."""
        material = (self.gradients, self.volumes_m3, self.mu_pa, self.lambda_pa)
        plain_forces(self.position_m, self.mesh.tets, *material, self.rotations, self.forces)
        return self.forces


def shape_gradients(nodes_m: Vector, tets: Indices) -> tuple[Vector, Vector]:
    """grad N_a (t, 4, 3) 1/m and volumes (t,) m3 of linear tetrahedra at rest."""
    edges = nodes_m[tets[:, 1:]] - nodes_m[tets[:, :1]]
    inner = np.swapaxes(np.linalg.inv(edges), 1, 2)
    gradients = np.concatenate([-inner.sum(axis=1, keepdims=True), inner], axis=1)
    return gradients, np.linalg.det(edges) / 6.0


def _deformed(mesh: BoxMesh, share: float) -> Vector:
    """(n, 3) m: the box bent sideways by `share` of its length, smoothly."""
    x = mesh.nodes_m.copy()
    across, along = x[:, 1] / mesh.size_m[1], x[:, 2] / mesh.size_m[2]
    x[:, 0] += share * mesh.size_m[0] * np.sin(np.pi * across) * np.cos(2.0 * along)
    x[:, 2] += share * mesh.size_m[2] * np.sin(np.pi * across) * along * (1.0 - along)
    return x


def _stiffness(mesh: BoxMesh, gradients: Vector, volumes: Vector, mu: float, lam: float) -> scipy.sparse.csc_array:
    """Linear stiffness (3n, 3n): K_ab = V (lam g_a g_b^T + mu g_b g_a^T + mu (g_a . g_b) I)."""
    outer = np.einsum("tai,tbj->taibj", gradients, gradients)
    dots = np.einsum("tai,tbi->tab", gradients, gradients)
    blocks = lam * outer + mu * np.swapaxes(outer, 2, 4) + mu * dots[:, :, None, :, None] * np.eye(3)[:, None, :]
    blocks *= volumes[:, None, None, None, None]
    dofs = (3 * mesh.tets[:, :, None] + np.arange(3)).reshape(-1, 12)
    rows, columns = np.repeat(dofs, 12, axis=1), np.tile(dofs, (1, 12))
    size = 3 * len(mesh.nodes_m)
    return scipy.sparse.coo_array((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=(size, size)).tocsc()


def _sparsest_factor(
    matrix: scipy.sparse.csc_array, mesh: BoxMesh, free: Indices
) -> tuple[scipy.sparse.csc_array, scipy.sparse.linalg.SuperLU, str]:
    """The matrix over the free nodes, its factor with fewer entries, and the name of the ordering."""
    found = []
    orders = {"minimum degree": (free, "MMD_AT_PLUS_A"), "dissection": (free[_dissection(mesh, free)], "NATURAL")}
    for name, (nodes, permutation) in orders.items():
        dofs = (3 * nodes[:, None] + np.arange(3)).ravel()
        part = matrix[dofs][:, dofs].tocsc()
        options = {"SymmetricMode": True}
        found.append((part, splu(part, permc_spec=permutation, diag_pivot_thresh=0.0, options=options), name))
    return min(found, key=lambda candidate: candidate[1].nnz)


def _dissection(mesh: BoxMesh, nodes: Indices) -> Indices:
    """Nested dissection of grid nodes: halves first, then the plane between them, across the longest extent."""
    grid = np.rint(mesh.nodes_m[nodes] / mesh.size_m * np.array(mesh.cells)).astype(np.int64)
    order: list[Indices] = []

    def cut(part: Indices) -> None:
        place = grid[part]
        extent = place.max(axis=0) - place.min(axis=0)
        axis = int(np.argmax(extent))
        if len(part) <= LEAF_NODES or extent[axis] < 2:
            order.append(part)
            return
        middle = (place[:, axis].max() + place[:, axis].min()) // 2
        cut(part[place[:, axis] < middle])
        cut(part[place[:, axis] > middle])
        order.append(part[place[:, axis] == middle])

    cut(np.arange(len(nodes)))
    return np.concatenate(order)


@_frozen_kernel
def plain_polar_rotation(f: Vector, r: Vector) -> bool:
    """Rotation of F = R S by Newton's method from the guess in r (9,), row-major; False if it found none."""
    for _ in range(30):
        b00 = r[0] * f[0] + r[3] * f[3] + r[6] * f[6]
        b01 = r[0] * f[1] + r[3] * f[4] + r[6] * f[7]
        b02 = r[0] * f[2] + r[3] * f[5] + r[6] * f[8]
        b10 = r[1] * f[0] + r[4] * f[3] + r[7] * f[6]
        b11 = r[1] * f[1] + r[4] * f[4] + r[7] * f[7]
        b12 = r[1] * f[2] + r[4] * f[5] + r[7] * f[8]
        b20 = r[2] * f[0] + r[5] * f[3] + r[8] * f[6]
        b21 = r[2] * f[1] + r[5] * f[4] + r[8] * f[7]
        b22 = r[2] * f[2] + r[5] * f[5] + r[8] * f[8]
        a0, a1, a2 = b21 - b12, b02 - b20, b10 - b01
        m00, m11, m22 = b11 + b22, b00 + b22, b00 + b11
        m01, m02, m12 = -0.5 * (b01 + b10), -0.5 * (b02 + b20), -0.5 * (b12 + b21)
        c00, c01, c02 = m11 * m22 - m12 * m12, m02 * m12 - m01 * m22, m01 * m12 - m02 * m11
        det = m00 * c00 + m01 * c01 + m02 * c02
        if not (m00 > 0.0 and m00 * m11 - m01 * m01 > 0.0 and det > 0.0):
            return False
        c11, c12, c22 = m00 * m22 - m02 * m02, m01 * m02 - m00 * m12, m00 * m11 - m01 * m01
        h = 0.5 / det
        w0 = h * (c00 * a0 + c01 * a1 + c02 * a2)
        w1 = h * (c01 * a0 + c11 * a1 + c12 * a2)
        w2 = h * (c02 * a0 + c12 * a1 + c22 * a2)
        square = w0 * w0 + w1 * w1 + w2 * w2
        k = 2.0 / (1.0 + square)
        e00, e11, e22 = 1.0 - k * (w1 * w1 + w2 * w2), 1.0 - k * (w0 * w0 + w2 * w2), 1.0 - k * (w0 * w0 + w1 * w1)
        e01, e10 = k * (w0 * w1 - w2), k * (w0 * w1 + w2)
        e02, e20 = k * (w0 * w2 + w1), k * (w0 * w2 - w1)
        e12, e21 = k * (w1 * w2 - w0), k * (w1 * w2 + w0)
        for i in range(0, 9, 3):
            r0, r1, r2 = r[i], r[i + 1], r[i + 2]
            r[i] = r0 * e00 + r1 * e10 + r2 * e20
            r[i + 1] = r0 * e01 + r1 * e11 + r2 * e21
            r[i + 2] = r0 * e02 + r1 * e12 + r2 * e22
        if square < 1e-20:
            return True
    return False


@_frozen_kernel
def plain_forces(
    x: Vector,
    tets: Indices,
    gradients: Vector,
    volumes: Vector,
    mu: float,
    lam: float,
    rotations: Vector,
    forces: Vector,
) -> tuple[float, float]:
    """Forces (n, 3) N that hold the tissue at x (n, 3) m, written; returns (min det F, elastic energy in J).

    Co-rotational linear elasticity. rotations: (t, 9), updated. Infinite determinant where no rotation was found.
    """
    forces[:] = 0.0
    f = np.empty(9)
    p = np.empty(9)
    least, energy = np.inf, 0.0
    for e in range(len(tets)):
        g = gradients[e]
        t = tets[e]
        for i in range(3):
            for j in range(3):
                f[3 * i + j] = x[t[0], i] * g[0, j] + x[t[1], i] * g[1, j] + x[t[2], i] * g[2, j] + x[t[3], i] * g[3, j]
        r = rotations[e]
        if not plain_polar_rotation(f, r):
            return np.inf, energy
        trace = -3.0
        strain = 0.0
        for i in range(9):
            trace += r[i] * f[i]
            strain += (f[i] - r[i]) ** 2
        for i in range(9):
            p[i] = volumes[e] * (2.0 * mu * (f[i] - r[i]) + lam * trace * r[i])
        energy += volumes[e] * (mu * strain + 0.5 * lam * trace * trace)
        for a in range(4):
            for i in range(3):
                forces[t[a], i] += p[3 * i] * g[a, 0] + p[3 * i + 1] * g[a, 1] + p[3 * i + 2] * g[a, 2]
        det = (
            f[0] * (f[4] * f[8] - f[5] * f[7]) - f[1] * (f[3] * f[8] - f[5] * f[6]) + f[2] * (f[3] * f[7] - f[4] * f[6])
        )
        least = min(least, det)
    return least, energy
