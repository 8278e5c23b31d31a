"""Independent solutions: small-strain elasticity, a manufactured displacement, one coupled step by full Newton."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.linalg import spsolve
from threadpoolctl import threadpool_limits

from simcore.contact.channel import Phase
from simcore.needle.beam import BeamForces, internal
from simcore.needle.model import rigid_move
from simcore.needle.shaft import shaft_frame
from simcore.rotations import exp_map

if TYPE_CHECKING:
    from simcore.insertion.insertion import Insertion, InsertionState
    from simcore.insertion.state import Pose
    from simcore.tissue.model import TissueModel

Vector = NDArray[np.float64]
Indices = NDArray[np.int64]
MANUFACTURED_EDGE_M = 0.04
MANUFACTURED_DIRECTION = np.array([1.0, -0.5, 0.8])
QUADRATURE = np.full((4, 4), 0.1381966011250105) + 0.4472135954999579 * np.eye(4)  # degree 2 (Keast 1986)


def small_strain_matrix(nodes: Vector, tets: Indices, young_pa: float, poisson: float) -> csr_array:
    """Textbook assembly (Zienkiewicz): K_e = V B^T D B in Voigt's notation, 3 degrees of freedom a node."""
    shear = young_pa / (2 * (1 + poisson))
    d = np.diag([2 * shear] * 3 + [shear] * 3)
    d[:3, :3] += young_pa * poisson / ((1 + poisson) * (1 - 2 * poisson))
    ones = np.concatenate([np.ones((len(tets), 4, 1)), nodes[tets]], axis=2)
    slopes = np.linalg.inv(ones)[:, 1:, :]  # rows d/dx, d/dy, d/dz of the four shape functions
    b = np.zeros((len(tets), 6, 4, 3))
    for row, pairs in enumerate([[(0, 0)], [(1, 1)], [(2, 2)], [(1, 2), (2, 1)], [(0, 2), (2, 0)], [(0, 1), (1, 0)]]):
        for derivative, component in pairs:
            b[:, row, :, component] = slopes[:, derivative]
    strains = b.reshape(len(tets), 6, 12)
    local = np.einsum("tia,ij,tjb->tab", strains, d, strains) * (np.abs(np.linalg.det(ones)) / 6.0)[:, None, None]
    return assembled(local, tets, len(nodes))


def assembled(local: Vector, tets: Indices, nodes: int) -> csr_array:
    """Sum of element matrices (t, 12, 12) over all nodes."""
    dofs = (3 * tets[:, :, None] + np.arange(3)).reshape(-1, 12)
    rows, columns = np.repeat(dofs, 12, axis=1).ravel(), np.tile(dofs, (1, 12)).ravel()
    return coo_array((local.ravel(), (rows, columns)), shape=(3 * nodes, 3 * nodes)).tocsr()


def small_strain_solution(model: TissueModel, young_pa: float, poisson: float, load: Vector) -> Vector:
    """(n, 3) m displacement under nodal loads (n, 3) N."""
    matrix = small_strain_matrix(model.mesh.nodes_m, model.mesh.tets, young_pa, poisson)
    free, u = np.repeat(model.unknown >= 0, 3), np.zeros(load.size)
    u[free] = spsolve(matrix[free][:, free].tocsc(), load.ravel()[free])
    return u.reshape(-1, 3)


def manufactured(points: Vector, order: tuple[int, int, int]) -> Vector:
    """Derivatives of phi = sin(k x) sin(k y) 6 s^2 (1 - s), s = z / L: free of displacement and traction at z = 0."""
    k, (x, y, z) = np.pi / MANUFACTURED_EDGE_M, points.T
    s = z / MANUFACTURED_EDGE_M
    bubble = [6 * (s**2 - s**3), 6 * (2 * s - 3 * s**2) / MANUFACTURED_EDGE_M, 6 * (2 - 6 * s) / MANUFACTURED_EDGE_M**2]
    waves = [k ** order[i] * np.sin(k * v + 0.5 * np.pi * order[i]) for i, v in ((0, x), (1, y))]
    return waves[0] * waves[1] * bubble[order[2]]


def manufactured_load(points: Vector, young_pa: float, poisson: float) -> Vector:
    """Body force -div sigma of u = phi d: -(mu lap phi d + (lambda + mu) H d), H the second derivatives of phi."""
    shear, axes = young_pa / (2 * (1 + poisson)), np.eye(3, dtype=int)
    second = np.array([[manufactured(points, tuple(a + b)) for a in axes] for b in axes])
    spread = shear / (1 - 2 * poisson) * np.einsum("ijp,j->pi", second, MANUFACTURED_DIRECTION)
    return -(spread + shear * np.einsum("iip,j->pj", second, MANUFACTURED_DIRECTION))


@dataclass
class Iterate:
    """Tissue x (n, 3), needle (m + 1, 3) and (m + 1, 3, 3), force (a, 3) N on the tissue, arc length (a,) m of the
    shaft point beside the ball."""

    x: Vector
    needle_x: Vector
    needle_R: Vector
    force: Vector
    arc: Vector

    def after(self, free: Indices, step: NDArray[np.floating]) -> Iterate:
        """Moved by (3 f + 6 m + 3 a + a,) increments of free tissue nodes, needle, forces, arc lengths."""
        m, a = len(self.needle_x) - 1, len(self.arc)
        tissue, needle, force, arc = np.split(step, np.cumsum([3 * len(free), 6 * m, 3 * a]))
        new = Iterate(self.x.copy(), self.needle_x.copy(), self.needle_R.copy(), self.force.copy(), self.arc + arc)
        new.x[free] += tissue.reshape(-1, 3)
        new.needle_x[1:] += needle.reshape(m, 6)[:, :3]
        for i, turn in enumerate(needle.reshape(m, 6)[:, 3:]):
            new.needle_R[i + 1] = exp_map(turn) @ new.needle_R[i + 1]
        new.force += force.reshape(a, 3)
        return new


class FullNewton:
    """One step with given modes as a square system in tissue, needle, forces and arc lengths; dense Newton.

    Rows: balance of the free tissue nodes, balance of the free needle nodes, and of each point p - c(s) + L F = 0 and
    its axial law: s + C F_tau / |c'| = breakpoint (odd mode), else force along the shaft = level (specification of the
    interaction). L = P G P / l across the shaft and C = tau G tau / l along it, 0 at X_c and in hard rows; l is
    longer at the entry by what the inserted length lacks to the needle's diameter; a free X_c has P F = 0 in place of
    its lateral gap.
    """

    def __init__(
        self,
        insertion: Insertion,
        before: InsertionState,
        base: Pose,
        modes: Indices,
        *,
        slips_on_surface: bool = False,
    ) -> None:
        self.insertion, self.before, self.base = insertion, before, base
        self.tissue, self.channel, self.needle = insertion.tissue, before.channel, insertion.needle
        self.elements = before.channel.active_elements()
        self.modes = modes[self.elements]
        self.slips_on_surface = slips_on_surface
        self.free = np.flatnonzero(self.tissue.unknown >= 0)
        self.balls = np.zeros((self.channel.count, len(self.tissue.mesh.nodes_m)))
        for e in range(self.channel.count):
            used = self.channel.touched[e]
            np.add.at(self.balls[e], self.channel.nodes[e, :used], self.channel.weights[e, :used])

    def solve(self, tolerance_n: float = 1e-9) -> Iterate:
        """Newton from the old state, carried rigidly with the base, until the residual (N; mm) is below tolerance."""
        bodies = self.before.bodies
        place, frames = bodies.needle_x.copy(), bodies.needle_R.copy()
        rigid_move(place, frames, self.base.position_m, self.base.rotation)
        force, arc = self.channel.force_n[self.elements], self.channel.arc_m[self.elements]
        at = Iterate(bodies.x.copy(), place, frames, force.copy(), arc.copy())
        for _ in range(12):
            residual = self.residual(at)
            if np.abs(residual).max() < tolerance_n:
                return at
            with threadpool_limits(1):
                at = at.after(self.free, -np.linalg.solve(self.jacobian(at), residual))
        raise AssertionError(f"full Newton stalls at {np.abs(residual).max():.3g} N")

    def residual(self, at: Iterate) -> Vector:
        """All rows; lengths in mm to weigh like newtons."""
        tissue = np.zeros_like(at.x)
        np.add.at(tissue, self.tissue.mesh.tets, self.element_forces(at.x))
        tissue -= self.balls[self.elements].T @ at.force
        return np.concatenate([(tissue + self.inertia(at.x))[self.free].ravel(), self.coupled_rows(at)])

    def jacobian(self, at: Iterate) -> Vector:
        """Central differences: tissue per element, everything else by column; points follow the tissue linearly."""
        free, f = np.repeat(self.tissue.unknown >= 0, 3), 3 * len(self.free)
        rest = self.coupled_rows(at).size
        matrix = np.zeros((f + rest, f + rest))
        nodes = len(at.x)
        stiff = assembled(self.element_tangents(at.x), self.tissue.mesh.tets, nodes).toarray()
        stiff += np.diag(np.repeat(self.inertia_slope(), 3))
        matrix[:f, :f] = stiff[free][:, free]
        balls = np.kron(self.balls, np.eye(3))[:, free]
        active = (3 * self.elements[:, None] + np.arange(3)).ravel()
        force_columns = slice(f + 6 * self.needle.elements, f + 6 * self.needle.elements + len(active))
        matrix[:f, force_columns] = -balls[active].T
        matrix[f:, :f] = self.differences(lambda d: self.coupled_rows(at, d.reshape(-1, 3)), len(balls), 1e-7) @ balls
        padded = np.zeros(f)
        matrix[f:, f:] = self.differences(
            lambda d: self.coupled_rows(at.after(self.free, np.concatenate([padded, d]))), rest, 1e-6
        )
        return matrix

    @staticmethod
    def differences(function, size: int, step: float) -> Vector:  # type: ignore[no-untyped-def]
        """(rows, size) central differences of a function of (size,) increments."""
        return np.array([(function(step * unit) - function(-step * unit)) / (2 * step) for unit in np.eye(size)]).T

    # tissue

    def element_forces(self, x: Vector) -> Vector:
        """(t, 4, 3) N: V (P + damping stress) grad N_a; the rotation of F by a singular value decomposition."""
        t, dt = self.tissue, self.insertion.model.dt_s
        corners, velocity = x[t.mesh.tets], (x - self.before.bodies.x)[t.mesh.tets] / dt
        return self.forces_of(corners, velocity)

    def forces_of(self, corners: Vector, velocity: Vector) -> Vector:
        t, eye = self.tissue, np.eye(3)
        f = np.einsum("tai,taj->tij", corners, t.gradients)
        u, _, vt = np.linalg.svd(f)
        u[:, :, 2] *= np.linalg.det(u @ vt)[:, None]
        r = u @ vt
        strain = np.swapaxes(r, 1, 2) @ f - eye
        rate = np.swapaxes(r, 1, 2) @ np.einsum("tai,taj->tij", velocity, t.gradients)
        strain = strain + t.stiffness_damping_s * 0.5 * (rate + np.swapaxes(rate, 1, 2))
        trace = np.trace(strain, axis1=1, axis2=2)[:, None, None]
        stress = r @ (2 * t.mu_pa * strain + t.lambda_pa * trace * eye)
        return np.einsum("t,tij,taj->tai", t.volumes_m3, stress, t.gradients)

    def element_tangents(self, x: Vector) -> Vector:
        """(t, 12, 12) N/m by central differences of one corner component of every element at once."""
        t, dt, step = self.tissue, self.insertion.model.dt_s, 1e-7
        corners, old = x[t.mesh.tets], self.before.bodies.x[t.mesh.tets]
        out = np.empty((len(corners), 12, 12))
        for column in range(12):
            change = np.zeros((4, 3))
            change[column // 3, column % 3] = step
            ahead, behind = corners + change, corners - change
            slope = self.forces_of(ahead, (ahead - old) / dt) - self.forces_of(behind, (behind - old) / dt)
            out[:, :, column] = slope.reshape(-1, 12) / (2 * step)
        return out

    def inertia(self, x: Vector) -> Vector:
        """(n, 3) N: M (v+ - v) / dt + alpha M v+."""
        dt = self.insertion.model.dt_s
        v = (x - self.before.bodies.x) / dt
        change = (v - self.before.bodies.v) / dt + self.tissue.mass_damping_per_s * v
        return self.tissue.masses_kg[:, None] * change

    def inertia_slope(self) -> Vector:
        dt = self.insertion.model.dt_s
        return self.tissue.masses_kg * (1.0 / dt**2 + self.tissue.mass_damping_per_s / dt)

    # needle and constraints

    def coupled_rows(self, at: Iterate, shift: Vector | float = 0.0) -> Vector:
        """Needle (6 m,) N, N m; gaps (3 a,) and breakpoints (a,) mm or levels N; `shift` (P, 3) m of the balls."""
        rest = self.tissue.mesh.nodes_m
        points = self.channel.rest_m[: self.channel.count] + self.balls @ (at.x - rest) + shift
        forces = self.needle_forces(at)
        gaps, laws = np.empty((len(self.elements), 3)), np.empty(len(self.elements))
        lengths = self.tributaries(at, points)
        levels, bevel_m = self.levels(lengths), self.insertion.model.line.bevel_m
        for i, e in enumerate(self.elements):
            c, dc, _, beam, h = self.shaft(at.needle_x, at.needle_R, at.arc[i])
            for node, share, lever in ((beam, h[0], h[1]), (beam + 1, h[2], h[3])):
                forces[node, :3] += share * at.force[i]
                forces[node, 3:] += lever * np.cross(at.needle_R[node, :, 2], at.force[i])
            tangent = dc / np.linalg.norm(dc)
            coupled = lengths[i] + (max(bevel_m - lengths.sum(), 0.0) if e == 1 else 0.0)
            gaps[i], creep = self.gap(i, points[e] - c, tangent, at.force[i], max(coupled, 1e-6))
            if self.slips_on_surface:
                gaps[i, :2] = at.force[i, :2] - self.coulomb(at.force[i], c - points[e])
            if self.modes[i] % 2 == 1:
                laws[i] = 1e3 * (at.arc[i] + creep / np.linalg.norm(dc) - self.breakpoint(i))
            else:
                axial = at.force[i] @ tangent
                lateral = np.linalg.norm(at.force[i] - axial * tangent)
                laws[i] = axial - levels[i] - self.sign(i) * self.insertion.model.law.friction * lateral
        return np.concatenate([forces[1:].ravel(), gaps.ravel(), laws])

    def gap(self, i: int, apart: Vector, tangent: Vector, force: Vector, length: float) -> tuple[Vector, float]:
        """(3,) mm: the generalised gap of an element that is `apart` (3,) m; lateral rows of a free X_c in N. And the
        creep along the shaft, m."""
        line, across = self.insertion.model.line, np.eye(3) - np.outer(tangent, tangent)
        if self.before.channel.phase is Phase.INSERTED and self.elements[i] == 0 and line.free_tip:
            return 1e3 * tangent * (tangent @ apart) + across @ force, 0.0
        if self.elements[i] == 0 or line.hard:
            return 1e3 * apart, 0.0
        pressed = across @ line.compliance_m2_per_n @ across @ force / length
        return 1e3 * (apart + pressed), float(tangent @ line.compliance_m2_per_n @ tangent / length * (tangent @ force))

    def shaft(self, needle_x: Vector, needle_R: Vector, arc: float) -> tuple[Vector, Vector, Vector, int, Vector]:
        return shaft_frame(needle_x, needle_R, self.needle.element_length_m, arc)

    def coulomb(self, force: Vector, slip: Vector) -> Vector:
        """(2,) N on the tissue of a surface contact that slips: mu times the normal force, along the needle's slip."""
        return self.insertion.model.law.friction * force[2] * slip[:2] / max(np.hypot(*slip[:2]), 1e-12)

    def needle_forces(self, at: Iterate) -> Vector:
        m = self.needle.elements
        beams = BeamForces.of_size(m)
        internal(at.needle_x, at.needle_R, self.needle.section, beams)
        return beams.forces

    def withdrawn(self, i: int) -> bool:
        return bool(self.elements[i] == 0 and self.channel.arc_m[0] > self.needle.length_m + 1e-9)

    def breakpoint(self, i: int) -> float:
        at_end = self.elements[i] == 0 and not (self.withdrawn(i) and self.modes[i] == 1)
        return float(self.needle.length_m if at_end else self.channel.arc_m[self.elements[i]])

    def sign(self, i: int) -> float:
        return -1.0 if self.modes[i] == 0 else 1.0

    def levels(self, lengths: Vector) -> Vector:
        """(a,) N: +- tau0 l_i, and f_cut beyond the channel end; Coulomb's part is added by the caller."""
        law = self.insertion.model.law
        out = np.empty(len(self.elements))
        for i, e in enumerate(self.elements):
            cutting = e == 0 and self.modes[i] == (4 if self.withdrawn(i) else 2)
            out[i] = self.sign(i) * law.adhesion_n_per_m * lengths[i] + cutting * law.cutting_n
        return out

    def tributaries(self, at: Iterate, points: Vector) -> Vector:
        """(a,) m: cells between half-ways of active depths, from the entry to the inserted length."""
        channel, length = self.channel, self.needle.length_m
        arcs = np.array([self.projected(at, points[e], channel.arc_m[e]) for e in range(channel.count)])
        arcs[self.elements] = at.arc
        order = [*range(1, channel.count), 0]
        depths = channel.depth_m[order]
        ahead = arcs[0] <= length
        inserted = depths[-1] + length - arcs[0] if ahead else np.interp(length, arcs[order], depths)
        active = [e for e in order if e in self.elements]
        own = channel.depth_m[active]
        edges = np.clip([0.0, *(0.5 * (own[1:] + own[:-1])), inserted], 0.0, inserted)
        lengths = dict(zip(active, np.diff(edges), strict=True))
        return np.array([lengths[e] for e in self.elements])

    def projected(self, at: Iterate, point: Vector, arc: float) -> float:
        """Arc length of the foot of the perpendicular from a point (3,) m."""
        for _ in range(10):
            c, dc, ddc, _, _ = self.shaft(at.needle_x, at.needle_R, arc)
            arc += float((point - c) @ dc / (dc @ dc - (point - c) @ ddc))
        return float(arc)
