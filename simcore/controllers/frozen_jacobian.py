"""Visual servoing with a frozen Jacobian: T = P + J^+ (k e_p), J computed once and kept (Chaumette and Hutchinson
2006, constant interaction matrix). What I-FEM gains by linearising anew at every step is the distance to this."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from simcore.controllers.plant_model import model_scenario
from simcore.controllers.remote_centre import following_response, pose_through
from simcore.controllers.selective_inverse import selective_move
from simcore.errors import ModelFailureError, Status
from simcore.insertion.jacobian_fast import linearise
from simcore.insertion.state import Pose
from simcore.linear_algebra.products import norm
from simcore.scenario.build import insertion_of

if TYPE_CHECKING:
    from simcore.arrays import Floats
    from simcore.episode.observation import Observation
    from simcore.insertion.insertion import InsertionState
    from simcore.scenario.scenario import FrozenJacobian, Scenario

STEP_M = 0.5e-3  # advance of the own insertion: quasi-static, its end does not depend on the pace


class FrozenJacobianController:
    """J (3, 3) is the tip's response to the base's position in an insertion of its own, pushed straight along the
    path's first tangent to one depth; the base's axis passes through the entry, there as here."""

    limited = True

    def __init__(self, settings: FrozenJacobian, scenario: Scenario, entry_m: Floats) -> None:
        self.entry_m = entry_m
        self.failure: ModelFailureError | None = None
        try:
            self.jacobian = straight_jacobian(settings, scenario)
        except ModelFailureError as failure:
            self.failure = failure  # of the run and not of its preparation: the first command tells it
            return
        self.gain, self.largest_m = settings.gain, 1e-3 * settings.direction_speed_mm_s * scenario.dt_s

    def command(self, observation: Observation) -> Pose:
        """One step down the observed error along the kept directions. Raises ModelFailureError if there are none."""
        if self.failure is not None:
            raise self.failure
        base = observation.base
        error = self.gain * (observation.target_m - observation.tip_m)
        move = selective_move(self.jacobian, error, self.largest_m)
        return pose_through(self.entry_m, base.position_m + move, base.rotation)


def straight_jacobian(settings: FrozenJacobian, scenario: Scenario) -> Floats:
    """(3, 3) d tip / d base position at the end of a straight insertion, the base's axis kept through the entry.

    Raises ModelFailureError when the insertion does not converge.
    """
    scenario = model_scenario(scenario, settings.model)
    path, insertion = scenario.path(), insertion_of(scenario, keeps_tissue=False)
    tangent = path.first_tangent()
    depth_m = min(settings.depth_mm * 1e-3, norm(path.chord))
    state = _completed(insertion.initial_state(tangent))
    first = state.base
    for advance_m in np.linspace(0.0, depth_m, max(2, round(depth_m / STEP_M)))[1:]:
        state = _completed(insertion.step(state, Pose(first.position_m + advance_m * tangent, first.rotation)))
    tip = linearise(insertion.model, state.solved).tip
    reach_m = norm(insertion.entry_m - state.base.position_m)
    return following_response(tip, tangent, reach_m)


def _completed(state: InsertionState) -> InsertionState:
    """The state itself. Raises ModelFailureError for a step that failed."""
    if state.report.status is not Status.COMPLETED:
        raise ModelFailureError(state.report.status, f"insertion for the frozen Jacobian: {state.report.message}")
    return state
