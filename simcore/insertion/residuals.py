"""The residuals of an iterate in one kernel, so that Python is crossed once an evaluation.

The arrays that it takes are bound into tuples once a run or once a try: each of them costs time at every crossing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from simcore.compiled import kernel
from simcore.contact.channel import inserted_rest_length, tributary_lengths
from simcore.contact.kernels import (
    ConstraintPoints,
    Inertia,
    Motion,
    Sticking,
    TissueShape,
    add_needle_forces,
    constraint_geometry,
    free_residual,
    needle_residual,
    project_inactive,
    to_local,
)
from simcore.contact.laws import Law, Staircase, law_residual
from simcore.contact.line import LineCoupling, add_line_gap, largest_gap
from simcore.needle.beam import BeamForces, Section, internal

if TYPE_CHECKING:
    from simcore.arrays import Flags, Floats, Ints
    from simcore.contact.ball import Balls
    from simcore.needle.shaft import Shaft


class Constants(NamedTuple):
    """What a run never changes: of the tissue inertia, ranks of the unknowns (n,) and nodes at rest (n, 3) m; section
    and length of the needle; adhesion per length and Coulomb's coefficient; the coupling along the line."""

    inertia: Inertia
    unknown: Ints
    x_rest: Floats
    section: Section
    needle_length_m: float
    adhesion_n_per_m: float
    friction: float
    line: LineCoupling


class Constraints(NamedTuple):
    """What a step never changes: whether the surface is only touched, the active elements (a,) with their staircases
    and whether they are free sideways (a,); of all elements the balls, rest depths (P,) m and whether they are active
    (P,), and in total how many exist."""

    contact: bool
    elements: Ints
    stair: Staircase
    free: Flags
    balls: Balls
    depth_m: Floats
    active: Flags
    total: int


class Unknowns(NamedTuple):
    """What the iteration changes in place: the shaft; of the active elements points, modes (a,) and adhesion (a,) N;
    arc lengths (P,) m of all elements; slide (2,) of a surface contact; forces (a, 3) N on the tissue, world; way (6,)
    of the base to its goal."""

    shaft: Shaft
    points: ConstraintPoints
    mode: Ints
    adhesion_n: Floats
    all_arcs_m: Floats
    slide: Floats
    force_n: Floats
    base_gap: Floats


class ResidualArrays(NamedTuple):
    """Forces (n, 3) N that hold and that damp the tissue; what is written: residuals of tissue (unknowns,) and needle
    (m + 1, 6), tributary lengths (P,) m, and the beams."""

    held_n: Floats
    damping_n: Floats
    right: Floats
    needle_rest: Floats
    tributary_m: Floats
    beams: BeamForces


@kernel
def residuals(
    constants: Constants,
    constraints: Constraints,
    motion: Motion,
    unknowns: Unknowns,
    arrays: ResidualArrays,
) -> tuple[float, float, float, float, float, float]:
    """Write beams, geometry of the constraints and nodal residuals at an iterate.

    Returns the largest nodal residuals of the tissue, N, and of the needle, N and N m; the largest gap, m; the largest
    distance from a contact law, N; the rest length of channel that the needle occupies, m.
    """
    elements, contact, points = constraints.elements, constraints.contact, unknowns.points
    force = unknowns.force_n
    internal(unknowns.shaft.x, unknowns.shaft.R, constants.section, arrays.beams)
    inserted = locate_constraints(constants, constraints, motion.x, unknowns, arrays.tributary_m)
    local = to_local(points.frames, force)
    if not (contact or constants.line.hard):
        breaks = constraints.stair.breaks
        add_line_gap(constants.line, elements, arrays.tributary_m, inserted, local, unknowns.mode, breaks, points)
        for i in range(len(elements)):
            unknowns.all_arcs_m[elements[i]] = points.arc[i]
    free_residual(arrays.held_n, arrays.damping_n, motion, constants.inertia, constants.unknown, arrays.right)
    tissue = add_needle_forces(elements, constraints.balls, force, constants.unknown, arrays.right)
    needle_residual(arrays.beams.forces, points.beams, points.columns, force, arrays.needle_rest)
    free = arrays.needle_rest[1:]
    law = Law(constraints.stair, unknowns.adhesion_n, constants.friction, contact, constraints.free)
    from_law = law_residual(law, local, unknowns.mode)
    slips = contact and (unknowns.slide[0] != 0.0 or unknowns.slide[1] != 0.0)
    gap = largest_gap(constants.line, constraints.free, slips, points.compliance, points.gap)
    return tissue, largest(free, 0, 3), largest(free, 3, 6), gap, from_law, inserted


@kernel
def locate_constraints(
    constants: Constants, constraints: Constraints, x: Floats, unknowns: Unknowns, tributary: Floats
) -> float:
    """Write the geometry of the constraints and how much channel (P,) m and adhesion belong to each; returns the rest
    length of channel that the needle occupies, m."""
    contact, elements, stair, _, balls, depth, active, count = constraints
    shaft, points, mode, adhesion, arcs = (
        unknowns.shaft,
        unknowns.points,
        unknowns.mode,
        unknowns.adhesion_n,
        unknowns.all_arcs_m,
    )
    tissue, length = TissueShape(x, constants.x_rest), constants.needle_length_m
    sticking = Sticking(mode, stair.breaks, constants.line.hard)
    constraint_geometry(contact, elements, balls, tissue, shaft, sticking, points)
    if contact:
        return 0.0
    for i in range(len(elements)):
        arcs[elements[i]] = points.arc[i]
    project_inactive(count, active, balls, tissue, shaft, arcs)
    inserted = inserted_rest_length(depth, arcs, count, length)
    tributary_lengths(depth, active, count, inserted, tributary)
    for i in range(len(elements)):
        adhesion[i] = constants.adhesion_n_per_m * tributary[elements[i]]
    return inserted


@kernel
def largest(values: Floats, start: int, end: int) -> float:
    """Largest magnitude in the columns `start` to `end` - 1 of values (k, m): NaN if one is, 0 if there is none."""
    most = 0.0
    for i in range(len(values)):
        for j in range(start, end):
            size: float = abs(values[i, j])
            if np.isnan(size):
                return size
            most = max(most, size)
    return most
