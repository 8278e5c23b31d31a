"""The Jacobian by perturbation: the last step solved again for each end-effector dof (Adagolodjo et al. 2016, 2019).

One-sided, forwards: half the re-solves of a central difference, and the axial one stays on the side where the needle
already advances; a central one, at a small time step, would reverse it and average over the jump from slip to stick.
Each solve begins at a first guess: the unperturbed one at the insertion's own solution, the others where its linear
response leads, and as far beyond as the same perturbation ended after the step before. Guesses only save iterations:
what is differenced has converged to the tight tolerance below. Of a linearised model the linearised steps are
differenced: each from the same start, to first order in the base's move.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from simcore.contact.channel import Phase
from simcore.errors import ModelFailureError, Status
from simcore.insertion.jacobian_fast import Linearisation, base_moves, lateral_offset
from simcore.insertion.state import Bodies, Guess, Pose, SolvedStep
from simcore.linear_algebra.products import product, times
from simcore.needle.model import advance, increments
from simcore.rotations import compose, exp_map

if TYPE_CHECKING:
    from simcore.arrays import Floats, Ints, Singles
    from simcore.insertion.insertion import Insertion, InsertionState
    from simcore.insertion.model import CoupledModel, Tolerances

# Jacobians along `sine` then miss fully converged ones by at most 1e-5, a twentieth of what one-sided differences do
FORCE_TOLERANCE_N = 1e-7  # times the compliance under one node, about 30 mm/N, it is the violation below
VIOLATION_TOLERANCE_M = 3e-9


class Perturbation:
    """Solves perturbed steps of an insertion in work arrays of its own: the insertion itself is not touched."""

    def __init__(self, insertion: Insertion, *, shift_m: float, lever_arm_m: float) -> None:
        """shift_m: move of each translation; a rotation moves a point at the lever arm as far."""
        self.insertion, self.probe = insertion, insertion.with_tolerances(tight(insertion.model.tolerances))
        self.shift_m, self.lever_arm_m = shift_m, lever_arm_m
        self.beyond: dict[int, Beyond] = {}

    def linearise(self, before: InsertionState, state: InsertionState) -> Linearisation:
        """Of the step from `before` to `state`, solved again (to a tight tolerance, unless linearised). Raises
        ModelFailureError."""
        before = replace(before, steps=state.steps - 1)  # the initial state is its own predecessor
        # the step of the puncture is solved from its start, as a linearised one always is
        guessed = before.channel.phase is Phase.INSERTED and not self.probe.model.linearised
        at = state.solved.at
        solved = self._solved(before, state.base, Guess(at.bodies.copy(), at.force_n, at.mode) if guessed else None)
        tip, offset = self._measured(solved)
        response = self._response(solved) if guessed else None
        columns = np.empty((5, 6))
        for dof in range(6):
            twist = np.zeros(6)
            twist[dof] = size = self.shift_m if dof < 3 else self.shift_m / self.lever_arm_m
            base = Pose(state.base.position_m + twist[:3], compose(exp_map(twist[3:]), state.base.rotation))
            linear = response.guess(twist) if response else None
            moved_tip, moved_offset = self._measured(self._perturbed(before, base, dof, linear))
            columns[:3, dof] = (moved_tip - tip) / size
            columns[3:, dof] = (moved_offset - offset) / size
        return Linearisation(columns[:3], columns[3:] if state.inserted_m > 0.0 else None, offset)

    def _perturbed(self, before: InsertionState, base: Pose, dof: int, linear: Guess | None) -> SolvedStep:
        """`_solved` from the linear prediction and what this dof had beyond it last time, which is kept."""
        if linear is None:
            return self._solved(before, base, None)
        elements = before.channel.active_elements()
        first = self.beyond[dof].added(linear, elements) if dof in self.beyond else linear.copy()
        solved = self._solved(before, base, first)
        self.beyond[dof] = Beyond.of(linear, solved)
        return solved

    def _solved(self, before: InsertionState, base: Pose, guess: Guess | None) -> SolvedStep:
        """The step to `base`. Raises ModelFailureError."""
        solved = self.probe.solve(before, base, guess)
        if solved.report.status is not Status.COMPLETED:
            raise ModelFailureError(solved.report.status, f"perturbation Jacobian: {solved.report.message}")
        return solved

    def _measured(self, solved: SolvedStep) -> tuple[Floats, Floats]:
        """Tip (3,) m and lateral offsets (2,) m of the shaft at the entry after a step."""
        offset = lateral_offset(self.probe.model, solved.bodies, solved.at.inserted_m)[0]
        return solved.bodies.needle_x[-1], offset

    def _response(self, solved: SolvedStep) -> Response:
        """Of the probe's last step."""
        columns = self.probe.workspace.compliance.columns[solved.active.elements]
        return Response.of(self.probe.model, solved, columns.reshape(-1, columns.shape[2]))


@dataclass(frozen=True)
class Response:
    """A solved state, and how it follows its base to first order: nodes of the tissue (n, 3, 6) and of the needle
    (m, 6, 6), forces (a, 3, 6) N."""

    state: Guess
    tissue: Floats
    needle: Floats
    forces: Floats

    @classmethod
    def of(cls, model: CoupledModel, solved: SolvedStep, columns: Singles) -> Response:
        """Of a solved step; columns (3a, unknowns) m/N: the tissue's moves under unit forces on its active elements."""
        moves = base_moves(model, solved)
        needle, forces = moves.of_all_nodes(), moves.change
        tissue, unknown = np.zeros((len(solved.bodies.x), 3, 6)), model.tissue.unknown
        free = unknown >= 0
        tissue[free] = product(columns.T.astype(float), forces).reshape(-1, 3, 6)[unknown[free]]
        state = Guess(solved.bodies.copy(), solved.at.force_n, solved.at.mode.copy())
        return cls(state, tissue, np.concatenate([np.eye(6)[None], needle]), forces.reshape(-1, 3, 6))

    def guess(self, twist: Floats) -> Guess:
        """The state after a twist (6,) m, rad of the base."""
        bodies: Bodies = self.state.bodies.copy()
        bodies.x += times(self.tissue, twist)
        advance(bodies.needle_x, bodies.needle_R, times(self.needle, twist))
        return Guess(bodies, self.state.force_n + times(self.forces, twist), self.state.mode)


@dataclass(frozen=True)
class Beyond:
    """What a solution had that its linear prediction had not: moves of the tissue (n, 3) m and of the needle (m, 6),
    forces (P, 3) N of all elements of the channel."""

    tissue: Floats
    needle: Floats
    forces: Floats

    @classmethod
    def of(cls, linear: Guess, solved: SolvedStep) -> Beyond:
        """Of the solution of a step."""
        guessed, bodies, active = linear.bodies, solved.bodies, solved.active
        forces = np.zeros_like(active.channel.force_n)
        forces[active.elements] = solved.at.force_n - linear.force_n
        needle = increments(guessed.needle_x, guessed.needle_R, bodies.needle_x, bodies.needle_R)
        return cls(bodies.x - guessed.x, needle, forces)

    def added(self, linear: Guess, elements: Ints) -> Guess:
        """The prediction corrected by as much; elements (a,): the active ones."""
        bodies = linear.bodies.copy()
        bodies.x += self.tissue
        advance(bodies.needle_x, bodies.needle_R, self.needle)
        return Guess(bodies, linear.force_n + self.forces[elements], linear.mode)


def tight(tolerances: Tolerances) -> Tolerances:
    """As tight as differences need, with as many iterations."""
    return replace(
        tolerances,
        force_n=min(tolerances.force_n, FORCE_TOLERANCE_N),
        violation_m=min(tolerances.violation_m, VIOLATION_TOLERANCE_M),
    )
