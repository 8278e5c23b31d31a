"""The laws between needle and tissue, and the small dense problem that enforces all of them at once.

Each element has a local frame (n1, n2, tau). Laterally the needle is held by the tissue in both directions (bilateral).
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

import numpy as np

from simcore.arrays import Floats, Ints
from simcore.compiled import kernel


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


FORCE_SLACK_N = 1e-9  # above the rounding of the dense solve, far below every force tolerance
MODE_SWEEPS = 200
TOGETHER_SWEEPS = 20  # after these, one element at a time changes its mode: no cycles
MERGED_M = 1e-9  # two breakpoints nearer than this are one


@kernel
def staircases(
    contact: bool,
    elements: Ints,
    arc_old: Floats,
    needle_length: float,
    cutting: float,
    puncture: float,
    mode: Ints,
    breaks: Floats,
    steps: Ints,
    sign: Floats,
    extra: Floats,
) -> None:
    """Write the staircase of each active element: steps (a,) breakpoints, breaks (a, 2) m, level k = sign b + extra.

    mode (a,) keeps its meaning where the number of breakpoints has changed since the last step.
    """
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
def level(sign: float, extra: float, base: float, friction: float, lateral: float) -> float:
    """Axial force on a tread of the staircase: sign (tau0 l + mu |lambda_n|) + extra, N."""
    return sign * (base + friction * lateral) + extra


@kernel
def law_residual(force: Floats, mode: Ints, sign: Floats, extra: Floats, base: Floats, friction: float) -> float:
    """Largest distance of the axial force of a sliding element from its level, N; force (a, 3) in local frames."""
    worst = 0.0
    for i in range(len(mode)):
        if mode[i] % 2 == 0:
            k = mode[i] // 2
            lateral = np.hypot(force[i, 0], force[i, 1])
            worst = max(worst, abs(force[i, 2] - level(sign[i, k], extra[i, k], base[i], friction, lateral)))
    return worst


@kernel
def next_mode(
    mode: int,
    count: int,
    arc: float,
    force: float,
    lateral: float,
    breaks: Floats,
    sign: Floats,
    extra: Floats,
    base: float,
    friction: float,
) -> int:
    """The mode itself if arc length and force agree with it, else its neighbour on the staircase."""
    k = mode // 2
    if mode % 2 == 1:
        if force < level(sign[k], extra[k], base, friction, lateral) - FORCE_SLACK_N:
            return mode - 1
        if force > level(sign[k + 1], extra[k + 1], base, friction, lateral) + FORCE_SLACK_N:
            return mode + 1
        return mode
    if k < count and arc < breaks[k]:
        return mode + 1
    if k > 0 and arc > breaks[k - 1]:
        return mode - 1
    return mode


@kernel
def system_rows(
    w: Floats,
    gap: Floats,
    arc: Floats,
    speed: Floats,
    force: Floats,
    around: Floats,
    mode: Ints,
    breaks: Floats,
    sign: Floats,
    extra: Floats,
    base: Floats,
    friction: float,
    slide: Floats,
    sliding: bool,
    surface_friction: float,
    matrix: Floats,
    right: Floats,
) -> None:
    """One linear equation per row for the new local forces: matrix (3a, 3a) force' = right (3a,).

    around (a, 3): the force at which |lambda_n| is linearised. Force rows are scaled by the compliance of their row.
    """
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
            scale = w[row, row]
            k = mode[i] // 2
            matrix[row, :] = 0.0
            matrix[row, row] = scale
            right[row] = scale * (sign[i, k] * base[i] + extra[i, k])
            lateral = np.hypot(around[i, 0], around[i, 1])
            if lateral > 0.0:
                for c in range(2):
                    matrix[row, 3 * i + c] = -scale * sign[i, k] * friction * around[i, c] / lateral
    if sliding:
        for c in range(2):
            scale = w[c, c]
            matrix[c, :] = 0.0
            matrix[c, c] = scale
            matrix[c, 2] = -scale * surface_friction * slide[c]
            right[c] = 0.0


@kernel
def respond(
    w: Floats,
    gap: Floats,
    arc: Floats,
    speed: Floats,
    force: Floats,
    solution: Floats,
    mode: Ints,
    breaks: Floats,
    new_force: Floats,
    new_arc: Floats,
) -> None:
    """Forces (a, 3) N and arcs (a,) m from the solution (3a,) of `system_rows`; a stuck arc is its breakpoint."""
    for i in range(len(mode)):
        moved = gap[i, 2]
        for j in range(len(solution)):
            moved += w[3 * i + 2, j] * (solution[j] - force[j // 3, j % 3])
        new_arc[i] = arc[i] + moved / speed[i]
        if mode[i] % 2 == 1:
            new_arc[i] = breaks[i, mode[i] // 2]
        for c in range(3):
            new_force[i, c] = solution[3 * i + c]


@kernel
def advance_modes(
    force: Floats,
    arc: Floats,
    around: Floats,
    mode: Ints,
    steps: Ints,
    breaks: Floats,
    sign: Floats,
    extra: Floats,
    base: Floats,
    friction: float,
    one_at_a_time: bool,
) -> bool:
    """Move every mode that disagrees with its force and arc to its neighbour, or only the first such; True if all agree
    and |lambda_n| is where it was linearised."""
    settled = True
    for i in range(len(mode)):
        lateral = np.hypot(force[i, 0], force[i, 1])
        wanted = next_mode(
            mode[i], steps[i], arc[i], force[i, 2], lateral, breaks[i], sign[i], extra[i], base[i], friction
        )
        if wanted != mode[i]:
            mode[i] = wanted
            settled = False
            if one_at_a_time:
                break
        drift = abs(lateral - np.hypot(around[i, 0], around[i, 1]))
        if mode[i] % 2 == 0 and friction * drift > FORCE_SLACK_N:
            settled = False
    return settled


@kernel
def solve_laws(
    w: Floats,
    gap: Floats,
    arc: Floats,
    speed: Floats,
    force: Floats,
    mode: Ints,
    steps: Ints,
    breaks: Floats,
    sign: Floats,
    extra: Floats,
    base: Floats,
    friction: float,
    contact: bool,
    slide: Floats,
    new_force: Floats,
    new_arc: Floats,
) -> bool:
    """Forces that satisfy every law for the linear response gap' = gap + w (force' - force).

    w: (3a, 3a) m/N compliance in local frames; gap: (a, 3) m tissue minus needle without a change of force; arc: (a,) m
    and speed |c'(s)|; force: (a, 3) N. mode is updated; slide (2,) is the direction of lateral slip of a surface
    contact. Writes new_force (a, 3) N and new_arc (a,) m; False if no consistent set of modes was found.
    A semismooth Newton (active set) method; the friction bound is linearised in |lambda_n| and repeated to rounding.
    """
    size = len(w)
    matrix, right = np.empty((size, size)), np.empty(size)
    around = force.copy()
    sliding = contact and (slide[0] != 0.0 or slide[1] != 0.0)
    laterally = 0.0 if contact else friction
    for sweep in range(MODE_SWEEPS):
        system_rows(
            w, gap, arc, speed, force, around, mode, breaks, sign, extra, base, laterally, slide, sliding, friction,
            matrix, right,
        )  # fmt: skip
        right[:] = np.linalg.solve(matrix, right)
        respond(w, gap, arc, speed, force, right, mode, breaks, new_force, new_arc)
        settled = advance_modes(
            new_force, new_arc, around, mode, steps, breaks, sign, extra, base, laterally, sweep >= TOGETHER_SWEEPS
        )
        around[:] = new_force
        if contact:
            before0, before1, was = slide[0], slide[1], sliding
            sliding = surface_slip(w, gap, force, new_force, friction, slide)
            if sliding != was or abs(slide[0] - before0) + abs(slide[1] - before1) > 1e-12:
                settled = False
        if settled:
            return True
    return False


@kernel
def surface_slip(w: Floats, gap: Floats, force: Floats, new_force: Floats, friction: float, slide: Floats) -> bool:
    """Coulomb's law of the surface contact (element 0): projects the augmented lateral force onto the friction disc.

    Returns whether it slips; slide (2,) becomes the unit direction of the lateral force, zero while it sticks.
    """
    trial = np.empty(2)
    stiffness = 2.0 / (w[0, 0] + w[1, 1])  # one for both directions, else the slip would not be opposite to the force
    for c in range(2):
        apart = gap[0, c]
        for j in range(3):
            apart += w[c, j] * (new_force[0, j] - force[0, j])
        trial[c] = new_force[0, c] - stiffness * apart
    size = np.hypot(trial[0], trial[1])
    if size <= friction * new_force[0, 2] + FORCE_SLACK_N:
        slide[:] = 0.0
        return False
    slide[0], slide[1] = trial[0] / size, trial[1] / size
    return True
