"""Kernels of the coupled step: gaps, frames and gradients of the constraints, residuals, condensed compliance.

The gap of an element is d = p - c(s): material ball p of the tissue minus shaft point c of the needle. Its gradients to
tissue and needle carry the same force with opposite signs, so forces balance exactly, and moments too where a ball is
whole; one that is cut by the surface has its centroid up to 1 mm below its point, and that lever times its force.
"""

from __future__ import annotations

import numpy as np

from simcore.arrays import Flags, Floats, Ints, Singles
from simcore.compiled import kernel
from simcore.contact.ball import displaced
from simcore.contact.channel import project
from simcore.needle.shaft import shaft_columns, shaft_frame


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


@kernel
def constraint_geometry(
    contact: bool,
    surface_frame: Floats,
    elements: Ints,
    rest: Floats,
    nodes: Ints,
    weights: Floats,
    touched: Ints,
    x: Floats,
    x_rest: Floats,
    needle_x: Floats,
    needle_R: Floats,
    element_length: float,
    mode: Ints,
    breaks: Floats,
    arc: Floats,
    speed: Floats,
    frames: Floats,
    gap: Floats,
    beams: Ints,
    columns: Floats,
    points: Floats,
) -> None:
    """Of each active element: arc length (a,), speed |c'| (a,), frame (a, 3, 3), local gap (a, 3) m, beam (a,) and the
    gradient (a, 3, 12) of its shaft point in world axes, and the ball's place (a, 3) m.

    Sticking elements keep the arc length of their breakpoint; all others are projected onto the shaft. The frame of a
    surface contact is surface_frame (3, 3), inward normal last, and its arc length is L + gap along the normal.
    """
    length = element_length * (len(needle_x) - 1)
    for i in range(len(elements)):
        e = elements[i]
        p = points[i]
        displaced(rest[e], nodes[e], weights[e], touched[e], x, x_rest, p)
        if contact:
            s = length
        elif mode[i] % 2 == 1:
            s = breaks[i, mode[i] // 2]
        else:
            s = project(needle_x, needle_R, element_length, p, arc[i])
        c, dc, _, beam, h = shaft_frame(needle_x, needle_R, element_length, s)
        if contact:
            frames[i] = surface_frame
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


@kernel
def tissue_residual(
    held_forces: Floats,
    x: Floats,
    x_old: Floats,
    v_old: Floats,
    masses: Floats,
    damping_forces: Floats,
    dt: float,
    mass_damping: float,
    stiffness_damping: float,
    elements: Ints,
    nodes: Ints,
    weights: Floats,
    touched: Ints,
    force: Floats,
    unknown: Ints,
    out: Floats,
) -> float:
    """out (unknowns,) = H_t^T lambda - f_tissue - M (v+ - v) / dt - C v+; returns its largest component, N.

    force: (a, 3) N world, of the needle on the tissue. damping_forces: sum R_e K_e R_e^T v+, if damped.
    """
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
    for i in range(len(elements)):
        e = elements[i]
        for k in range(touched[e]):
            rank = unknown[nodes[e, k]]
            if rank >= 0:
                for a in range(3):
                    out[3 * rank + a] += weights[e, k] * force[i, a]
    return float(np.abs(out).max())


@kernel
def needle_residual(
    internal_forces: Floats, needle_R: Floats, beams: Ints, shares: Floats, force: Floats, out: Floats
) -> None:
    """out (n + 1, 6) = -f_needle - H_n^T lambda; minus row 0 is the wrench of the robot on the base, N and N m.

    shares: (a, 3, 12) gradients of the shaft points; force: (a, 3) N of the needle on the tissue.
    """
    out[:] = -internal_forces
    for i in range(len(beams)):
        for column in range(12):
            node = beams[i] + column // 6
            for a in range(3):
                out[node, column % 6] -= shares[i, a, column] * force[i, a]


@kernel
def needle_right_sides(beams: Ints, columns: Floats, out: Floats) -> None:
    """out (n, 6, 3a): unit world forces at each shaft point as nodal loads on the free nodes 1 ... n."""
    out[:] = 0.0
    for i in range(len(beams)):
        for column in range(12):
            node = beams[i] + column // 6 - 1
            if node >= 0:
                for a in range(3):
                    out[node, column % 6, 3 * i + a] = columns[i, a, column]


@kernel
def moved_shaft(beams: Ints, columns: Floats, base_move: Floats, free_moves: Floats, out: Floats) -> None:
    """out (a, 3, k): displacement of each shaft point under nodal moves (n, 6, k) and moves of the base (6, k)."""
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
def tissue_moves(
    elements: Ints,
    nodes: Ints,
    weights: Floats,
    touched: Ints,
    unknown: Ints,
    moves: Singles,
    out: Floats,
) -> None:
    """out (a, 3): displacement of each ball under the nodal moves (unknowns,)."""
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
def local_compliance(elements: Ints, between: Floats, shaft_moves: Floats, frames: Floats, out: Floats) -> None:
    """out (3a, 3a) = N (G_tissue + G_needle) N^T: gap per force in the local frames of both elements.

    between: (3P, 3P) tissue; shaft_moves: (a, 3, 3a) needle, both world.
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
def project_inactive(
    count: int,
    active: Flags,
    rest: Floats,
    nodes: Ints,
    weights: Floats,
    touched: Ints,
    x: Floats,
    x_rest: Floats,
    needle_x: Floats,
    needle_R: Floats,
    element_length: float,
    arc: Floats,
) -> None:
    """Arc lengths (P,) of the elements that do not constrain: where along the needle they are now."""
    p = np.empty(3)
    for e in range(count):
        if not active[e]:
            displaced(rest[e], nodes[e], weights[e], touched[e], x, x_rest, p)
            arc[e] = project(needle_x, needle_R, element_length, p, arc[e])
