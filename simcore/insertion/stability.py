"""Whether the needle would stay where it is: Euler's question, asked of the needle as the tissue holds it.

The equilibrium of a pushed needle is stable while its tangent, with the tissue's stiffness at the constraint points
added to it, is positive definite. Where it stops being so the load has a limit: the needle buckles.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from simcore.linear_algebra.dense import is_positive_definite, solved_system
from simcore.linear_algebra.products import product

if TYPE_CHECKING:
    from simcore.arrays import Floats
    from simcore.insertion.model import CoupledModel
    from simcore.insertion.state import SolvedStep

NODE = 6  # degrees of freedom


def least_buckling_force_n(model: CoupledModel, free_m: float) -> float:
    """A bound below which no needle buckles: Euler's force of a cantilever of the free length (m), pi^2 EI / (2 l)^2.

    The tissue holds the other end as well, which only raises it.
    """
    return float(np.pi**2 * model.needle.bending_nm2 / (2.0 * max(free_m, model.needle.element_length_m)) ** 2)


def is_stable(model: CoupledModel, solved: SolvedStep, *, load: float = 1.0) -> bool:
    """Whether the solved step is a stable equilibrium; with `load`, under so many times its axial forces.

    The frames of the constraint points are taken as they are, and sliding points give no axial stiffness.
    """
    needle = _needle_tangent(solved) + (load - 1.0) * _stiffness_of_tension(model, solved)
    rows, compliance = _held_rows(solved)
    held = needle + product(rows.T, solved_system(compliance, rows)) if len(rows) else needle
    scale = np.tile(np.repeat([1.0, 1.0 / model.needle.element_length_m], 3), len(held) // NODE)
    return is_positive_definite(0.5 * (held + held.T) * np.outer(scale, scale))


def _needle_tangent(solved: SolvedStep) -> Floats:
    """(6n, 6n) of the free nodes."""
    beams = solved.beams
    n = len(beams.upper)
    tangent = np.zeros((NODE * n, NODE * n))
    for i in range(n):
        here = slice(NODE * i, NODE * (i + 1))
        tangent[here, here] = beams.diag[i + 1]
        if i + 1 < n:
            after = slice(NODE * (i + 1), NODE * (i + 2))
            tangent[here, after], tangent[after, here] = beams.upper[i + 1], beams.lower[i + 1]
    return tangent


def _stiffness_of_tension(model: CoupledModel, solved: SolvedStep) -> Floats:
    """(6n, 6n) the part of the tangent that is proportional to the beams' tensions: the consistent geometric stiffness
    of a beam-column (Przemieniecki, "Theory of matrix structural analysis", 1968, chapter 15)."""
    x, rest = solved.bodies.needle_x, model.needle.element_length_m
    chords = np.diff(x, axis=0)
    lengths = np.linalg.norm(chords, axis=1)
    tensions = model.needle.axial_n * (lengths / rest - 1.0)
    n = len(chords)
    full = np.zeros((NODE * (n + 1), NODE * (n + 1)))
    for i in range(n):
        axis = chords[i] / lengths[i]
        across = np.eye(3) - np.outer(axis, axis)
        # a slope w' along the chord is the spin axis x w': `turn` takes a spin to the slope that it is
        turn = np.array([[0.0, axis[2], -axis[1]], [-axis[2], 0.0, axis[0]], [axis[1], -axis[0], 0.0]])
        slope, h = [np.eye(3), turn, np.eye(3), turn], lengths[i]
        shape = np.array(
            [
                [6 / (5 * h), 1 / 10, -6 / (5 * h), 1 / 10],
                [1 / 10, 2 * h / 15, -1 / 10, -h / 30],
                [-6 / (5 * h), -1 / 10, 6 / (5 * h), -1 / 10],
                [1 / 10, -h / 30, -1 / 10, 2 * h / 15],
            ]
        )
        for a in range(4):
            for b in range(4):
                block = tensions[i] * shape[a, b] * product(product(slope[a].T, across), slope[b])
                row, column = NODE * i + 3 * a, NODE * i + 3 * b
                full[row : row + 3, column : column + 3] += block
    return full[NODE:, NODE:]


def _held_rows(solved: SolvedStep) -> tuple[Floats, Floats]:
    """(r, 6n) how the held directions of the constraint points move with the needle, and the compliance of tissue and
    line (r, r) m/N in them: across the shaft, along it too where a point sticks; in the surface unless the tip
    slips."""
    at, active = solved.at, solved.active
    points, a, n = at.points, len(active.elements), len(solved.beams.upper)
    moves = np.zeros((a, 3, NODE * (n + 1)))
    for i in range(a):
        first = NODE * points.beams[i]
        moves[i, :, first : first + 2 * NODE] = product(points.frames[i], points.columns[i])
    keep = np.ones((a, 3), bool)
    keep[:, 2] = at.mode % 2 == 1
    keep[active.free, :2] = False
    if active.contact and at.slide.any():
        keep[:, :2] = False
    between = solved.between_m_per_n.reshape(-1, 3, solved.between_m_per_n.shape[1] // 3, 3)
    world = between[active.elements][:, :, active.elements]
    local = np.einsum("iab,ibjc,jdc->iajd", points.frames, world, points.frames)
    local[np.arange(a), :, np.arange(a), :] += points.compliance
    kept = keep.ravel()
    compliance: Floats = local.reshape(3 * a, 3 * a)[np.ix_(kept, kept)]
    return moves.reshape(3 * a, -1)[kept, NODE:], compliance
