"""Controllers of other packages: made by their factory, watched at every command."""

from __future__ import annotations

from typing import Any

import numpy as np

from simcore.arrays import Floats
from simcore.controllers.base import Controller, Observation
from simcore.insertion.state import Pose
from simcore.plugins import PluginError, factory_of
from simcore.scenario.scenario import Plugin, Scenario

MAXIMUM_SKEW = 1e-6  # of R^T R from the identity


class PluginController:
    """Passes observations on; a command that is no pose is an error that names the plug-in."""

    def __init__(self, name: str, controller: Controller) -> None:
        self.name, self.controller = name, controller
        self.limited = bool(getattr(controller, "limited", True))

    @classmethod
    def load(cls, settings: Plugin, scenario: Scenario, entry_m: Floats, needle_length_m: float) -> PluginController:
        """Calls the factory: (scenario, entry_m, needle_length_m, settings). Raises PluginError."""
        made = factory_of(settings.name)(scenario, entry_m.copy(), needle_length_m, dict(settings.settings))
        if not callable(getattr(made, "command", None)):
            raise PluginError(
                f"controller {settings.name!r}: its factory returned {type(made).__name__}, no Controller"
            )
        return cls(settings.name, made)

    def command(self, observation: Observation) -> Pose:
        """What the plug-in commands. Raises PluginError for anything but a finite pose."""
        pose: Any = self.controller.command(observation)
        if not isinstance(pose, Pose):
            raise self._wrong(observation, f"a {type(pose).__name__}, not a Pose")
        position, rotation = np.asarray(pose.position_m, float), np.asarray(pose.rotation, float)
        if position.shape != (3,) or rotation.shape != (3, 3):
            raise self._wrong(
                observation, f"position_m {position.shape} and rotation {rotation.shape}, not (3,), (3, 3)"
            )
        if not (np.isfinite(position).all() and np.isfinite(rotation).all()):
            raise self._wrong(observation, "values that are not finite")
        skew = np.abs(rotation.T @ rotation - np.eye(3)).max()
        if skew > MAXIMUM_SKEW or np.linalg.det(rotation) < 0.0:
            raise self._wrong(observation, "a rotation that is no rotation matrix")
        return Pose(position, rotation)

    def _wrong(self, observation: Observation, answer: str) -> PluginError:
        return PluginError(f"controller {self.name!r} answered step {observation.step} with {answer}")
