"""What is seen of an insertion at the beginning of a step."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from simcore.arrays import Floats
    from simcore.insertion.state import Pose


@dataclass(frozen=True)
class Observation:
    """All that a controller may know at the beginning of step `step`, which is `t_s` after the start. SI units, world
    frame; its arrays are its own.

    Base pose and wrench are those of the robot at this moment. All else is as it is seen: with the scenario's noise,
    and as `sensing` shows it.

    tip_direction: (3,) unit, along the needle at its tip. entry_offset_m: (2,), how far the shaft passes beside the
    entry, across it. depth_m: inserted length of the needle. base_wrench: (6,) N, N m, force of the robot on the needle
    and torque about the base. entry_m: (3,), the nominal entry, which is the remote centre of motion. targets_m:
    (n, 3), n at least 1: `target_m`, then the target of each coming step, at most 100, with the noise of this moment.
    """

    step: int
    base: Pose
    tip_m: Floats  # (3,)
    target_m: Floats  # (3,) with noise
    t_s: float = 0.0
    dt_s: float = 0.01
    base_wrench: Floats = field(default_factory=lambda: np.zeros(6))
    entry_m: Floats = field(default_factory=lambda: np.zeros(3))
    targets_m: Floats = field(default_factory=lambda: np.zeros((1, 3)))
    tip_direction: Floats = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    entry_offset_m: Floats = field(default_factory=lambda: np.zeros(2))
    depth_m: float = 0.0
