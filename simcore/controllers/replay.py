"""Replay: prescribed base poses, for logs of real robots and for cross-checks with other simulators."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from simcore.insertion.state import Pose
from simcore.rotations import matrix_from_quaternion
from simcore.scenario.controller_rules import poses_of

if TYPE_CHECKING:
    from simcore.episode.observation import Observation
    from simcore.scenario.scenario import Replay


class ReplayController:
    """Pose i prescribes step i; the robot's limits do not act."""

    limited = False

    def __init__(self, settings: Replay) -> None:
        poses = poses_of(settings)
        self.positions_m = poses[:, :3] * 1e-3
        self.quaternions = poses[:, 3:] / np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)

    def command(self, observation: Observation) -> Pose:
        """The pose of the list for this step."""
        i = observation.step
        return Pose(self.positions_m[i], matrix_from_quaternion(self.quaternions[i]))
