"""Visual servoing with a frozen Jacobian: T = X - J^+ (k o e), J^+ computed once and kept (Chaumette and Hutchinson
2006, constant interaction matrix). What I-FEM gains by linearising anew at every step is the distance to this."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from simcore.controllers.base import Observation
from simcore.controllers.ifem import damped_inverse
from simcore.controllers.model import model_scenario
from simcore.errors import ModelFailure, Status
from simcore.insertion import Insertion, Pose
from simcore.linearisation import lateral_offset, linearise
from simcore.rotations import exp_map
from simcore.scenario import FrozenJacobian, Scenario

Vector = NDArray[np.float64]

STEP_M = 0.5e-3  # advance of the own insertion: quasi-static, its end does not depend on the pace


class FrozenJacobianController:
    """J is that of an insertion of its own, pushed straight along the path's first tangent to one depth.

    The tip error is observed; the remote-centre error is that of the base's axis, all that is known without a model.
    """

    limited = True

    def __init__(self, settings: FrozenJacobian, scenario: Scenario, entry_m: Vector) -> None:
        self.settings, self.entry_m = settings, entry_m
        lever = settings.lever_arm_mm * 1e-3
        self.scale = np.array([1.0, 1.0, 1.0, lever, lever, lever])
        self.failure: ModelFailure | None = None
        try:
            tip, passing, self.frame = straight_jacobian(settings, scenario)
        except ModelFailure as failure:
            self.failure = failure  # of the run and not of its preparation: the first command tells it
            return
        rows = -tip if settings.rcm_gain == 0.0 else np.vstack([-tip, passing])
        self.inverse = damped_inverse(rows / self.scale, settings.damping)

    def command(self, observation: Observation) -> Pose:
        """One step down the observed errors along the kept directions. Raises ModelFailure if there are none."""
        if self.failure is not None:
            raise self.failure
        base = observation.base
        error = self.settings.gain * (observation.target_m - observation.tip_m)
        if self.settings.rcm_gain != 0.0:
            away = base.position_m - self.entry_m
            away = away - (away @ base.rotation[:, 2]) * base.rotation[:, 2]
            error = np.concatenate([error, self.settings.rcm_gain * (self.frame @ away)])
        twist = -(self.inverse @ error) / self.scale
        return Pose(base.position_m + twist[:3], exp_map(twist[3:]) @ base.rotation)


def straight_jacobian(settings: FrozenJacobian, scenario: Scenario) -> tuple[Vector, Vector, Vector]:
    """Of a straight insertion: tip rows (3, 6), remote-centre rows (2, 6), the two lateral directions (2, 3), world.

    Raises ModelFailure when the insertion does not converge.
    """
    scenario = model_scenario(scenario, settings.model)
    path, insertion = scenario.path(), Insertion(scenario)
    tangent = path.first_tangent()
    depth_m = min(settings.depth_mm * 1e-3, float(np.linalg.norm(path.chord)))
    state = insertion.initial_state(tangent)
    first = state.base
    for advance_m in np.linspace(0.0, depth_m, max(2, round(depth_m / STEP_M)))[1:]:
        state = insertion.step(state, Pose(first.position_m + advance_m * tangent, first.rotation))
        if state.report.status is not Status.COMPLETED:
            raise ModelFailure(state.report.status, f"insertion for the frozen Jacobian: {state.report.message}")
    response = linearise(insertion, state)
    if response.rcm is None:
        message = f"insertion for the frozen Jacobian: not punctured at {1e3 * depth_m:g} mm"
        raise ModelFailure(Status.NOT_CONVERGED, message)
    return response.tip, response.rcm, lateral_offset(insertion, state, insertion.entry_m)[1][:2]
