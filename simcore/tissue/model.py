"""Soft tissue: linear tetrahedra with co-rotational linear elasticity, lumped mass and Rayleigh damping.

Per tetrahedron, F = sum_a x_a (x) grad N_a, F = R S with R the exact polar rotation, and

    P = 2 mu (F - R) + lambda tr(R^T F - I) R,      f_a = -V P grad N_a            (Mueller & Gross 2004; McAdams 2011)

The matrix that is factored is sum R_e K_e R_e^T (+ mass, damping): positive semi-definite, unlike the exact tangent.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from simcore.compiled import kernel
from simcore.linear_algebra.dense import add_product
from simcore.linear_algebra.singular_values import nearest_rotation
from simcore.mesh.edges import edge_inverses
from simcore.mesh.numbering import free_node_order, half_bandwidth

if TYPE_CHECKING:
    from simcore.arrays import Floats, Ints, Singles
    from simcore.mesh.mesh import Mesh

POLAR_ITERATIONS = 30


class Tetrahedra(NamedTuple):
    """What kernels know of the elements: tets (t, 4), gradients (t, 4, 3) 1/m, volumes (t,) m3, mu and lambda."""

    tets: Ints
    gradients: Floats
    volumes_m3: Floats
    mu_pa: float
    lambda_pa: float


@dataclass(frozen=True)
class Material:
    """Linear elasticity, mass, and Rayleigh damping C = alpha M + beta K; without mass and damping = quasi-static."""

    young_pa: float
    poisson: float
    density_kg_m3: float = 0.0
    rayleigh_mass_per_s: float = 0.0  # alpha
    rayleigh_stiffness_s: float = 0.0  # beta


@dataclass(frozen=True)
class TissueModel:
    """Geometry and material of the tissue: everything that a run never changes. SI units.

    gradients: (t, 4, 3) 1/m, grad N_a of each tetrahedron at rest. volumes_m3: (t,). masses_kg: (n,) lumped.
    unknown: (n,) position of a node among the free nodes in the order of the factor, -1 if held. band: half-bandwidth
    in degrees of freedom.
    """

    mesh: Mesh
    mu_pa: float
    lambda_pa: float
    mass_damping_per_s: float
    stiffness_damping_s: float
    gradients: Floats
    volumes_m3: Floats
    masses_kg: Floats
    unknown: Ints
    band: int

    @cached_property
    def unknowns(self) -> int:
        """Degrees of freedom that are not held."""
        return 3 * int(np.count_nonzero(self.unknown >= 0))

    @cached_property
    def tetrahedra(self) -> Tetrahedra:
        """The elements, for kernels."""
        return Tetrahedra(self.mesh.tets, self.gradients, self.volumes_m3, self.mu_pa, self.lambda_pa)

    @classmethod
    def of(cls, mesh: Mesh, held: Ints, material: Material) -> TissueModel:
        """A body of this material in the shape of `mesh`, its nodes `held` (k,) held."""
        gradients, volumes = shape_gradients(mesh.nodes_m, mesh.tets)
        unknown = free_node_order(mesh, held)
        young, poisson = material.young_pa, material.poisson
        return cls(
            mesh=mesh,
            mu_pa=young / (2 * (1 + poisson)),
            lambda_pa=young * poisson / ((1 + poisson) * (1 - 2 * poisson)),
            mass_damping_per_s=material.rayleigh_mass_per_s,
            stiffness_damping_s=material.rayleigh_stiffness_s,
            gradients=gradients,
            volumes_m3=volumes,
            masses_kg=lumped_masses(mesh, volumes, material.density_kg_m3),
            unknown=unknown,
            band=half_bandwidth(mesh.tets, unknown),
        )


def shape_gradients(nodes_m: Floats, tets: Ints) -> tuple[Floats, Floats]:
    """Gradients grad N_a (t, 4, 3) 1/m and volumes (t,) m3 of linear tetrahedra at rest."""
    sixfold, inner = edge_inverses(nodes_m, tets)
    return np.concatenate([-inner.sum(axis=1, keepdims=True), inner], axis=1), sixfold / 6.0


def lumped_masses(mesh: Mesh, volumes_m3: Floats, density_kg_m3: float) -> Floats:
    """(n,) kg: a quarter of each tetrahedron's mass to each of its nodes."""
    masses = np.zeros(len(mesh.nodes_m))
    np.add.at(masses, mesh.tets, np.repeat(density_kg_m3 * volumes_m3 / 4.0, 4).reshape(-1, 4))
    return masses


@kernel
def polar_rotation(f: Floats, r: Floats) -> bool:
    """Exact rotation of F = R S by Newton's method, from the guess in r; False if it found none.

    f, r: (9,) row-major. With B = R^T F, the increment w of R <- R cay(w) solves (tr(S) I - S) w = 2 axial(B),
    S = sym(B); it vanishes exactly where R^T F is symmetric. Cayley's map keeps R orthogonal without trigonometry.
    """
    for _ in range(POLAR_ITERATIONS):
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
            return False  # not the maximum of tr(R^T F): a wrong stationary point
        c11, c12, c22 = m00 * m22 - m02 * m02, m01 * m02 - m00 * m12, m00 * m11 - m01 * m01
        h = 0.5 / det
        w0 = h * (c00 * a0 + c01 * a1 + c02 * a2)
        w1 = h * (c01 * a0 + c11 * a1 + c12 * a2)
        w2 = h * (c02 * a0 + c12 * a1 + c22 * a2)
        square = w0 * w0 + w1 * w1 + w2 * w2
        k = 2.0 / (1.0 + square)
        e00, e11, e22 = (
            1.0 - k * (w1 * w1 + w2 * w2),
            1.0 - k * (w0 * w0 + w2 * w2),
            1.0 - k * (w0 * w0 + w1 * w1),
        )
        e01, e10 = k * (w0 * w1 - w2), k * (w0 * w1 + w2)
        e02, e20 = k * (w0 * w2 + w1), k * (w0 * w2 - w1)
        e12, e21 = k * (w1 * w2 - w0), k * (w1 * w2 + w0)
        for i in range(0, 9, 3):
            r0, r1, r2 = r[i], r[i + 1], r[i + 2]
            r[i] = r0 * e00 + r1 * e10 + r2 * e20
            r[i + 1] = r0 * e01 + r1 * e11 + r2 * e21
            r[i + 2] = r0 * e02 + r1 * e12 + r2 * e22
        if square < 1e-20:  # the next increment would be below 1e-20: quadratic convergence
            return True
    return False


@kernel
def cold_polar_rotation(f: Floats, r: Floats) -> None:
    """Rotation of F by its singular vectors, reflections removed: the fallback of the warm start."""
    nearest_rotation(f.reshape(3, 3), r.reshape(3, 3))


@kernel
def elastic_forces(
    x: Floats,
    tets: Ints,
    gradients: Floats,
    volumes: Floats,
    mu: float,
    lam: float,
    rotations: Floats,
    forces: Floats,
) -> tuple[float, float]:
    """Forces that hold the tissue in place, (n, 3) N, written; returns (min det F, elastic energy in J).

    x: (n, 3) m. rotations: (t, 9), the last polar rotations, updated. The elastic force on a node is minus `forces`.
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
        if not polar_rotation(f, r):
            cold_polar_rotation(f, r)
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


@kernel
def rotated_stiffness_times(
    v: Floats,
    tets: Ints,
    gradients: Floats,
    volumes: Floats,
    mu: float,
    lam: float,
    rotations: Floats,
    out: Floats,
) -> None:
    """Write out = sum R_e K_e R_e^T v, (n, 3), K_e the linear stiffness: V R (2 mu eps + lambda tr(eps) I) grad N_a
    with eps = sym(R^T grad v). Used for the stiffness-proportional damping."""
    out[:] = 0.0
    slope, local, stress, p = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for e in range(len(tets)):
        g = gradients[e]
        t = tets[e]
        r = rotations[e].reshape(3, 3)
        slope[:], local[:], p[:] = 0.0, 0.0, 0.0
        for a in range(4):
            for i in range(3):
                for j in range(3):
                    slope[i, j] += v[t[a], i] * g[a, j]
        add_product(r.T, slope, local)
        trace = lam * (local[0, 0] + local[1, 1] + local[2, 2])
        for i in range(3):
            for j in range(3):
                stress[i, j] = volumes[e] * (mu * (local[i, j] + local[j, i]) + (trace if i == j else 0.0))
        add_product(r, stress, p)
        for a in range(4):
            for i in range(3):
                out[t[a], i] += p[i, 0] * g[a, 0] + p[i, 1] * g[a, 1] + p[i, 2] * g[a, 2]


@kernel
def assemble_band(  # noqa: C901  (nested loops over the entries of an element, no cases)
    tetrahedra: Tetrahedra, rotations: Floats, unknown: Ints, scale: float, diagonal: Floats, band: Singles
) -> None:
    """Add to the lower band of A, band[j, i - j] = A[i, j]: scale * sum R_e K_e R_e^T + diag(diagonal).

    With h_a = R grad N_a: K_ab = V (lambda h_a h_b^T + mu h_b h_a^T + mu (h_a . h_b) I). diagonal: (n,) per node.
    """
    tets, gradients, volumes, mu, lam = tetrahedra
    h = np.empty((4, 3))
    for e in range(len(tets)):
        r = rotations[e]
        for a in range(4):
            for i in range(3):
                g = gradients[e, a]
                h[a, i] = r[3 * i] * g[0] + r[3 * i + 1] * g[1] + r[3 * i + 2] * g[2]
        v = scale * volumes[e]
        for a in range(4):
            row = 3 * unknown[tets[e, a]]
            if row < 0:
                continue
            for b in range(4):
                column = 3 * unknown[tets[e, b]]
                if column < 0 or column > row:
                    continue
                dot = h[a, 0] * h[b, 0] + h[a, 1] * h[b, 1] + h[a, 2] * h[b, 2]
                for i in range(3):
                    for j in range(3):
                        if row + i < column + j:
                            continue
                        value = v * (lam * h[a, i] * h[b, j] + mu * h[b, i] * h[a, j])
                        if i == j:
                            value += v * mu * dot
                        band[column + j, row + i - column - j] += value
    for node in range(len(unknown)):
        if unknown[node] >= 0:
            for i in range(3):
                band[3 * unknown[node] + i, 0] += diagonal[node]
