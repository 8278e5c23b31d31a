"""Elastic forces of all tetrahedra, fast: blocks of 64 in a structure of arrays, so that the loop becomes SIMD code.

Same equations as `tissue.elastic_forces`, which is the plain form and the reference in the tests. Three rules keep the
vectoriser going: one flat array with constant strides, unsigned indices (a negative index would wrap around), and a
fixed number of Newton iterations on the rotation. What goes from or to the nodes has a loop of its own. The few
tetrahedra that need more iterations are finished by the plain form.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from simcore.compiled import inlined, kernel
from simcore.linear_algebra.entries import all_finite
from simcore.tissue.model import Tetrahedra, TissueModel, cold_polar_rotation, polar_rotation, rotated_stiffness_times

if TYPE_CHECKING:
    from simcore.arrays import Floats, Ints

Corners = NDArray[np.uint32]

LANES = 64
ROWS = 30  # of a block: F 0-8, R 9-17, P 18-26, volume 27, last squared rotation increment 28, det F 29
EXACT = 1e-20  # squared increment below which the next one would be below rounding: Newton converges quadratically


class Blocks(NamedTuple):
    """What kernels know of them: corners (b, 4, LANES), gradients (b, 9, LANES) 1/m, the flat state, and the elements
    one by one."""

    corners: Corners
    gradients: Floats
    state: Floats
    tetrahedra: Tetrahedra


def in_blocks(tets: Ints, gradients: Floats) -> tuple[Corners, Floats]:
    """Corners (b, 4, LANES), gradients (b, 9, LANES) of tets (t, 4), gradients (t, 4, 3); filled up with the first."""
    corners, nine = (_blocked(rows) for rows in (tets, gradients[:, 1:].reshape(len(tets), 9)))
    return corners.astype(np.uint32), nine


def _blocked(rows: NDArray[Any]) -> NDArray[Any]:
    """(t, k) -> (blocks, k, LANES)."""
    padded = np.concatenate([rows, np.repeat(rows[:1], -len(rows) % LANES, axis=0)])
    return np.ascontiguousarray(padded.reshape(-1, LANES, rows.shape[1]).transpose(0, 2, 1))


class ForceBlocks:
    """Work arrays of one tissue: its tetrahedra in blocks, and their last rotations (the warm start)."""

    def __init__(self, model: TissueModel) -> None:
        self.model = model
        count = len(model.mesh.tets)
        self.count, self.blocks = count, -(-count // LANES)
        self.corners, self.gradients = in_blocks(model.mesh.tets, model.gradients)
        state = np.zeros((self.blocks, ROWS, LANES))
        state[:, 9:18] = np.eye(3).reshape(1, 9, 1)
        state[:, 27] = np.concatenate([model.volumes_m3, np.zeros(self.blocks * LANES - count)]).reshape(-1, LANES)
        self.state = state.ravel()
        self.arrays = Blocks(self.corners, self.gradients, self.state, model.tetrahedra)

    def rotations(self) -> Floats:
        """(t, 9) row-major polar rotations at the last evaluation."""
        blocks = self.state.reshape(self.blocks, ROWS, LANES)[:, 9:18]
        return np.ascontiguousarray(blocks.transpose(0, 2, 1).reshape(-1, 9)[: self.count])

    def set_rotations(self, rotations: Floats) -> None:
        """Restore the warm start from `rotations()`."""
        padded = np.concatenate([rotations, np.tile(np.eye(3).ravel(), (self.blocks * LANES - self.count, 1))])
        blocks = self.state.reshape(self.blocks, ROWS, LANES)
        blocks[:, 9:18] = padded.reshape(self.blocks, LANES, 9).transpose(0, 2, 1)

    def evaluate(self, x: Floats, forces: Floats) -> float:
        """Forces that hold the tissue at x (n, 3) m, written to forces (n, 3) N; returns min det F."""
        return block_forces(x, self.arrays, forces)


@kernel
def block_forces(x: Floats, blocks: Blocks, forces: Floats) -> float:
    """Write forces (n, 3) N that hold the tissue at x (n, 3) m; returns min det F."""
    corners, gradients, state, tetrahedra = blocks
    gather_gradients(x, corners, gradients, state)
    rotate_and_stress(state, len(corners), tetrahedra.mu_pa, tetrahedra.lambda_pa)
    finish_rotations(state, len(corners), tetrahedra.mu_pa, tetrahedra.lambda_pa)
    return scatter_forces(state, corners, gradients, forces)


@kernel
def damping_forces(x: Floats, x_old: Floats, dt_s: float, blocks: Blocks, out: Floats) -> None:
    """Write out (n, 3) N s/m = sum R_e K_e R_e^T v, v the velocity since x_old and R_e of the last evaluation."""
    tets, gradients, volumes, mu, lam = blocks.tetrahedra
    rotations = np.empty((len(tets), 9))
    for t in range(len(tets)):
        start = t // LANES * ROWS * LANES + t % LANES
        for k in range(9):
            rotations[t, k] = blocks.state[start + (9 + k) * LANES]
    rotated_stiffness_times((x - x_old) / dt_s, tets, gradients, volumes, mu, lam, rotations, out)


@kernel
def gather_gradients(x: Floats, corners: Corners, gradients: Floats, state: Floats) -> None:
    """Rows F = sum_a (x_a - x_0) (x) grad N_a of each tetrahedron."""
    edges = np.empty((9, LANES))
    for b in range(len(corners)):
        start = b * ROWS * LANES
        f = state[start : start + 9 * LANES].reshape(9, LANES)
        gradients_of_block(x, corners[b], gradients[b], edges, f)


@kernel
def gradients_of_block(x: Floats, t: Corners, g: Floats, edges: Floats, f: Floats) -> None:
    """Write f (9, LANES), the deformation gradients of one block: corners t (4, LANES), gradients g (9, LANES) at rest;
    edges (9, LANES) is for its own use."""
    for lane in range(LANES):
        n0, n1, n2, n3 = t[0, lane], t[1, lane], t[2, lane], t[3, lane]
        for i in range(3):
            x0 = x[n0, i]
            edges[i, lane] = x[n1, i] - x0
            edges[3 + i, lane] = x[n2, i] - x0
            edges[6 + i, lane] = x[n3, i] - x0
    for i in range(3):
        for j in range(3):
            for lane in range(LANES):
                first, second, third = edges[i, lane], edges[3 + i, lane], edges[6 + i, lane]
                f[3 * i + j, lane] = first * g[j, lane] + second * g[3 + j, lane] + third * g[6 + j, lane]


@inlined
def newton_rotation(f: tuple[float, ...], r: tuple[float, ...]) -> tuple[tuple[float, ...], float]:
    """One Newton iteration R <- R cay(w) of `tissue.polar_rotation` on nine scalars each; infinite increment where the
    guess is not near the maximum of tr(R^T F)."""
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
    c11, c12, c22 = m00 * m22 - m02 * m02, m01 * m02 - m00 * m12, m00 * m11 - m01 * m01
    det = m00 * c00 + m01 * c01 + m02 * c02
    h = 0.5 / det
    w0, w1, w2 = (
        h * (c00 * a0 + c01 * a1 + c02 * a2),
        h * (c01 * a0 + c11 * a1 + c12 * a2),
        h * (c02 * a0 + c12 * a1 + c22 * a2),
    )
    square = w0 * w0 + w1 * w1 + w2 * w2
    k = 2.0 / (1.0 + square)
    e00, e11, e22 = 1.0 - k * (w1 * w1 + w2 * w2), 1.0 - k * (w0 * w0 + w2 * w2), 1.0 - k * (w0 * w0 + w1 * w1)
    e01, e10 = k * (w0 * w1 - w2), k * (w0 * w1 + w2)
    e02, e20 = k * (w0 * w2 + w1), k * (w0 * w2 - w1)
    e12, e21 = k * (w1 * w2 - w0), k * (w1 * w2 + w0)
    turned = (
        r[0] * e00 + r[1] * e10 + r[2] * e20,
        r[0] * e01 + r[1] * e11 + r[2] * e21,
        r[0] * e02 + r[1] * e12 + r[2] * e22,
        r[3] * e00 + r[4] * e10 + r[5] * e20,
        r[3] * e01 + r[4] * e11 + r[5] * e21,
        r[3] * e02 + r[4] * e12 + r[5] * e22,
        r[6] * e00 + r[7] * e10 + r[8] * e20,
        r[6] * e01 + r[7] * e11 + r[8] * e21,
        r[6] * e02 + r[7] * e12 + r[8] * e22,
    )
    return turned, (square if (m00 > 0.0) & (c22 > 0.0) & (det > 0.0) else np.inf)


@kernel
def rotate_and_stress(state: Floats, blocks: int, mu: float, lam: float) -> None:
    """Rows R, P, increment and det F from the rows F and R: two Newton iterations, then V P (V the volume)."""
    # P = 2 mu (F - R) + lambda tr(R^T F - I) R, written as m F + q R so that each entry is two products and one sum.
    # R starts from that of the last evaluation; two Newton iterations settle it in almost every tetrahedron of a step,
    # `finish_rotations` does the rest. A fixed number and no branch: the compiler makes eight lanes one instruction.
    lanes = np.uint64(LANES)
    for block in range(blocks):
        base = np.uint64(block) * np.uint64(ROWS * LANES)
        for counter in range(LANES):
            at = base + np.uint64(counter)
            f = (
                state[at],
                state[at + lanes],
                state[at + np.uint64(2 * LANES)],
                state[at + np.uint64(3 * LANES)],
                state[at + np.uint64(4 * LANES)],
                state[at + np.uint64(5 * LANES)],
                state[at + np.uint64(6 * LANES)],
                state[at + np.uint64(7 * LANES)],
                state[at + np.uint64(8 * LANES)],
            )
            guess: tuple[float, ...] = (
                state[at + np.uint64(9 * LANES)],
                state[at + np.uint64(10 * LANES)],
                state[at + np.uint64(11 * LANES)],
                state[at + np.uint64(12 * LANES)],
                state[at + np.uint64(13 * LANES)],
                state[at + np.uint64(14 * LANES)],
                state[at + np.uint64(15 * LANES)],
                state[at + np.uint64(16 * LANES)],
                state[at + np.uint64(17 * LANES)],
            )
            guess, _ = newton_rotation(f, guess)
            r, square = newton_rotation(f, guess)
            volume = state[at + np.uint64(27 * LANES)]
            trace = (
                r[0] * f[0] + r[1] * f[1] + r[2] * f[2] + r[3] * f[3] + r[4] * f[4]
                + r[5] * f[5] + r[6] * f[6] + r[7] * f[7] + r[8] * f[8] - 3.0
            )  # fmt: skip
            m = 2.0 * mu * volume
            q = volume * lam * trace - m
            state[at + np.uint64(9 * LANES)] = r[0]
            state[at + np.uint64(10 * LANES)] = r[1]
            state[at + np.uint64(11 * LANES)] = r[2]
            state[at + np.uint64(12 * LANES)] = r[3]
            state[at + np.uint64(13 * LANES)] = r[4]
            state[at + np.uint64(14 * LANES)] = r[5]
            state[at + np.uint64(15 * LANES)] = r[6]
            state[at + np.uint64(16 * LANES)] = r[7]
            state[at + np.uint64(17 * LANES)] = r[8]
            state[at + np.uint64(18 * LANES)] = m * f[0] + q * r[0]
            state[at + np.uint64(19 * LANES)] = m * f[1] + q * r[1]
            state[at + np.uint64(20 * LANES)] = m * f[2] + q * r[2]
            state[at + np.uint64(21 * LANES)] = m * f[3] + q * r[3]
            state[at + np.uint64(22 * LANES)] = m * f[4] + q * r[4]
            state[at + np.uint64(23 * LANES)] = m * f[5] + q * r[5]
            state[at + np.uint64(24 * LANES)] = m * f[6] + q * r[6]
            state[at + np.uint64(25 * LANES)] = m * f[7] + q * r[7]
            state[at + np.uint64(26 * LANES)] = m * f[8] + q * r[8]
            state[at + np.uint64(28 * LANES)] = square
            state[at + np.uint64(29 * LANES)] = (
                f[0] * (f[4] * f[8] - f[5] * f[7])
                - f[1] * (f[3] * f[8] - f[5] * f[6])
                + f[2] * (f[3] * f[7] - f[4] * f[6])
            )


@kernel
def finish_rotations(state: Floats, blocks: int, mu: float, lam: float) -> None:
    """Iterate to the end, from the singular value decomposition if need be, where two iterations were not enough."""
    f, r = np.empty(9), np.empty(9)
    for block in range(blocks):
        start = block * ROWS * LANES
        for lane in range(LANES):
            if state[start + 28 * LANES + lane] < EXACT:
                continue
            for k in range(9):
                f[k] = state[start + k * LANES + lane]
                r[k] = state[start + (9 + k) * LANES + lane]
            if not (all_finite(r) and polar_rotation(f, r)):
                if not all_finite(f):
                    continue
                cold_polar_rotation(f, r)
            volume, trace = state[start + 27 * LANES + lane], -3.0
            for k in range(9):
                trace += r[k] * f[k]
            for k in range(9):
                state[start + (9 + k) * LANES + lane] = r[k]
                stress = 2.0 * mu * (f[k] - r[k]) + lam * trace * r[k]
                state[start + (18 + k) * LANES + lane] = volume * stress


@kernel
def scatter_forces(state: Floats, corners: Corners, gradients: Floats, forces: Floats) -> float:
    """Write forces (n, 3) = sum V P grad N_a, N; returns min det F."""
    forces[:] = 0.0
    f = np.empty((9, LANES))
    least = np.inf
    for b in range(len(corners)):
        t, g = corners[b], gradients[b]
        start = b * ROWS * LANES
        p = state[start + 18 * LANES : start + 27 * LANES].reshape(9, LANES)
        for i in range(3):
            for a in range(3):
                for lane in range(LANES):
                    p0, p1, p2 = p[3 * i, lane], p[3 * i + 1, lane], p[3 * i + 2, lane]
                    f[3 * a + i, lane] = p0 * g[3 * a, lane] + p1 * g[3 * a + 1, lane] + p2 * g[3 * a + 2, lane]
        for lane in range(LANES):
            n0, n1, n2, n3 = t[0, lane], t[1, lane], t[2, lane], t[3, lane]
            for i in range(3):
                f1, f2, f3 = f[i, lane], f[3 + i, lane], f[6 + i, lane]
                forces[n1, i] += f1
                forces[n2, i] += f2
                forces[n3, i] += f3
                forces[n0, i] -= f1 + f2 + f3
            least = min(least, state[start + 29 * LANES + lane])
    return least
