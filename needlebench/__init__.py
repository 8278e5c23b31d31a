"""needlebench: reproducible benchmarks for robotic needle steering in deforming tissue.

    from needlebench import Scenario, run
    rollout = run(Scenario.load({"tissue": {"young_kpa": 3.0}}))

    from needlebench import Client
    with Client("http://127.0.0.1:8321") as client:
        job = client.wait(client.submit("demo").id)

    from needlebench import Episode, Pose
    episode = Episode("line")
    seen = episode.reset()
    seen, done = episode.step(Pose(seen.base.position_m + seen.target_m - seen.tip_m, seen.base.rotation))

A controller of one's own: `needlebench example controller`.

One thread is asked of every numeric library unless the environment says otherwise: results are then the same
whatever else the machine does. To be in time, import this before numpy.
"""

from __future__ import annotations

import importlib
import os
from typing import TYPE_CHECKING, Any

from service.blas_threads import THREAD_VARIABLES
from service.version import installed_version

for _name in THREAD_VARIABLES:
    os.environ.setdefault(_name, "1")

if TYPE_CHECKING:
    from service.client.client import Client
    from simcore.controllers import Controller
    from simcore.controllers.remote_centre import pose_through
    from simcore.episode import CommandError, Episode, Observation, Snapshot
    from simcore.insertion.insertion import rotation_towards
    from simcore.insertion.state import Pose
    from simcore.plugins import register_controller
    from simcore.rollout.rollout import run
    from simcore.scenario.scenario import Scenario
    from simcore.scenario.waypoint_file import read_waypoints

__version__ = installed_version()
__all__ = [
    "Client",
    "CommandError",
    "Controller",
    "Episode",
    "Observation",
    "Pose",
    "Scenario",
    "Snapshot",
    "__version__",
    "pose_through",
    "read_waypoints",
    "register_controller",
    "rotation_towards",
    "run",
]

_HOMES = {
    "Client": "service.client.client",
    "CommandError": "simcore.episode",
    "Controller": "simcore.controllers",
    "Episode": "simcore.episode",
    "Observation": "simcore.episode",
    "Pose": "simcore.insertion.state",
    "Scenario": "simcore.scenario.scenario",
    "Snapshot": "simcore.episode",
    "read_waypoints": "simcore.scenario.waypoint_file",
    "pose_through": "simcore.controllers.remote_centre",
    "register_controller": "simcore.plugins",
    "rotation_towards": "simcore.insertion.insertion",
    "run": "simcore.rollout.rollout",
}


def __getattr__(name: str) -> Any:
    """Import on first use: the kernels and the HTTP client are not needed by those who do not ask for them."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
