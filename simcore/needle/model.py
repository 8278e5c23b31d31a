"""The needle: a chain of equal beams held at its base, its block tridiagonal solver, its statics on its own.

A state is x (n+1, 3) m, node positions, and R (n+1, 3, 3), node rotations, both in world; row 0 is the base,
which the robot prescribes. Identity rotations: needle along +z.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from simcore.compiled import kernel
from simcore.errors import Status
from simcore.linear_algebra.products import product
from simcore.needle.beam import BeamForces, Section, internal
from simcore.rotations import compose, exp_map, log_map, project_rotation

if TYPE_CHECKING:
    from simcore.arrays import Floats


def _no_rest_frames() -> Floats:
    return np.zeros((0, 2, 3, 3))


def _require_positive(name: str, value: float) -> None:
    if not 0.0 < value < math.inf:
        raise ValueError(f"{name} = {value!r}: must be finite and above 0")


@dataclass(frozen=True)
class Tube:
    """A straight elastic tube of equal beams; inner diameter 0 = solid."""

    length_m: float
    elements: int
    outer_diameter_m: float
    inner_diameter_m: float
    young_pa: float
    poisson: float


@dataclass(frozen=True)
class NeedleModel:
    """Geometry and section of a needle; the section has one bending stiffness for both of its axes."""

    length_m: float
    elements: int
    axial_n: float  # EA
    bending_nm2: float  # EI
    torsion_nm2: float  # GJ
    shear_parameter: float  # phi = 12 EI / (k G A l^2), l the element length
    outer_radius_m: float
    # (elements, 2, 3, 3): rest element frame, in the frames of its two nodes at rest; empty = straight
    rest_frames: Floats = field(default_factory=_no_rest_frames, repr=False, compare=False)

    def __post_init__(self) -> None:
        for name in ("length_m", "elements", "axial_n", "bending_nm2", "torsion_nm2"):
            _require_positive(name, getattr(self, name))
        if not 0.0 <= self.shear_parameter < math.inf:
            raise ValueError(f"shear_parameter = {self.shear_parameter!r}: must be finite and at least 0")
        if self.rest_frames.shape not in ((0, 2, 3, 3), (self.elements, 2, 3, 3)):
            raise ValueError(f"rest_frames of shape {self.rest_frames.shape}: must be ({self.elements}, 2, 3, 3)")

    @property
    def element_length_m(self) -> float:
        """Rest length of one beam, m."""
        return self.length_m / self.elements

    @cached_property
    def section(self) -> Section:
        """What `beam.internal` takes beside the state."""
        stiffness = (self.axial_n, self.bending_nm2, self.torsion_nm2)
        return Section(self.element_length_m, *stiffness, self.shear_parameter, self.rest_frames)

    @classmethod
    def from_section(
        cls,
        *,
        length_m: float,
        elements: int,
        axial_n: float,
        bending_nm2: float,
        torsion_nm2: float,
        shear_n: float,
        outer_radius_m: float,
        rest_frames: Floats | None = None,
    ) -> NeedleModel:
        """From section stiffnesses EA, EI, GJ and kGA (`shear_n`, N; infinite = rigid in shear)."""
        _require_positive("length_m", length_m)
        if not shear_n > 0.0:
            raise ValueError(f"shear_n = {shear_n!r}: must be above 0")
        phi = 12.0 * bending_nm2 / (shear_n * (length_m / elements) ** 2)
        rest_frames = _no_rest_frames() if rest_frames is None else rest_frames
        return cls(length_m, elements, axial_n, bending_nm2, torsion_nm2, phi, outer_radius_m, rest_frames)

    @classmethod
    def from_tube(cls, tube: Tube) -> NeedleModel:
        """A circular tube, with Cowper's shear coefficient. Raises ValueError for diameters that make no tube."""
        outer, inner = tube.outer_diameter_m, tube.inner_diameter_m
        if not 0.0 <= inner < outer:
            raise ValueError(f"inner_diameter_m = {inner!r}: must be 0 to below {outer!r}")
        area = math.pi / 4.0 * (outer**2 - inner**2)
        second_moment = math.pi / 64.0 * (outer**4 - inner**4)
        shear_pa = tube.young_pa / (2.0 * (1.0 + tube.poisson))
        return cls.from_section(
            length_m=tube.length_m,
            elements=tube.elements,
            axial_n=tube.young_pa * area,
            bending_nm2=tube.young_pa * second_moment,
            torsion_nm2=shear_pa * 2.0 * second_moment,
            shear_n=cowper_coefficient(inner / outer, tube.poisson) * shear_pa * area,
            outer_radius_m=0.5 * outer,
        )


def cowper_coefficient(ratio: float, poisson: float) -> float:
    """Shear coefficient k of a hollow circular section, ratio = inner / outer diameter (Cowper 1966).

    G. R. Cowper, "The shear coefficient in Timoshenko's beam theory", J. Appl. Mech. 33 (1966) 335-340.
    """
    spread = (1.0 + ratio**2) ** 2
    return 6.0 * (1.0 + poisson) * spread / ((7.0 + 6.0 * poisson) * spread + (20.0 + 12.0 * poisson) * ratio**2)


def straight(model: NeedleModel, base_position: Floats, base_rotation: Floats) -> tuple[Floats, Floats]:
    """Stress-free x (n+1, 3) m, R (n+1, 3, 3) of a straight needle at the base pose (3,) m, (3, 3), world."""
    s = np.linspace(0.0, model.length_m, model.elements + 1)
    x = np.asarray(base_position, dtype=float) + s[:, None] * np.asarray(base_rotation, dtype=float)[:, 2]
    return x, np.tile(np.asarray(base_rotation, dtype=float), (model.elements + 1, 1, 1))


@kernel
def advance(x: Floats, R: Floats, dq: Floats) -> None:
    """Move the state in place by dq (n+1, 6) m, rad: x += dx, R <- exp(dw) R, re-orthonormalised."""
    for i in range(len(x)):
        turned = project_rotation(compose(exp_map(dq[i, 3:]), R[i]))
        for a in range(3):
            x[i, a] += dq[i, a]
            for b in range(3):
                R[i, a, b] = turned[a, b]


@kernel
def increments(x: Floats, R: Floats, x_new: Floats, R_new: Floats) -> Floats:
    """(n+1, 6) m, rad: what `advance` needs to carry the state x, R to x_new, R_new."""
    out = np.empty((len(x), 6))
    for i in range(len(x)):
        turn = log_map(compose(R_new[i], R[i].T))
        for a in range(3):
            out[i, a] = x_new[i, a] - x[i, a]
            out[i, 3 + a] = turn[a]
    return out


def rigid_move(x: Floats, R: Floats, position: Floats, rotation: Floats) -> None:
    """Carry the state rigidly, in place, with its base to `position` (3,) m, `rotation` (3, 3), world."""
    turn = compose(rotation, R[0].T)
    x[:] = position + product(x - x[0], turn.T)
    for i in range(len(R)):
        R[i] = compose(turn, R[i])
    R[0] = rotation


@kernel
def _add_product(sign: float, block: Floats, source: Floats, target: Floats) -> None:
    """Add to target (6, m): sign * block (6, 6) source (6, m)."""
    for a in range(6):
        b0, b1, b2 = sign * block[a, 0], sign * block[a, 1], sign * block[a, 2]
        b3, b4, b5 = sign * block[a, 3], sign * block[a, 4], sign * block[a, 5]
        for k in range(target.shape[1]):
            low = b0 * source[0, k] + b1 * source[1, k] + b2 * source[2, k]
            high = b3 * source[3, k] + b4 * source[4, k] + b5 * source[5, k]
            target[a, k] += low + high


@kernel
def _invert(block: Floats, work: Floats, out: Floats) -> None:  # noqa: C901  (Gauss-Jordan: nested loops, no cases)
    """Inverse of block (6, 6) into out by Gauss-Jordan with row pivoting; work (6, 12) is scratch."""
    for i in range(6):
        for c in range(6):
            work[i, c] = block[i, c]
            work[i, 6 + c] = 1.0 if i == c else 0.0
    for i in range(6):
        best = i
        for r in range(i + 1, 6):
            if abs(work[r, i]) > abs(work[best, i]):
                best = r
        for c in range(i, 12):
            work[i, c], work[best, c] = work[best, c], work[i, c]
        pivot = 1.0 / work[i, i]
        for c in range(i, 12):
            work[i, c] *= pivot
        for r in range(6):
            if r != i:
                factor = work[r, i]
                for c in range(i, 12):
                    work[r, c] -= factor * work[i, c]
    for i in range(6):
        for c in range(6):
            out[i, c] = work[i, 6 + c]


@kernel
def factor_blocks(diag: Floats, upper: Floats, lower: Floats) -> tuple[Floats, Floats]:
    """Block LU of a block tridiagonal matrix of n diagonal blocks, laid out as the outputs of `internal`.

    diag: (n, 6, 6); upper, lower: (n - 1, 6, 6). Returns the inverses (n, 6, 6) of the pivot blocks and the
    negative multipliers (n - 1, 6, 6) of the forward sweep. No pivoting across blocks. A singular pivot block
    leaves infinities or NaN, never an exception.
    """
    n = len(diag)
    inverses, multipliers = np.empty((n, 6, 6)), np.zeros((n - 1, 6, 6))
    pivot, work = np.empty((6, 6)), np.empty((6, 12))
    for i in range(n):
        for a in range(6):
            for b in range(6):
                pivot[a, b] = diag[i, a, b]
        if i > 0:
            _add_product(-1.0, lower[i - 1], inverses[i - 1], multipliers[i - 1])
            _add_product(1.0, multipliers[i - 1], upper[i - 1], pivot)
        _invert(pivot, work, inverses[i])
    return inverses, multipliers


@kernel
def solve_blocks(inverses: Floats, multipliers: Floats, upper: Floats, rhs: Floats) -> None:
    """Replace rhs (n, 6, m) by the solutions of its m systems.

    inverses, multipliers: from `factor_blocks`; upper: (n - 1, 6, 6), as given to it.
    """
    n, m = len(inverses), rhs.shape[2]
    swept = np.empty((6, m))
    for i in range(1, n):
        _add_product(1.0, multipliers[i - 1], rhs[i - 1], rhs[i])
    for i in range(n - 1, -1, -1):
        if i < n - 1:
            _add_product(-1.0, upper[i], rhs[i + 1], rhs[i])
        for a in range(6):
            for k in range(m):
                swept[a, k] = rhs[i, a, k]
                rhs[i, a, k] = 0.0
        _add_product(1.0, inverses[i], swept, rhs[i])


@dataclass(frozen=True)
class StaticSolution:
    """End of a static solve; x and R are the equilibrium only if `status` is COMPLETED."""

    status: Status
    x: Floats  # (n+1, 3) m, world
    R: Floats  # (n+1, 3, 3)
    iterations: int
    residual: float  # largest component of the last residual, N or N m


def solve_static(
    model: NeedleModel, x: Floats, R: Floats, external: Floats, *, tolerance: float, max_iterations: int = 30
) -> StaticSolution:
    """Newton's method for the free nodes under dead loads `external` (n+1, 6) N, N m, world; the base stays.

    Starts from x (n+1, 3) m, R (n+1, 3, 3), which are not changed; large loads are for the caller to step.
    Converged when no residual exceeds `tolerance` (N, N m). Failures: NOT_FINITE, NOT_CONVERGED.
    """
    x, R, n = x.copy(), R.copy(), model.elements
    beams = BeamForces.of_size(n)
    step = np.zeros((n + 1, 6))
    for iteration in range(max_iterations + 1):
        internal(x, R, model.section, beams)
        rest = external[1:] - beams.forces[1:]
        residual = float(np.abs(rest).max())
        if not math.isfinite(residual):
            return StaticSolution(Status.NOT_FINITE, x, R, iteration, residual)
        if residual <= tolerance:
            return StaticSolution(Status.COMPLETED, x, R, iteration, residual)
        rest = rest[:, :, None].copy()
        solve_blocks(*factor_blocks(beams.diag[1:], beams.upper[1:], beams.lower[1:]), beams.upper[1:], rest)
        step[1:] = rest[:, :, 0]
        advance(x, R, step)
    return StaticSolution(Status.NOT_CONVERGED, x, R, max_iterations, residual)
