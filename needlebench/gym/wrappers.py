"""Other ways to command the base: moves in space with its axis through the entry, and poses."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from gymnasium import spaces

from needlebench.gym.env import NeedleEnv, checked_action
from needlebench.gym.spaces import FARTHEST_M, action_towards
from simcore.controllers.remote_centre import pose_through
from simcore.episode.command import CommandError, checked_command
from simcore.insertion.state import Pose
from simcore.rotations import matrix_from_quaternion

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Singles = NDArray[np.float32]

LEAST_NORM = 1e-6  # of a quaternion that has a direction


class _Commanding(gymnasium.ActionWrapper[dict[str, "Singles"], Any, Any]):
    """Turns its actions into poses, and these into actions of the environment."""

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        super().__init__(env)
        plain = env.unwrapped
        if not isinstance(plain, NeedleEnv):
            raise TypeError(f"{type(self).__name__} wraps environments of needlebench, not {type(plain).__name__}")
        self.needle_env = plain

    def pose(self, action: NDArray[np.float64], base: Pose) -> Pose:
        """The pose that an action commands."""
        raise NotImplementedError

    def action(self, action: Any) -> Singles:
        """The environment's action towards that pose. What is not finite or no pose within reach of the base ends the
        episode by name. Raises ValueError for an action of another shape."""
        env = self.needle_env
        episode = env.episode
        base = episode.state.base
        wanted = checked_action(action, self.action_space.shape or (), episode)
        if not np.isfinite(wanted).all():
            env.refusal = f"the action is {wanted.tolist()}, values that are not finite"
            return np.full(6, np.nan, np.float32)
        try:
            pose = checked_command(self.pose(wanted, base), base, episode.step_number)
        except CommandError as error:
            env.refusal = f"the action is {error.problem}"
            return np.full(6, np.nan, np.float32)
        return action_towards(pose, base, episode.limits, episode.scenario.dt_s)


class ThroughEntry(_Commanding):
    """Actions (3,) in -1 ... 1: velocity of the base in world axes in units of the robot's speed limit. The base turns
    so that its axis passes through the entry, as far as its turning limit lets it."""

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        super().__init__(env)
        self.action_space = spaces.Box(-1.0, 1.0, (3,), np.float32)

    def pose(self, action: NDArray[np.float64], base: Pose) -> Pose:
        """Moved as commanded, turned by the rule."""
        episode = self.needle_env.episode
        moved = base.position_m + action * (episode.limits.max_speed_m_s * episode.scenario.dt_s)
        return pose_through(episode.insertion.entry_m, moved, base.rotation)


class AbsolutePose(_Commanding):
    """Actions (7,): position of the base in m, world frame, and its orientation as a quaternion wxyz of any length but
    0; the base moves there as fast as the robot may."""

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        super().__init__(env)
        bound = np.array([FARTHEST_M] * 3 + [1.0] * 4, np.float32)
        self.action_space = spaces.Box(-bound, bound, dtype=np.float32)

    def pose(self, action: NDArray[np.float64], base: Pose) -> Pose:
        """As commanded; without an orientation, that of now."""
        norm = float(np.linalg.norm(action[3:]))
        rotation = matrix_from_quaternion(action[3:] / norm) if norm > LEAST_NORM else base.rotation
        return Pose(action[:3], rotation)
