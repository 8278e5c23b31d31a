"""Environments for Gymnasium (`pip install needlebench[gym]`); importing this registers them.

    import gymnasium, needlebench.gym
    env = gymnasium.make("needlebench/Line-v0")
    seen, info = env.reset(seed=1)
    seen, reward, terminated, truncated, info = env.step(env.action_space.sample())

`gymnasium.make("needlebench.gym:needlebench/Line-v0")` imports it by itself.
"""

from __future__ import annotations

import needlebench  # noqa: F401  (first: it asks the numeric libraries for one thread)

try:
    import gymnasium
except ModuleNotFoundError as error:
    raise ModuleNotFoundError('needlebench.gym needs gymnasium: pip install "needlebench[gym]"') from error

from needlebench.gym.demonstrations import actions_of
from needlebench.gym.env import NeedleEnv
from needlebench.gym.tasks import TASKS
from needlebench.gym.wrappers import AbsolutePose, ThroughEntry

__all__ = ["IDS", "AbsolutePose", "NeedleEnv", "ThroughEntry", "actions_of"]

IDS = tuple(f"needlebench/{name}-v0" for name in TASKS)

for _id, _task in zip(IDS, TASKS, strict=True):
    if _id not in gymnasium.registry:
        gymnasium.register(_id, entry_point="needlebench.gym.env:NeedleEnv", kwargs={"task": _task})
