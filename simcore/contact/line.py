"""The coupling of a thin needle and tissue along a line: how far the needle moves in a tissue that cannot resolve it.

The tissue meets the needle through balls that are wider than the needle, in a mesh that is coarser still. What it would
give way more around the needle itself is a compliance G of the line: a line load q (N/m) across the needle moves it by
G q farther than its ball. A shaft point that stands for the length l then obeys gap + C lambda = 0 with C = G / l.

Same stance as embedded beams and 1D-3D mortar coupling; the derivation of G is in `cylinder_compliance`, the part that
the mesh owes in `line_calibration`. Where the line ends, at a free tip, nothing holds the needle sideways: the load of
a thin needle falls to zero there, so a point's length ends half-way to the tip.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from simcore.compiled import kernel
from simcore.contact.line_radius import LINE_RADIUS_OF_BALL
from simcore.elementary import logarithm

if TYPE_CHECKING:
    from simcore.arrays import Flags, Floats, Ints
    from simcore.contact.kernels import ConstraintPoints

SHORTEST_M = 1e-6  # a point that stands for less is as good as free


class LineCoupling(NamedTuple):
    """What a run never changes. hard: shaft points lie on the shaft exactly, G = 0. compliance_m2_per_n: (3, 3) G,
    world. free_tip: no lateral row at X_c. bevel_m: length over which the surface holds a needle that has just
    touched it, its diameter: a bevel is no shorter. force_share_m_per_n: violation per force of the tolerances; a
    compliant row is kept to either."""

    hard: bool
    compliance_m2_per_n: Floats
    free_tip: bool
    bevel_m: float
    force_share_m_per_n: float


def cylinder_compliance(
    *, shear_pa: float, poisson: float, needle_radius_m: float, ball_radius_m: float
) -> tuple[float, float]:
    """(A, 1 / (2 pi G)) ln(b / a) in m2/N: the deflection across and along a bonded rigid cylinder, per line load,
    beyond that of its line of balls.

    Kelvin's solutions of a line load q: across, in plane strain, u = A q (-ln r + ...), A = (3 - 4 nu) / (8 pi G
    (1 - nu)), along it u = -q ln r / (2 pi G); a the needle's radius. b is where a line of balls with the kernel of
    `ball` has its mean: ln b = E ln |X - Y| over two points of the projected kernel, b = 0.5119 rho. The angular parts
    of both are equal and cancel.
    """
    across = (3.0 - 4.0 * poisson) / (8.0 * math.pi * shear_pa * (1.0 - poisson))
    ratio = logarithm(LINE_RADIUS_OF_BALL * ball_radius_m / needle_radius_m)
    return across * ratio, ratio / (2.0 * math.pi * shear_pa)


def free_points(elements: Ints, *, contact: bool, free_tip: bool) -> Flags:
    """(a,) whether each active element bears no lateral force: X_c under a free tip."""
    free: Flags = (elements == 0) & (free_tip and not contact)
    return free


@kernel
def free_rows(free: Flags, w: Floats, matrix: Floats, right: Floats) -> None:
    """Write the two lateral equations of each element (a,) that is free: it has no lateral force."""
    for i in range(len(free)):
        if free[i]:
            for row in range(3 * i, 3 * i + 2):
                matrix[row, :] = 0.0
                matrix[row, row] = w[row, row]
                right[row] = 0.0


@kernel
def add_line_gap(
    line: LineCoupling,
    elements: Ints,
    tributary: Floats,
    inserted: float,
    force: Floats,
    mode: Ints,
    breaks: Floats,
    points: ConstraintPoints,
) -> None:
    """Write C (a, 3, 3) m/N of each shaft point, add C lambda to its gap and to its arc length; force (a, 3) N, local.

    The needle sticks and slides where it is in contact, which is C lambda / |c'| farther along than its ball projects.
    """
    for i in range(len(elements)):
        if elements[i] == 0:
            continue
        length = coupled_length(line, elements[i], tributary[elements[i]], inserted)
        line_compliance(line, points.frames[i], length, points.compliance[i])
        compliance = points.compliance[i]
        for a in range(2):
            for b in range(2):
                points.gap[i, a] += compliance[a, b] * force[i, b]
        creep = compliance[2, 2] * force[i, 2]
        if mode[i] % 2 == 1:
            rest = breaks[i, mode[i] // 2]
            points.gap[i, 2] = (points.arc[i] - rest) * points.speed[i] + creep
            points.arc[i] = rest
        else:
            points.arc[i] += creep / points.speed[i]


@kernel
def coupled_length(line: LineCoupling, element: int, tributary: float, inserted: float) -> float:
    """m: what an element of a tributary length m stands for. The entry, element 1, has in addition what a tip that is
    hardly in lacks to the bevel's length: the surface holds the bevel before the channel does."""
    lacking = max(line.bevel_m - inserted, 0.0) if element == 1 else 0.0
    return max(tributary + lacking, SHORTEST_M)


@kernel
def line_compliance(line: LineCoupling, frame: Floats, length: float, out: Floats) -> None:
    """Write out (3, 3) m/N, local: G / l across the shaft, and along it, which do not mix."""
    for a in range(3):
        for b in range(3):
            value = 0.0
            for p in range(3):
                for q in range(3):
                    value += frame[a, p] * line.compliance_m2_per_n[p, q] * frame[b, q]
            out[a, b] = value / length if a == b or max(a, b) < 2 else 0.0


@kernel
def largest_gap(line: LineCoupling, free: Flags, slips: bool, compliance: Floats, gap: Floats) -> float:
    """Largest component of the gaps (a, 3) m that count, NaN if one is: not the lateral ones of a point that is free
    or slips. A compliant row is a law between gap and force: its gap counts as much less as it gives way."""
    most = 0.0
    for i in range(len(gap)):
        for c in range(2 if slips or free[i] else 0, 3):
            size: float = abs(gap[i, c]) / (1.0 + compliance[i, c, c] / line.force_share_m_per_n)
            if np.isnan(size):
                return size
            most = max(most, size)
    return most
