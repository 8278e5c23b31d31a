"""What an environment's agent would have had to do to move the base as a run has moved it: for imitation."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from needlebench.gym.spaces import action_towards
from simcore.insertion.state import Pose
from simcore.rotations import matrix_from_quaternion
from simcore.scenario.build import robot_limits

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from simcore.rollout.result import Rollout


def actions_of(rollout: Rollout) -> NDArray[np.float32]:
    """(steps, 6) in -1 ... 1: the action of each step of a run, whatever its controller was.

    An environment that is reset to the run's scenario and given these sees what happened in the run, up to the rounding
    of single precision, and shows it to whoever wants to learn from it:

    >>> import gymnasium
    >>> from needlebench import run
    >>> env = gymnasium.make("needlebench.gym:needlebench/Line-v0", depth_mm=2, changes={"tissue.element_size_mm": 12})
    >>> seen, info = env.reset(seed=1)
    >>> actions, observations = actions_of(run(info["scenario"])), [seen]
    >>> for action in actions[:-1]:
    ...     observations.append(env.step(action)[0])
    >>> print(actions.shape == (len(observations), 6))
    True
    """
    series, scenario = rollout.series, rollout.scenario
    limits = robot_limits(scenario.robot)
    rows = zip(series["base_position_m"], series["base_rotation"], strict=True)
    poses = [Pose(position_m, matrix_from_quaternion(quaternion)) for position_m, quaternion in rows]
    moves = [action_towards(after, before, limits, scenario.dt_s) for before, after in pairwise(poses)]
    return np.array(moves, np.float32).reshape(-1, 6)
