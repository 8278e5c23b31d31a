"""The Jacobian by perturbation: the last step solved again for each end-effector dof (Adagolodjo et al. 2016, 2019).

One-sided, forwards: half the re-solves of a central difference, and the axial one stays on the side where the needle
already advances; a central one, at a small time step, would reverse it and average over the jump from slip to stick.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from simcore.errors import ModelFailure, Status
from simcore.insertion import Insertion, InsertionState, Pose
from simcore.linearisation import Linearisation, lateral_offset
from simcore.rotations import exp_map
from simcore.scenario import Solver

Vector = NDArray[np.float64]

FORCE_TOLERANCE_N = 3e-8  # times the compliance under one node, about 30 mm/N, it is the violation below
VIOLATION_TOLERANCE_MM = 1e-6


class Perturbation:
    """Solves perturbed steps of an insertion in work arrays of its own: the insertion itself is not touched."""

    def __init__(self, insertion: Insertion, *, shift_m: float, lever_arm_m: float) -> None:
        """shift_m: move of each translation; a rotation moves a point at the lever arm as far."""
        self.probe = insertion.twin(tight(insertion.scenario.solver))
        self.shift_m, self.lever_arm_m = shift_m, lever_arm_m

    def linearise(self, before: InsertionState, state: InsertionState) -> Linearisation:
        """Of the step from `before` to `state`, solved again to a tight tolerance. Raises ModelFailure."""
        before = replace(before, steps=state.steps - 1)  # the initial state is its own predecessor
        tip, offset = self._solved(before, state.base, np.zeros(6))
        columns = np.empty((5, 6))
        for dof in range(6):
            size = self.shift_m if dof < 3 else self.shift_m / self.lever_arm_m
            moved_tip, moved_offset = self._solved(before, state.base, size * np.eye(6)[dof])
            columns[:3, dof] = (moved_tip - tip) / size
            columns[3:, dof] = (moved_offset - offset) / size
        return Linearisation(columns[:3], columns[3:] if state.inserted_m > 0.0 else None, offset)

    def _solved(self, before: InsertionState, base: Pose, twist: Vector) -> tuple[Vector, Vector]:
        """Tip (3,) m and lateral offsets (2,) m of the shaft at the entry after the step to the moved base."""
        moved = Pose(base.position_m + twist[:3], exp_map(twist[3:]) @ base.rotation)
        after = self.probe.step(before, moved)
        if after.report.status is not Status.COMPLETED:
            raise ModelFailure(after.report.status, f"perturbation Jacobian: {after.report.message}")
        return after.tip_m, lateral_offset(self.probe, after, self.probe.entry_m)[0]


def tight(solver: Solver) -> Solver:
    """The solver's settings with the tolerances that differences need."""
    return solver.model_copy(
        update={
            "force_tolerance_n": min(solver.force_tolerance_n, FORCE_TOLERANCE_N),
            "violation_tolerance_mm": min(solver.violation_tolerance_mm, VIOLATION_TOLERANCE_MM),
        }
    )
