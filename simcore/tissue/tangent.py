"""The tissue's exact tangent, times vectors: stiffness with the turn of the polar rotations, inertia, damping.

With F = R S, dR = R [w] and (tr(S) I - S) w = 2 axial(R^T dF) (differentiate R^T F = S, which stays symmetric):

    dP = R (2 mu A + lambda tr(A) I + (lambda tr(S - I) - 2 mu) [w]),      A = R^T dF

It is symmetric and, under moderate compression, indefinite: it multiplies vectors and is never factored.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from simcore.compiled import kernel
from simcore.linear_algebra.entries import copy_rows

if TYPE_CHECKING:
    from simcore.arrays import Floats, Ints
    from simcore.tissue.model import Tetrahedra

Triple = tuple[float, float, float]
Matrix = tuple[Triple, Triple, Triple]  # rows


class Dynamics(NamedTuple):
    """Of a step: inertia (n,) kg/s2 per node, M (1 / dt^2 + alpha / dt), stiffness damping beta s, and dt s."""

    inertia: Floats
    beta_s: float
    dt_s: float


@kernel
def _row(m: Floats, n: Ints, i: int, g: Floats) -> Triple:
    a, b, c, d = m[n[0] + i], m[n[1] + i], m[n[2] + i], m[n[3] + i]
    return (
        a * g[0, 0] + b * g[1, 0] + c * g[2, 0] + d * g[3, 0],
        a * g[0, 1] + b * g[1, 1] + c * g[2, 1] + d * g[3, 1],
        a * g[0, 2] + b * g[1, 2] + c * g[2, 2] + d * g[3, 2],
    )


@kernel
def _gradient(m: Floats, n: Ints, g: Floats) -> Matrix:
    """sum_a m_a (x) grad N_a of a flat nodal field m; n (4,): where the four nodes stand in it."""
    return _row(m, n, 0, g), _row(m, n, 1, g), _row(m, n, 2, g)


@kernel
def _mixed(a: float, b: float, c: float, m: Matrix) -> Triple:
    p, q, r = m
    return a * p[0] + b * q[0] + c * r[0], a * p[1] + b * q[1] + c * r[1], a * p[2] + b * q[2] + c * r[2]


@kernel
def _turned_back(r: Floats, m: Matrix) -> Matrix:
    """R^T M; r (9,) row-major."""
    return _mixed(r[0], r[3], r[6], m), _mixed(r[1], r[4], r[7], m), _mixed(r[2], r[5], r[8], m)


@kernel
def _law(m: Matrix, mu: float, lam: float, spin: Triple) -> Matrix:
    """2 mu M + lambda tr(M) I + [spin]."""
    p, q, r = m
    k, t = 2.0 * mu, lam * (p[0] + q[1] + r[2])
    return (
        (k * p[0] + t, k * p[1] - spin[2], k * p[2] + spin[1]),
        (k * q[0] + spin[2], k * q[1] + t, k * q[2] - spin[0]),
        (k * r[0] - spin[1], k * r[1] + spin[0], k * r[2] + t),
    )


@kernel
def _spun(w: Triple, m: Matrix) -> Matrix:
    """[w] M."""
    return _mixed(0.0, -w[2], w[1], m), _mixed(w[2], 0.0, -w[0], m), _mixed(-w[1], w[0], 0.0, m)


@kernel
def _added(a: float, m: Matrix, b: float, n: Matrix) -> Matrix:
    """Sum a M + b N."""
    (p, q, r), (u, v, w) = m, n
    return (
        (a * p[0] + b * u[0], a * p[1] + b * u[1], a * p[2] + b * u[2]),
        (a * q[0] + b * v[0], a * q[1] + b * v[1], a * q[2] + b * v[2]),
        (a * r[0] + b * w[0], a * r[1] + b * w[1], a * r[2] + b * w[2]),
    )


@kernel
def _symmetric(m: Matrix) -> Matrix:
    p, q, r = m
    xy, xz, yz = 0.5 * (p[1] + q[0]), 0.5 * (p[2] + r[0]), 0.5 * (q[2] + r[1])
    return (p[0], xy, xz), (xy, q[1], yz), (xz, yz, r[2])


@kernel
def _turn_matrix(s: Matrix) -> Matrix:
    """(tr(S) I - S)^-1 of the symmetric stretch S."""
    p, q, r = s
    m00, m11, m22, m01, m02, m12 = q[1] + r[2], p[0] + r[2], p[0] + q[1], -p[1], -p[2], -q[2]
    c00, c01, c02 = m11 * m22 - m12 * m12, m02 * m12 - m01 * m22, m01 * m12 - m02 * m11
    h = 1.0 / (m00 * c00 + m01 * c01 + m02 * c02)
    c11, c12, c22 = m00 * m22 - m02 * m02, m01 * m02 - m00 * m12, m00 * m11 - m01 * m01
    return (h * c00, h * c01, h * c02), (h * c01, h * c11, h * c12), (h * c02, h * c12, h * c22)


@kernel
def _spin(turn: Matrix, a: Matrix) -> Triple:
    """Spin w of dR = R [w] for A = R^T dF."""
    p, q, r = a
    return _mixed(r[1] - q[2], p[2] - r[0], q[0] - p[1], turn)


@kernel
def _damping_change(a: Matrix, w: Triple, rate: Matrix, mu: float, lam: float, dt: float) -> Matrix:
    """R^T d(R sigma) with sigma = 2 mu eps + lambda tr(eps) I, eps = sym(rate), rate = R^T grad (x - x_old) / dt."""
    still = (0.0, 0.0, 0.0)
    change = _added(1.0 / dt, a, -1.0, _spun(w, rate))
    sigma = _law(_symmetric(rate), mu, lam, still)
    return _added(1.0, _spun(w, sigma), 1.0, _law(_symmetric(change), mu, lam, still))


@kernel
def _scatter(r: Floats, stress: Matrix, volume: float, g: Floats, n: Ints, out: Floats) -> None:
    """Add to out V R stress grad N_a at the four nodes."""
    for i in range(3):
        p = _mixed(volume * r[3 * i], volume * r[3 * i + 1], volume * r[3 * i + 2], stress)
        for a in range(4):
            out[n[a] + i] += p[0] * g[a, 0] + p[1] * g[a, 1] + p[2] * g[a, 2]


@kernel
def tangent_times(
    moves: Floats,
    x: Floats,
    x_old: Floats,
    tetrahedra: Tetrahedra,
    rotations: Floats,
    unknown: Ints,
    dynamics: Dynamics,
) -> Floats:
    """(k, unknowns) N = d(f_tissue + M a + C v) / dx times moves (k, unknowns) m of the free nodes, at x (n, 3) m.

    rotations: (t, 9) the polar rotations at x. The velocity is (x - x_old) / dt, backward Euler.
    """
    tets, gradients, volumes, mu, lam = tetrahedra
    inertia, beta, dt = dynamics
    count, held = moves.shape
    out, padded = np.zeros((count, held + 3)), np.zeros((count, held + 3))  # the last three: every held node
    copy_rows(moves, padded)
    for node in range(len(unknown)):
        for i in range(3):
            if unknown[node] >= 0:
                column = 3 * unknown[node] + i
                for j in range(count):
                    out[j, column] = inertia[node] * moves[j, column]
    flat, past = x.ravel(), x_old.ravel()
    n = np.empty(4, np.int64)
    for e in range(len(tets)):
        r, g = rotations[e], gradients[e]
        f = _gradient(flat, 3 * tets[e], g)
        s = _turned_back(r, f)
        turn = _turn_matrix(s)
        k = lam * (s[0][0] + s[1][1] + s[2][2] - 3.0) - 2.0 * mu
        rate = s
        if beta > 0.0:
            rate = _turned_back(r, _added(1.0 / dt, f, -1.0 / dt, _gradient(past, 3 * tets[e], g)))
        for a in range(4):
            n[a] = 3 * unknown[tets[e, a]] if unknown[tets[e, a]] >= 0 else held
        for j in range(count):
            change = _turned_back(r, _gradient(padded[j], n, g))
            w = _spin(turn, change)
            stress = _law(change, mu, lam, (k * w[0], k * w[1], k * w[2]))
            if beta > 0.0:
                stress = _added(1.0, stress, beta, _damping_change(change, w, rate, mu, lam, dt))
            _scatter(r, stress, volumes[e], g, n, out[j])
    return out[:, :held].copy()
