"""The needle's side of the exact linearisation: how forces and arc lengths answer to moves of tissue and base.

Linear in the changes of the constraint forces dF (a, 3) N, world, of the arc lengths ds (a,) m, of the needle's base
(6,) and of the places of the material balls dp (p, 3) m, with every mode of the converged step frozen:

    needle       K dq + C^T dF + (C'^T F) ds + (t x h F turning with t) dq = 0       C = dc/dq at fixed s, ' = d/ds
    gap          dp - C dq - c' ds = 0                                               ds = 0 while it sticks
    friction     d(F . tau) = sign (tau0 dl + mu d|F - (F . tau) tau|)               tau = c' / |c'|

after Duriez et al. 2009 and our laws (see `contact.laws`), and what the line's coupling adds (`line_tangent`). The
needle is eliminated by its block tridiagonal factor.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from simcore.compiled import kernel
from simcore.contact.channel import tributary_lengths
from simcore.contact.kernels import moved_shaft, needle_right_sides
from simcore.contact.line import coupled_length
from simcore.insertion.line_tangent import Lengths, Turning, add_line_rows, projected_arcs
from simcore.linear_algebra.products import dot, norm, product, times
from simcore.needle.model import factor_blocks, solve_blocks
from simcore.needle.shaft import Shaft, shaft_columns, shaft_frame, shaft_weights

if TYPE_CHECKING:
    from simcore.arrays import Flags, Floats, Ints
    from simcore.insertion.model import CoupledModel
    from simcore.insertion.state import Bodies, SolvedStep

LENGTH_STEP_M = 1e-7  # tributary and coupled lengths are piecewise linear: a difference is their slope


class ShaftPoints(NamedTuple):
    """Points of the shaft: what its Hermite curve and their gradients to the two nodes of their beams are."""

    beams: Ints  # (p,)
    columns: Floats  # (p, 3, 12) dc/dq
    slopes: Floats  # (p, 3, 12) dc'/dq
    levers: Floats  # (p, 2) m, weights of the two nodal tangents in c
    c: Floats  # (p, 3) m
    dc: Floats  # (p, 3) c'
    ddc: Floats  # (p, 3) c'', 1/m


@dataclass(frozen=True)
class ConstraintTangent:
    """matrix (4a, 4a) y + per_ball (4a, 3p) dp + per_base (4a, 6) = 0 for y = (dF, ds)."""

    elements: Ints  # (p,) a that constrain, then those that only bound the tip's place in the channel
    matrix: Floats
    per_ball: Floats
    per_base: Floats
    moves: Floats  # (n, 6, 4a + 6) of the needle's free nodes per y and per move of the base


@kernel
def fill_points(shaft: Shaft, arcs: Floats, out: ShaftPoints) -> None:
    """Write the points at the arc lengths (p,) m."""
    needle_x, needle_R, element_length = shaft
    beams, columns, slopes, levers, c, dc, ddc = out
    for i in range(len(arcs)):
        place, first, second, beams[i], _ = shaft_frame(needle_x, needle_R, element_length, arcs[i])
        for k in range(3):
            c[i, k], dc[i, k], ddc[i, k] = place[k], first[k], second[k]
        beam, weights = shaft_weights(len(needle_x) - 1, element_length, arcs[i])
        shaft_columns(needle_R, beam, weights[0], columns[i])
        shaft_columns(needle_R, beam, weights[1], slopes[i])
        levers[i, 0], levers[i, 1] = weights[0, 1], weights[0, 3]


def shaft_points(bodies: Bodies, element_length_m: float, arcs: Floats) -> ShaftPoints:
    """The shaft at the arc lengths (p,) m."""
    p = len(arcs)
    points = ShaftPoints(
        np.zeros(p, np.int64),
        np.empty((p, 3, 12)),
        np.empty((p, 3, 12)),
        np.empty((p, 2)),
        *(np.empty((p, 3)) for _ in range(3)),
    )
    fill_points(Shaft(bodies.needle_x, bodies.needle_R, element_length_m), arcs, points)
    return points


def shaft_changes(points: ShaftPoints, moves: Floats, base: Floats) -> tuple[Floats, Floats]:
    """(p, 3, k) changes of c and of c' at fixed s, under nodal moves (n, 6, k) and moves of the base (6, k)."""
    size = (len(points.beams), 3, moves.shape[2])
    shaft, turn = np.empty(size), np.empty(size)
    moved_shaft(points.beams, points.columns, base, moves, shaft)
    moved_shaft(points.beams, points.slopes, base, moves, turn)
    return shaft, turn


def inserted_slopes(depth: Floats, arc: Floats, count: int, needle_length: float) -> dict[int, float]:
    """Derivative of `inserted_rest_length` to the arc length of each element that it depends on."""
    if arc[0] <= needle_length:
        return {0: -1.0}
    if arc[1] >= needle_length:
        return {}
    behind = 1
    for k in range(2, count + 1):
        ahead = k % count
        if arc[ahead] > needle_length:
            width = (arc[ahead] - arc[behind]) ** 2 / (depth[ahead] - depth[behind])
            return {behind: -(arc[ahead] - needle_length) / width, ahead: -(needle_length - arc[behind]) / width}
        behind = ahead
    return {}


def constraint_tangent(model: CoupledModel, solved: SolvedStep) -> ConstraintTangent:
    """Of a converged step."""
    active, at, needle = solved.active, solved.at, model.needle
    a, contact, channel = len(active.elements), active.contact, active.channel
    placed = projected_arcs(solved)
    slopes = {} if contact else inserted_slopes(channel.depth_m, placed, channel.count, needle.length_m)
    beside = [j for j in slopes if not channel.active[j]]
    elements = np.array([*active.elements, *beside], np.int64)
    arcs = np.full(len(elements), needle.length_m) if contact else placed[elements]
    points = shaft_points(solved.bodies, needle.element_length_m, arcs)
    moves = _needle_moves(model, solved, points)
    base = np.zeros((6, 4 * a + 6))
    base[:, 4 * a :] = np.eye(6)
    shaft, turn = shaft_changes(points, moves, base)
    own = np.arange(a)
    shaft[own, :, 3 * a + own] += points.dc[:a]
    turn[own, :, 3 * a + own] += points.ddc[:a]
    rows, per_ball = np.zeros((4 * a, 4 * a + 6)), np.zeros((4 * a, 3 * len(elements)))
    rows[: 3 * a] = -shaft[:a].reshape(3 * a, 4 * a + 6)
    per_ball[: 3 * a, : 3 * a] = np.eye(3 * a)
    rows[3 * a + own, 3 * a + own] = 1.0  # ds = 0, unless it slides
    slides = at.mode % 2 == 0
    if contact:
        _surface_rows(model, solved, rows, per_ball)
        return ConstraintTangent(elements, rows[:, : 4 * a], per_ball, rows[:, 4 * a :], moves)
    tributary, coupled = _lengths(model, solved, elements, points, slopes, (shaft, turn))
    if slides.any():
        _friction_rows(model, solved, slides, turn[:a], points.dc[:a], rows)
        _subtract_lengths(model, solved, slides, tributary, rows, per_ball)
    if not model.line.hard or model.line.free_tip:
        add_line_rows(model, solved, Turning(points.dc[:a], turn[:a]), coupled, rows, per_ball)
    return ConstraintTangent(elements, rows[:, : 4 * a], per_ball, rows[:, 4 * a :], moves)


def _needle_moves(model: CoupledModel, solved: SolvedStep, points: ShaftPoints) -> Floats:
    """(n, 6, 4a + 6): moves of the free nodes per dF, ds and per move of the base, all else held."""
    a, n = len(solved.active.elements), model.needle.elements
    diag = solved.beams.diag.copy()
    lever_tangent(solved.bodies.needle_R, points.beams[:a], points.levers[:a], solved.at.force_n, diag)
    moves = np.zeros((n, 6, 4 * a + 6))
    per_force = np.empty((n, 6, 3 * a))
    needle_right_sides(points.beams[:a], points.columns[:a], per_force)
    moves[:, :, : 3 * a] = -per_force
    needle_right_sides(points.beams[:a], points.slopes[:a], per_force)
    moves[:, :, 3 * a : 4 * a] = -np.einsum("ndib,ib->ndi", per_force.reshape(n, 6, a, 3), solved.at.force_n)
    moves[0, :, 4 * a :] = -solved.beams.lower[0]
    factor = factor_blocks(diag[1:], solved.beams.upper[1:], solved.beams.lower[1:])
    solve_blocks(*factor, solved.beams.upper[1:], moves)
    return moves


@kernel
def lever_tangent(needle_R: Floats, beams: Ints, levers: Floats, force: Floats, diag: Floats) -> None:
    """Add to diag (n + 1, 6, 6) the change of the moments t x (h F) with the spin of their node: t F^T - (t . F) I."""
    for i in range(len(beams)):
        for node in range(2):
            block, t = diag[beams[i] + node], needle_R[beams[i] + node, :, 2].copy()
            along = t[0] * force[i, 0] + t[1] * force[i, 1] + t[2] * force[i, 2]
            for p in range(3):
                block[3 + p, 3 + p] -= levers[i, node] * along
                for q in range(3):
                    block[3 + p, 3 + q] += levers[i, node] * t[p] * force[i, q]


def _friction_rows(
    model: CoupledModel, solved: SolvedStep, slides: Flags, turn: Floats, dc: Floats, rows: Floats
) -> None:
    """Rows tau . dF + F . dtau - sign mu d|F_lateral| = 0 where it slides; tributary lengths are added afterwards."""
    a = len(slides)
    tau = solved.at.points.frames[:, 2]
    along = np.einsum("ib,ib->i", solved.at.force_n, tau)
    lateral = solved.at.force_n - along[:, None] * tau
    size = np.linalg.norm(lateral, axis=1)
    normal = lateral / np.where(size > 0.0, size, 1.0)[:, None]
    pull = solved.active.stair.sign[np.arange(a), solved.at.mode // 2] * model.law.friction
    by_turn = ((size + pull * along) / np.linalg.norm(dc, axis=1))[:, None] * normal
    law = np.einsum("ib,ibk->ik", by_turn, turn)
    own = np.arange(a)
    for b in range(3):
        law[own, 3 * own + b] += tau[:, b] - pull * normal[:, b]
    rows[3 * a :][slides] = law[slides]


def _lengths(
    model: CoupledModel,
    solved: SolvedStep,
    elements: Ints,
    points: ShaftPoints,
    slopes: dict[int, float],
    changes: tuple[Floats, Floats],
) -> tuple[Lengths, Lengths]:
    """Of the active elements: the tributary lengths, and those that they are coupled over. Both follow the inserted
    length, piecewise linearly."""
    inserted, by_ball = _inserted_row(model, solved, elements, points, slopes, changes)
    now = _lengths_at(model, solved, solved.at.inserted_m)
    longer = _lengths_at(model, solved, solved.at.inserted_m + LENGTH_STEP_M)
    tributary, coupled = (
        Lengths(length, np.outer(growth, inserted), np.outer(growth, by_ball))
        for length, growth in zip(now, (longer - now) / LENGTH_STEP_M, strict=True)
    )
    return tributary, coupled


def _lengths_at(model: CoupledModel, solved: SolvedStep, inserted_m: float) -> Floats:
    """(2, a) m: tributary and coupled lengths of the active elements if so much of the needle were in the channel."""
    channel, active = solved.active.channel, solved.active.elements
    tributary = np.zeros(channel.count)
    tributary_lengths(channel.depth_m, channel.active, channel.count, inserted_m, tributary)
    coupled = [coupled_length(model.line, element, tributary[element], inserted_m) for element in active]
    return np.array([tributary[active], coupled])


def _inserted_row(
    model: CoupledModel,
    solved: SolvedStep,
    elements: Ints,
    points: ShaftPoints,
    slopes: dict[int, float],
    changes: tuple[Floats, Floats],
) -> tuple[Floats, Floats]:
    """Change of the inserted length: (4a + 6,) per y and move of the base, (3p,) per move of the balls."""
    a = len(solved.active.elements)
    shaft, turn = changes
    row, by_ball = np.zeros(shaft.shape[2]), np.zeros(3 * len(elements))
    for i, element in enumerate(elements):
        slope = slopes.get(int(element), 0.0)
        if i < a:
            row[3 * a + i] += slope
            continue
        apart = solved.active.channel.position(model.channel, int(element), solved.bodies.x) - points.c[i]
        slope /= dot(points.dc[i], points.dc[i]) - dot(apart, points.ddc[i])
        row += slope * (times(turn[i].T, apart) - times(shaft[i].T, points.dc[i]))
        by_ball[3 * i : 3 * i + 3] = slope * points.dc[i]
    return row, by_ball


def _subtract_lengths(
    model: CoupledModel,
    solved: SolvedStep,
    slides: Flags,
    tributary: Lengths,
    rows: Floats,
    per_ball: Floats,
) -> None:
    """Rows sign tau0 dl where it slides."""
    for i in np.flatnonzero(slides):
        pull = solved.active.stair.sign[i, solved.at.mode[i] // 2] * model.law.adhesion_n_per_m
        rows[3 * len(slides) + i] -= pull * tributary.change[i]
        per_ball[3 * len(slides) + i] -= pull * tributary.by_ball[i]


def _surface_rows(model: CoupledModel, solved: SolvedStep, rows: Floats, per_ball: Floats) -> None:
    """Contact before puncture: Signorini along the surface's normal; while it slides, F_lateral = mu F_n u, u against
    the lateral gap. The gap rows become those of the surface's frame."""
    frame = solved.at.points.frames[0]
    rows[:3], per_ball[:3] = product(frame, rows[:3]), product(frame, per_ball[:3])
    force = np.zeros((3, rows.shape[1]))
    force[:, :3] = frame
    if solved.at.mode[0] != 1:
        rows[2], per_ball[2] = force[2], 0.0
    if not solved.at.slide.any():
        return
    mu, distance = model.law.friction, norm(solved.at.points.gap[0, :2])
    across = np.eye(2) - np.outer(solved.at.slide, solved.at.slide)
    pressure = dot(frame[2], solved.at.force_n[0])
    by_gap = mu * pressure / distance * across if distance > 0.0 else np.zeros((2, 2))
    rows[:2] = product(by_gap, rows[:2]) + force[:2] - mu * np.outer(solved.at.slide, force[2])
    per_ball[:2] = product(by_gap, per_ball[:2])
