"""The robot that holds the needle's base: it moves towards a commanded pose, late by a delay, within its limits."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from simcore.insertion.state import Pose
from simcore.linear_algebra.products import norm
from simcore.rotations import compose, exp_map, log_map


@dataclass(frozen=True)
class RobotLimits:
    """Speed limits of the end-effector, translation and rotation."""

    max_speed_m_s: float
    max_turn_rad_s: float


class DelayedCommands:
    """Gives each command back a number of steps later; until the first one is due, the robot's first pose."""

    def __init__(self, first: Pose, steps: int) -> None:
        self.waiting = deque([first] * steps)

    def due(self, command: Pose) -> Pose:
        """Take this step's command, give the one that is executed in it."""
        self.waiting.append(command)
        return self.waiting.popleft()


def limited_pose(base: Pose, command: Pose, limits: RobotLimits, dt_s: float) -> tuple[Pose, bool]:
    """The pose after one step towards `command`, and whether a limit acted.

    A twist beyond a limit is scaled by one factor as a whole, so that the motion keeps its direction.
    """
    shift = command.position_m - base.position_m
    turn = log_map(compose(command.rotation, base.rotation.T))
    speed_share = norm(shift) / (limits.max_speed_m_s * dt_s)
    turn_share = norm(turn) / (limits.max_turn_rad_s * dt_s)
    share = max(speed_share, turn_share)
    if share <= 1.0:
        return command, False
    return Pose(base.position_m + shift / share, compose(exp_map(turn / share), base.rotation)), True
