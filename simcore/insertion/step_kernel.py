"""The iteration of a step as one kernel: Python sees a step, not an iteration.

`iterate` is the algorithm. What it calls are kernels too, each of which can be called from Python; composed there they
give the same bits, which is how the tests look at them one by one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from simcore.compiled import kernel
from simcore.contact.kernels import Motion, move_nodes, moved_shaft, tissue_moves, to_local, to_world
from simcore.contact.laws import Law, Response, solve_laws
from simcore.insertion.compliance import add_columns
from simcore.insertion.residuals import Constants, Constraints, ResidualArrays, Unknowns, residuals
from simcore.insertion.response import needle_loads, responses, with_forces
from simcore.linear_algebra.band import solve_band
from simcore.needle.model import advance, solve_blocks
from simcore.tissue.force_blocks import Blocks, block_forces, damping_forces

if TYPE_CHECKING:
    from simcore.arrays import Floats, Singles

COMPOSED = ("iterate", "evaluate", "correct")  # of kernels: called from Python one by one they do the same
CONVERGED, EXHAUSTED, INFINITE, NO_CONTACT_STATE = range(4)  # how an iteration ends


class Factored(NamedTuple):
    """The tissue's answer: its factor, columns (P, 3, unknowns) m/N of the elements, and the compliance (3P, 3P)
    between them."""

    factor: Singles
    columns: Singles
    between: Floats


class Arrays(NamedTuple):
    """What evaluating and correcting write or read beside the iterate: see their types."""

    residuals: ResidualArrays
    blocks: Blocks
    tissue: Factored


class Missing(NamedTuple):
    """What is missing at an iterate: nodal forces N, gaps m, distances of axial forces from their level N; with it the
    smallest det F, and the rest length of channel that the needle occupies, m."""

    force_n: float
    violation_m: float
    law_n: float
    min_det_f: float
    inserted_m: float


class Allowed(NamedTuple):
    """What may be missing, N and m, and how many corrections may be made."""

    force_n: float
    violation_m: float
    corrections: int


@kernel
def iterate(
    constants: Constants,
    constraints: Constraints,
    motion: Motion,
    unknowns: Unknowns,
    arrays: Arrays,
    allowed: Allowed,
) -> tuple[int, int, Missing]:
    """Evaluate and correct until converged: how it ended, after how many corrections, and what is missing then."""
    for iteration in range(allowed.corrections + 1):
        missing = evaluate(constants, constraints, motion, unknowns, arrays)
        if not is_finite(missing, unknowns.base_gap):
            return INFINITE, iteration, missing
        if converged(missing, unknowns.base_gap, allowed):
            return CONVERGED, iteration, missing
        if iteration == allowed.corrections:
            return EXHAUSTED, iteration, missing
        if not correct(constants, constraints, motion, unknowns, arrays):
            return NO_CONTACT_STATE, iteration, missing
    return EXHAUSTED, 0, missing


@kernel
def evaluate(
    constants: Constants, constraints: Constraints, motion: Motion, unknowns: Unknowns, arrays: Arrays
) -> Missing:
    """True residuals at the present iterate."""
    written = arrays.residuals
    least = block_forces(motion.x, arrays.blocks, written.held_n)
    if constants.inertia.beta_s > 0.0:
        damping_forces(motion.x, motion.x_old, motion.dt_s, arrays.blocks, written.damping_n)
    tissue, force, moment, gap, law, inserted = residuals(constants, constraints, motion, unknowns, written)
    moment /= constants.section.element_length_m
    largest = tissue + force + moment  # not a number if one is not
    if not np.isnan(largest):
        largest = max(tissue, max(force, moment))
    return Missing(largest, gap, law, least, inserted)


@kernel
def is_finite(missing: Missing, base_gap: Floats) -> bool:
    """Whether residuals and the base's way are numbers."""
    total = missing.force_n + missing.violation_m + missing.law_n
    for i in range(len(base_gap)):
        total += abs(base_gap[i])
    return bool(np.isfinite(total))


@kernel
def converged(missing: Missing, base_gap: Floats, allowed: Allowed) -> bool:
    """Whether the base is at its goal and every residual within its tolerance."""
    for i in range(len(base_gap)):
        if base_gap[i] != 0.0:
            return False
    return max(missing.force_n, missing.law_n) <= allowed.force_n and missing.violation_m <= allowed.violation_m


@kernel
def correct(constants: Constants, constraints: Constraints, motion: Motion, unknowns: Unknowns, arrays: Arrays) -> bool:
    """One correction of tissue, needle and forces; False if the contact laws found no consistent state."""
    elements, points, written = constraints.elements, unknowns.points, arrays.residuals
    beams, a = written.beams, len(constraints.elements)
    w, per_force, inverses, multipliers = responses(
        elements, points, beams.diag, beams.upper, beams.lower, arrays.tissue.between
    )
    tissue_step = written.right.astype(np.float32)
    solve_band(arrays.tissue.factor, tissue_step.reshape(1, len(tissue_step)))
    needle_step = needle_loads(written.needle_rest, beams.lower[0], unknowns.base_gap)
    solve_blocks(inverses, multipliers, beams.upper[1:], needle_step)
    tissue_part, shaft_part = np.empty((a, 3)), np.empty((a, 3, 1))
    tissue_moves(elements, constraints.balls, constants.unknown, tissue_step, tissue_part)
    moved_shaft(points.beams, points.columns, unknowns.base_gap.reshape(6, 1), needle_step, shaft_part)
    gap = points.gap + to_local(points.frames, tissue_part - shaft_part[:, :, 0])
    force, new_force, new_arc = to_local(points.frames, unknowns.force_n), np.empty((a, 3)), np.empty(a)
    law = Law(constraints.stair, unknowns.adhesion_n, constants.friction, constraints.contact, constraints.free)
    response = Response(w, gap, points.arc, points.speed, force)
    if a > 0 and not solve_laws(response, law, unknowns.mode, unknowns.slide, new_force, new_arc):
        return False
    change = to_world(points.frames, new_force - force)
    for i in range(a):
        points.arc[i] = new_arc[i]
        for c in range(3):
            unknowns.force_n[i, c] += change[i, c]
    advance(unknowns.shaft.x, unknowns.shaft.R, with_forces(unknowns.base_gap, needle_step, per_force, change))
    unknowns.base_gap[:] = 0.0
    add_columns(elements, arrays.tissue.columns, change, tissue_step)
    move_nodes(constants.unknown, tissue_step, motion.x)
    return True
