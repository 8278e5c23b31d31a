"""The laws between needle and tissue, and the small dense problem that enforces all of them at once.

Each element has a local frame (n1, n2, tau). Laterally the needle is held by the tissue in both directions (bilateral):
hard, or with the line's own compliance (see `line`), gap + C lambda = 0; a free tip bears no lateral force at all.
Axially, force and arc length obey a monotone staircase: while the needle moves forward relative to the tissue, s
falls; where s rests on a breakpoint, any force between two levels is possible (stick), elsewhere the force is a level.

    shaft point      breakpoint s_old           levels -b, +b                 b = tau0 l_i + mu |lambda_n|
    tip, at X_c      breakpoint L               levels -b, b + f_cut          advancing past L cuts
    tip, withdrawn   breakpoints s_old > L      levels -b, +b, b + f_cut      a free gap up to X_c
    surface contact  breakpoint L               levels 0, f_puncture          Signorini; Coulomb laterally

A mode numbers the staircase from behind: 0 = first level, 1 = first breakpoint, 2 = second level, ...
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from simcore.compiled import kernel
from simcore.contact.line import free_rows, lateral_size
from simcore.linear_algebra.dense import factor_lu, solve_lu
from simcore.linear_algebra.entries import copy_rows

if TYPE_CHECKING:
    from simcore.arrays import Flags, Floats, Ints

FORCE_SLACK_N = 1e-9  # above the rounding of the dense solve, far below every force tolerance
MODE_SWEEPS = 200
TOGETHER_SWEEPS = 20  # after these, one element at a time changes its mode: no cycles
MERGED_M = 1e-9  # two breakpoints nearer than this are one


@dataclass(frozen=True)
class ContactLaw:
    """Forces between needle and tissue.

    friction: Coulomb's coefficient. adhesion_n_per_m: shaft force per inserted length without pressure, tau0.
    cutting_n: axial force at which the tip cuts. puncture_n: normal force at which the surface is punctured.
    """

    friction: float
    adhesion_n_per_m: float
    cutting_n: float
    puncture_n: float


class Staircase(NamedTuple):
    """Of each active element: number of breakpoints (a,), breakpoints (a, 2) m, level k = sign b + extra (a, 3) N."""

    steps: Ints
    breaks: Floats
    sign: Floats
    extra: Floats

    @classmethod
    def of_size(cls, elements: int) -> Staircase:
        """Zeros, for so many elements."""
        a = elements
        return cls(np.zeros(a, np.int64), np.zeros((a, 2)), np.zeros((a, 3)), np.zeros((a, 3)))


class Law(NamedTuple):
    """The laws of all active elements: their staircases, adhesion base_n = tau0 l (a,) N, Coulomb's coefficient, and
    whether it is the surface contact, whose Coulomb friction acts laterally and not along the needle."""

    stair: Staircase
    base_n: Floats
    friction: float
    contact: bool
    free: Flags  # (a,) bears no lateral force


class Response(NamedTuple):
    """How the gaps answer to forces, in local frames: gap' = gap + w (force' - force).

    w: (3a, 3a) m/N. gap: (a, 3) m tissue minus needle without a change of force. arc: (a,) m and speed |c'(s)| (a,).
    force: (a, 3) N.
    """

    w: Floats
    gap: Floats
    arc: Floats
    speed: Floats
    force: Floats


@kernel
def staircases(
    contact: bool,
    elements: Ints,
    arc_old: Floats,
    needle_length: float,
    cutting: float,
    puncture: float,
    mode: Ints,
    out: Staircase,
) -> None:
    """Write the staircase of each active element.

    mode (a,) keeps its meaning where the number of breakpoints has changed since the last step.
    """
    steps, breaks, sign, extra = out
    for i in range(len(elements)):
        steps[i] = 1
        sign[i, 0], sign[i, 1], sign[i, 2] = -1.0, 1.0, 1.0
        extra[i, :] = 0.0
        breaks[i, 0], breaks[i, 1] = arc_old[i], needle_length
        if elements[i] == 0 and contact:
            sign[i, :] = 0.0
            extra[i, 1] = puncture
            breaks[i, 0] = needle_length
        elif elements[i] == 0 and arc_old[i] > needle_length + MERGED_M:
            steps[i] = 2
            extra[i, 2] = cutting
        elif elements[i] == 0:
            breaks[i, 0] = needle_length
            extra[i, 1] = cutting
        mode[i] = min(mode[i], 2 * steps[i])


@kernel
def level(law: Law, element: int, k: int, lateral: float) -> float:
    """Axial force on tread k of an element's staircase: sign (tau0 l + mu |lambda_n|) + extra, N."""
    friction = 0.0 if law.contact else law.friction
    stair = law.stair
    force: float = stair.sign[element, k] * (law.base_n[element] + friction * lateral) + stair.extra[element, k]
    return force


@kernel
def law_residual(law: Law, force: Floats, mode: Ints) -> float:
    """Largest distance of the axial force of a sliding element from its level, N; force (a, 3) in local frames."""
    worst = 0.0
    for i in range(len(mode)):
        if mode[i] % 2 == 0:
            lateral = lateral_size(force, i)
            worst = max(worst, abs(force[i, 2] - level(law, i, mode[i] // 2, lateral)))
    return worst


@kernel
def next_mode(law: Law, element: int, mode: int, arc: float, force: float, lateral: float) -> int:
    """The mode itself if arc length and axial force agree with it, else its neighbour on the staircase."""
    k, breaks = mode // 2, law.stair.breaks[element]
    if mode % 2 == 1:
        if force < level(law, element, k, lateral) - FORCE_SLACK_N:
            return mode - 1
        if force > level(law, element, k + 1, lateral) + FORCE_SLACK_N:
            return mode + 1
        return mode
    if k < law.stair.steps[element] and arc < breaks[k]:
        return mode + 1
    if k > 0 and arc > breaks[k - 1]:
        return mode - 1
    return mode


@kernel
def system_rows(
    response: Response,
    law: Law,
    around: Floats,
    mode: Ints,
    slide: Floats,
    sliding: bool,
    matrix: Floats,
    right: Floats,
) -> None:
    """One linear equation per row for the new local forces: matrix (3a, 3a) force' = right (3a,).

    around (a, 3): the force at which |lambda_n| is linearised. Force rows are scaled by the compliance of their row.
    """
    # Duriez et al. 2009 enforce the laws on the condensed problem. A row states a gap, gap + w (force' - force) = goal:
    # laterally 0, along the shaft the way to the breakpoint at which it sticks. Where it slides, a row puts the axial
    # force on its level, |lambda_n| linearised: force'_t - sign mu n . force'_n = sign tau0 l + extra, |n| = 1.
    # Rows of a free tip say force'_n = 0. Compliance along the line is in gap and w already.
    w, gap, arc, speed, force = response
    breaks, sign, extra = law.stair.breaks, law.stair.sign, law.stair.extra
    friction = 0.0 if law.contact else law.friction
    for i in range(len(mode)):
        for c in range(3):
            row = 3 * i + c
            goal = 0.0
            if c == 2 and mode[i] % 2 == 1:
                goal = (breaks[i, mode[i] // 2] - arc[i]) * speed[i]
            right[row] = goal - gap[i, c]
            for j in range(len(w)):
                matrix[row, j] = w[row, j]
                right[row] += w[row, j] * force[j // 3, j % 3]
        if mode[i] % 2 == 0:
            row = 3 * i + 2
            scale, k = w[row, row], mode[i] // 2
            matrix[row, :] = 0.0
            matrix[row, row] = scale
            right[row] = scale * (sign[i, k] * law.base_n[i] + extra[i, k])
            lateral = lateral_size(around, i)
            if lateral > 0.0:
                for c in range(2):
                    matrix[row, 3 * i + c] = -scale * sign[i, k] * friction * around[i, c] / lateral
    free_rows(law.free, w, matrix, right)
    if sliding:
        for c in range(2):
            scale = w[c, c]
            matrix[c, :] = 0.0
            matrix[c, c] = scale
            matrix[c, 2] = -scale * law.friction * slide[c]
            right[c] = 0.0


@kernel
def respond(
    response: Response, stair: Staircase, solution: Floats, mode: Ints, new_force: Floats, new_arc: Floats
) -> None:
    """Forces (a, 3) N and arcs (a,) m from the solution (3a,) of `system_rows`; a stuck arc is its breakpoint."""
    w, gap, arc, speed, force = response
    for i in range(len(mode)):
        moved = gap[i, 2]
        for j in range(len(solution)):
            moved += w[3 * i + 2, j] * (solution[j] - force[j // 3, j % 3])
        new_arc[i] = arc[i] + moved / speed[i]
        if mode[i] % 2 == 1:
            new_arc[i] = stair.breaks[i, mode[i] // 2]
        for c in range(3):
            new_force[i, c] = solution[3 * i + c]


@kernel
def advance_modes(law: Law, force: Floats, arc: Floats, around: Floats, mode: Ints, one_at_a_time: bool) -> bool:
    """Move every mode that disagrees with its force and arc to its neighbour, or only the first such; True if all agree
    and |lambda_n| is where it was linearised."""
    friction = 0.0 if law.contact else law.friction
    settled = True
    for i in range(len(mode)):
        lateral = lateral_size(force, i)
        wanted = next_mode(law, i, mode[i], arc[i], force[i, 2], lateral)
        if wanted != mode[i]:
            mode[i] = wanted
            settled = False
            if one_at_a_time:
                break
        drift = abs(lateral - lateral_size(around, i))
        if mode[i] % 2 == 0 and friction * drift > FORCE_SLACK_N:
            settled = False
    return settled


@kernel
def solve_laws(response: Response, law: Law, mode: Ints, slide: Floats, new_force: Floats, new_arc: Floats) -> bool:
    """Forces that satisfy every law for a linear response of the gaps.

    mode is updated; slide (2,) is the direction of lateral slip of a surface contact. Writes new_force (a, 3) N and
    new_arc (a,) m; False if no consistent set of modes was found.
    A semismooth Newton (active set) method; the friction bound is linearised in |lambda_n| and repeated to rounding.
    """
    size = len(response.w)
    matrix, right, pivots = np.empty((size, size)), np.empty(size), np.empty(size, np.int64)
    around = response.force.copy()
    sliding = law.contact and (slide[0] != 0.0 or slide[1] != 0.0)
    for sweep in range(MODE_SWEEPS):
        system_rows(response, law, around, mode, slide, sliding, matrix, right)
        if not factor_lu(matrix, pivots):
            return False
        solve_lu(matrix, pivots, right.reshape(size, 1))
        respond(response, law.stair, right, mode, new_force, new_arc)
        settled = advance_modes(law, new_force, new_arc, around, mode, sweep >= TOGETHER_SWEEPS)
        copy_rows(new_force, around)
        if law.contact:
            before0, before1, was = slide[0], slide[1], sliding
            sliding = surface_slip(response, law.friction, new_force, slide)
            if sliding != was or abs(slide[0] - before0) + abs(slide[1] - before1) > 1e-12:
                settled = False
        if settled:
            return True
    return False


@kernel
def surface_slip(response: Response, friction: float, new_force: Floats, slide: Floats) -> bool:
    """Coulomb's law of the surface contact (element 0): projects the augmented lateral force onto the friction disc.

    Returns whether it slips; slide (2,) becomes the unit direction of the lateral force, zero while it sticks.
    """
    w, gap, force = response.w, response.gap, response.force
    trial = np.empty(2)
    stiffness = 2.0 / (w[0, 0] + w[1, 1])  # one for both directions, else the slip would not be opposite to the force
    for c in range(2):
        apart = gap[0, c]
        for j in range(3):
            apart += w[c, j] * (new_force[0, j] - force[0, j])
        trial[c] = new_force[0, c] - stiffness * apart
    size = np.sqrt(trial[0] ** 2 + trial[1] ** 2)
    if size <= friction * new_force[0, 2] + FORCE_SLACK_N:
        slide[:] = 0.0
        return False
    slide[0], slide[1] = trial[0] / size, trial[1] / size
    return True
