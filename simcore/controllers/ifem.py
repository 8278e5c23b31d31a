"""Inverse finite element control [paper]: T = X - J^+ (k o e), e = (n_traj - n_tip; RCM), J = de/dX. The rows are
weighted first; J^+ is `selective_move`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from simcore.controllers.remote_centre import TOO_NEAR_M, following_response, pose_through
from simcore.controllers.selective_inverse import selective_move
from simcore.insertion.state import Pose
from simcore.linear_algebra.products import norm
from simcore.rotations import compose, exp_map

if TYPE_CHECKING:
    from simcore.arrays import Floats
    from simcore.controllers.base import Controller, Model
    from simcore.episode.observation import Observation
    from simcore.insertion.jacobian_fast import Linearisation
    from simcore.scenario.scenario import InverseFem


def inverse_fem(settings: InverseFem, model: Model, entry_m: Floats, dt_s: float) -> Controller:
    """The controller with the orientation that the settings ask for; entry_m (3,) m."""
    if settings.orientation == "axis":
        return AxisThroughEntryController(settings, model, entry_m, dt_s)
    return InverseFemController(settings, model, dt_s)


class InverseFemController:
    """Asks its model, the plant itself or one of its own, for the Jacobian; the tip error is always an observed one."""

    limited = True

    def __init__(self, settings: InverseFem, model: Model, dt_s: float) -> None:
        self.settings, self.model = settings, model
        self.largest_m = 1e-3 * settings.direction_speed_mm_s * dt_s

    def command(self, observation: Observation) -> Pose:
        """One Newton step on the objectives; rotations count with the lever arm."""
        response = self.model(observation)
        jacobian, error = objectives(response, observation.target_m - observation.tip_m, self.settings)
        lever = self.settings.lever_arm_mm * 1e-3
        scaled = jacobian / np.array([1.0, 1.0, 1.0, lever, lever, lever])
        twist = -selective_move(scaled, error, self.largest_m)
        turn = exp_map(twist[3:] / lever)
        return Pose(observation.base.position_m + twist[:3], compose(turn, observation.base.rotation))


class AxisThroughEntryController:
    """The base's position by the three tip rows, its orientation by a rule: its axis passes through the entry."""

    limited = True

    def __init__(self, settings: InverseFem, model: Model, entry_m: Floats, dt_s: float) -> None:
        self.settings, self.model, self.entry_m = settings, model, entry_m
        self.largest_m = 1e-3 * settings.direction_speed_mm_s * dt_s

    def command(self, observation: Observation) -> Pose:
        """One Newton step on the tip error; the Jacobian turns the base as the rule will."""
        base, tip = observation.base, self.model(observation).tip
        reach_m = norm(self.entry_m - base.position_m)
        near = reach_m < TOO_NEAR_M
        jacobian = tip[:, :3] if near else following_response(tip, base.rotation[:, 2], reach_m)
        error = self.settings.gain * (observation.target_m - observation.tip_m)
        move = selective_move(jacobian, error, self.largest_m)
        return pose_through(self.entry_m, base.position_m + move, base.rotation)


def objectives(response: Linearisation, tip_error_m: Floats, settings: InverseFem) -> tuple[Floats, Floats]:
    """J = de/dX (3 or 5, 6) and k o e (3 or 5,): tip error n_traj - n_tip, then the remote-centre offsets.

    The weight multiplies the remote-centre rows of both. They are off before the puncture, and with a gain or a weight
    of 0.
    """
    weight = settings.rcm_weight
    if response.rcm is None or settings.rcm_gain == 0.0 or weight == 0.0:
        return -response.tip, settings.gain * tip_error_m
    jacobian = np.vstack([-response.tip, weight * response.rcm])
    rcm_error_m = weight * (settings.rcm_gain * response.rcm_error_m)
    return jacobian, np.concatenate([settings.gain * tip_error_m, rcm_error_m])
