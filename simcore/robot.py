"""The robot that holds the needle's base: it moves towards a commanded pose within its speed limits."""

from __future__ import annotations

import math

import numpy as np

from simcore.insertion.insertion import Pose
from simcore.rotations import exp_map, log_map
from simcore.scenario.scenario import Robot


def limited_pose(base: Pose, command: Pose, limits: Robot, dt_s: float) -> tuple[Pose, bool]:
    """The pose after one step towards `command`, and whether a limit acted.

    A twist beyond a limit is scaled by one factor as a whole, so that the motion keeps its direction.
    """
    shift = command.position_m - base.position_m
    turn = log_map(command.rotation @ base.rotation.T)
    speed_share = np.linalg.norm(shift) / (limits.max_speed_mm_s * 1e-3 * dt_s)
    turn_share = np.linalg.norm(turn) / (math.radians(limits.max_turn_deg_s) * dt_s)
    share = max(float(speed_share), float(turn_share))
    if share <= 1.0:
        return command, False
    return Pose(base.position_m + shift / share, exp_map(turn / share) @ base.rotation), True
