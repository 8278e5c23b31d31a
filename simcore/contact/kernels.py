"""Kernels of the coupled step: gaps, frames and gradients of the constraints, residuals, condensed compliance.

The gap of an element is d = p - c(s): material ball p of the tissue minus shaft point c of the needle. Its gradients to
tissue and needle carry the same force with opposite signs, so forces balance exactly, and moments too where a ball is
whole; one that is cut by the surface has its centroid up to 1 mm below its point, and that lever times its force.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from simcore.compiled import kernel
from simcore.contact.ball import Balls, displaced
from simcore.contact.channel import project
from simcore.linear_algebra.entries import add_diagonal, largest_size
from simcore.needle.shaft import Shaft, shaft_columns, shaft_frame

if TYPE_CHECKING:
    from simcore.arrays import Flags, Floats, Ints, Singles


@kernel
def frame_along(axis: Floats, frame: Floats) -> None:
    """Rows n1, n2, tau of a right-handed frame with tau along `axis`; n1 leans towards x (y if the axis does)."""
    size = np.sqrt(axis[0] ** 2 + axis[1] ** 2 + axis[2] ** 2)
    lead = 0 if abs(axis[0]) < 0.9 * size else 1
    for i in range(3):
        frame[2, i] = axis[i] / size
    for i in range(3):
        frame[0, i] = (1.0 if i == lead else 0.0) - frame[2, lead] * frame[2, i]
    across = np.sqrt(frame[0, 0] ** 2 + frame[0, 1] ** 2 + frame[0, 2] ** 2)
    for i in range(3):
        frame[0, i] /= across
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        frame[1, i] = frame[2, j] * frame[0, k] - frame[2, k] * frame[0, j]


class TissueShape(NamedTuple):
    """The tissue's nodes now and at rest, (n, 3) m each."""

    x: Floats
    x_rest: Floats


class ConstraintPoints(NamedTuple):
    """Of each active element: arc length (a,) m, speed |c'| (a,), frame (a, 3, 3), local gap (a, 3) m, beam (a,), the
    gradient (a, 3, 12) of its shaft point in world axes, the ball's place (a, 3) m, and the compliance of the line
    between ball and shaft (a, 3, 3) m/N, local."""

    arc: Floats
    speed: Floats
    frames: Floats
    gap: Floats
    beams: Ints
    columns: Floats
    places: Floats
    compliance: Floats


class Sticking(NamedTuple):
    """Modes (a,) of the active elements, breakpoints (a, k) m of their staircases; whether shaft points are hard."""

    mode: Ints
    breaks: Floats
    hard: bool


@kernel
def constraint_geometry(
    contact: bool,
    elements: Ints,
    balls: Balls,
    tissue: TissueShape,
    shaft: Shaft,
    sticking: Sticking,
    out: ConstraintPoints,
) -> None:
    """Write the points of the active elements.

    Sticking elements keep the arc length of their breakpoint where they are hard, as X_c is; all others are projected
    onto the shaft. The frame of a surface contact stays as it is, inward normal last, and its arc length is L + gap
    along the normal.
    """
    rest, nodes, weights, touched = balls
    needle_x, needle_R, element_length = shaft
    mode, breaks, hard = sticking
    arc, speed, frames, gap, beams, columns, places, _ = out
    length = element_length * (len(needle_x) - 1)
    for i in range(len(elements)):
        e = elements[i]
        p = places[i]
        displaced(rest[e], nodes[e], weights[e], touched[e], tissue.x, tissue.x_rest, p)
        if contact:
            s = length
        elif mode[i] % 2 == 1 and (hard or e == 0):
            s = breaks[i, mode[i] // 2]
        else:
            s = project(needle_x, needle_R, element_length, p, arc[i])
        c, dc, _, beam, h = shaft_frame(needle_x, needle_R, element_length, s)
        if contact:
            speed[i] = 1.0
        else:
            frame_along(dc, frames[i])
            speed[i] = np.sqrt(dc[0] ** 2 + dc[1] ** 2 + dc[2] ** 2)
        for a in range(3):
            gap[i, a] = 0.0
            for b in range(3):
                gap[i, a] += frames[i, a, b] * (p[b] - c[b])
        if contact and mode[i] % 2 == 0:
            s = length + gap[i, 2]
            gap[i, 2] = 0.0
        arc[i] = s
        beams[i] = beam
        shaft_columns(needle_R, beam, h, columns[i])


class Motion(NamedTuple):
    """Of the tissue in a step: nodes x (n, 3) m now, x_old and v_old (m/s) before it, and dt in s."""

    x: Floats
    x_old: Floats
    v_old: Floats
    dt_s: float


class Inertia(NamedTuple):
    """Of the tissue: masses (n,) kg, and alpha, beta of the damping alpha M + beta K."""

    masses_kg: Floats
    alpha_per_s: float
    beta_s: float


@kernel
def free_residual(
    held_forces: Floats, damping_forces: Floats, motion: Motion, inertia: Inertia, unknown: Ints, out: Floats
) -> None:
    """Write out (unknowns,) = - f_tissue - M (v+ - v) / dt - C v+, N: what is missing without the needle.

    damping_forces: (n, 3) N, sum R_e K_e R_e^T v+, if damped.
    """
    x, x_old, v_old, dt = motion
    masses, mass_damping, stiffness_damping = inertia
    for node in range(len(unknown)):
        rank = unknown[node]
        if rank < 0:
            continue
        for i in range(3):
            value = -held_forces[node, i]
            if masses[node] > 0.0 or stiffness_damping > 0.0:
                v = (x[node, i] - x_old[node, i]) / dt
                value -= masses[node] * ((v - v_old[node, i]) / dt + mass_damping * v)
                value -= stiffness_damping * damping_forces[node, i]
            out[3 * rank + i] = value


@kernel
def add_needle_forces(elements: Ints, balls: Balls, force: Floats, unknown: Ints, out: Floats) -> float:
    """Add H_t^T lambda to out (unknowns,): force (a, 3) N world, of the needle on the tissue; returns the largest
    component of the sum, N."""
    _, nodes, weights, touched = balls
    for i in range(len(elements)):
        e = elements[i]
        for k in range(touched[e]):
            rank = unknown[nodes[e, k]]
            if rank >= 0:
                for a in range(3):
                    out[3 * rank + a] += weights[e, k] * force[i, a]
    return largest_size(out)


@kernel
def needle_residual(internal_forces: Floats, beams: Ints, shares: Floats, force: Floats, out: Floats) -> None:
    """Write out (n + 1, 6) = -f_needle - H_n^T lambda; minus row 0 is the wrench of the robot on the base, N and N m.

    shares: (a, 3, 12) gradients of the shaft points; force: (a, 3) N of the needle on the tissue.
    """
    for node in range(len(out)):
        for c in range(6):
            out[node, c] = -internal_forces[node, c]
    for i in range(len(beams)):
        for column in range(12):
            node = beams[i] + column // 6
            for a in range(3):
                out[node, column % 6] -= shares[i, a, column] * force[i, a]


@kernel
def needle_right_sides(beams: Ints, columns: Floats, out: Floats) -> None:
    """Write out (n, 6, 3a): unit world forces at each shaft point as nodal loads on the free nodes 1 ... n."""
    out[:] = 0.0
    for i in range(len(beams)):
        for column in range(12):
            node = beams[i] + column // 6 - 1
            if node >= 0:
                for a in range(3):
                    out[node, column % 6, 3 * i + a] = columns[i, a, column]


@kernel
def moved_shaft(beams: Ints, columns: Floats, base_move: Floats, free_moves: Floats, out: Floats) -> None:
    """Write out (a, 3, k): displacement of each shaft point under moves of nodes (n, 6, k) and base (6, k)."""
    for i in range(len(beams)):
        for a in range(3):
            for k in range(out.shape[2]):
                value = 0.0
                for column in range(12):
                    node = beams[i] + column // 6 - 1
                    if node >= 0:
                        value += columns[i, a, column] * free_moves[node, column % 6, k]
                    else:
                        value += columns[i, a, column] * base_move[column, k]
                out[i, a, k] = value


@kernel
def tissue_moves(elements: Ints, balls: Balls, unknown: Ints, moves: Singles, out: Floats) -> None:
    """Write out (a, 3): displacement of each ball under the nodal moves (unknowns,)."""
    _, nodes, weights, touched = balls
    for i in range(len(elements)):
        e = elements[i]
        out[i, :] = 0.0
        for k in range(touched[e]):
            rank = unknown[nodes[e, k]]
            if rank >= 0:
                for a in range(3):
                    out[i, a] += weights[e, k] * moves[3 * rank + a]


@kernel
def move_nodes(unknown: Ints, moves: Singles, x: Floats) -> None:
    """Add to x (n, 3) the moves (unknowns,) of the free nodes."""
    for node in range(len(unknown)):
        rank = unknown[node]
        if rank >= 0:
            for a in range(3):
                x[node, a] += moves[3 * rank + a]


@kernel
def local_compliance(
    elements: Ints, between: Floats, shaft_moves: Floats, frames: Floats, line: Floats, out: Floats
) -> None:
    """Write out (3a, 3a) = N (G_tissue + G_needle) N^T + C: gap per force in the local frames of both elements.

    between: (3P, 3P) tissue; shaft_moves: (a, 3, 3a) needle, both world; line: C (a, 3, 3), local.
    """
    count = len(elements)
    world = np.empty((3, 3))
    for i in range(count):
        for j in range(count):
            for a in range(3):
                for b in range(3):
                    world[a, b] = between[3 * elements[i] + a, 3 * elements[j] + b] + shaft_moves[i, a, 3 * j + b]
            for a in range(3):
                for b in range(3):
                    value = 0.0
                    for p in range(3):
                        for q in range(3):
                            value += frames[i, a, p] * world[p, q] * frames[j, b, q]
                    out[3 * i + a, 3 * j + b] = value
    add_diagonal(line, out)


@kernel
def to_local(frames: Floats, world: Floats) -> Floats:
    """(a, 3) world vectors in the local frames (a, 3, 3)."""
    out = np.zeros_like(world)
    for i in range(len(world)):
        for a in range(3):
            for b in range(3):
                out[i, a] += frames[i, a, b] * world[i, b]
    return out


@kernel
def to_world(frames: Floats, local: Floats) -> Floats:
    """(a, 3) local vectors in world axes."""
    out = np.zeros_like(local)
    for i in range(len(local)):
        for a in range(3):
            for b in range(3):
                out[i, a] += frames[i, b, a] * local[i, b]
    return out


@kernel
def project_inactive(count: int, active: Flags, balls: Balls, tissue: TissueShape, shaft: Shaft, arc: Floats) -> None:
    """Arc lengths (P,) of the elements that do not constrain: where along the needle they are now."""
    rest, nodes, weights, touched = balls
    p = np.empty(3)
    for e in range(count):
        if not active[e]:
            displaced(rest[e], nodes[e], weights[e], touched[e], tissue.x, tissue.x_rest, p)
            arc[e] = project(shaft.x, shaft.R, shaft.element_length_m, p, arc[e])
