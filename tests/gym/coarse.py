"""A coarse environment, and the action that follows its next target."""

from __future__ import annotations

from typing import TYPE_CHECKING

from needlebench.gym.spaces import action_towards
from simcore.insertion.state import Pose

if TYPE_CHECKING:
    import numpy as np

    from needlebench.gym import NeedleEnv

    pass
COARSE = {"tissue.element_size_mm": 20, "needle.elements": 8, "dt_s": 0.05}


def straight(env: NeedleEnv) -> np.ndarray:
    """The action that follows the next target without turning."""
    seen = env.episode.observation
    pose = Pose(seen.base.position_m + seen.target_m - seen.tip_m, seen.base.rotation)
    return action_towards(pose, seen.base, env.episode.limits, seen.dt_s)
