"""Inverse finite element control [paper]: T = X - J^+ (k o e), e = (n_traj - n_tip; RCM), J = de/dX."""

from __future__ import annotations

import numpy as np

from simcore.arrays import Floats
from simcore.controllers.base import Model, Observation
from simcore.insertion.jacobian_fast import Linearisation
from simcore.insertion.state import Pose
from simcore.rotations import exp_map
from simcore.scenario.scenario import InverseFem


class InverseFemController:
    """Asks its model, the plant itself or one of its own, for the Jacobian; the tip error is always an observed one."""

    limited = True

    def __init__(self, settings: InverseFem, model: Model) -> None:
        self.settings = settings
        self.model = model

    def command(self, observation: Observation) -> Pose:
        """One damped Newton step on the objectives; rotations count with the lever arm."""
        response = self.model(observation)
        jacobian, error = objectives(response, observation.target_m - observation.tip_m, self.settings)
        lever = self.settings.lever_arm_mm * 1e-3
        scaled = jacobian / np.array([1.0, 1.0, 1.0, lever, lever, lever])
        twist = -damped_inverse(scaled, self.settings.damping) @ error
        turn = exp_map(twist[3:] / lever)
        return Pose(observation.base.position_m + twist[:3], turn @ observation.base.rotation)


def objectives(response: Linearisation, tip_error_m: Floats, settings: InverseFem) -> tuple[Floats, Floats]:
    """J = de/dX (3 or 5, 6) and k o e (3 or 5,): tip error n_traj - n_tip, then the remote-centre offsets.

    The remote-centre rows are off before the puncture, and with a gain of 0.
    """
    if response.rcm is None or settings.rcm_gain == 0.0:
        return -response.tip, settings.gain * tip_error_m
    jacobian = np.vstack([-response.tip, response.rcm])
    return jacobian, np.concatenate([settings.gain * tip_error_m, settings.rcm_gain * response.rcm_error_m])


def damped_inverse(jacobian: Floats, damping: float) -> Floats:
    """J^+ = J^T (J J^T + d^2 I)^-1 (Wampler 1986; Nakamura and Hanafusa 1986)."""
    gram = jacobian @ jacobian.T + damping**2 * np.eye(len(jacobian))
    return np.asarray(np.linalg.solve(gram, jacobian).T)
