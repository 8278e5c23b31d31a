"""Controllers of other packages: made by their factory, watched at every command."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from simcore.errors import ModelFailureError
from simcore.insertion.state import Pose
from simcore.plugins import PluginError, factory_of

if TYPE_CHECKING:
    from collections.abc import Iterator

    from simcore.arrays import Floats
    from simcore.controllers.base import Controller, Observation
    from simcore.scenario.scenario import Plugin, Scenario

MAXIMUM_SKEW = 1e-6  # of R^T R from the identity
FARTHEST_M = 10.0  # a command from the base; no robot reaches as far
FAR_M = 1.0  # beyond, a thousandth of the command that is near the base tells that it was in millimetres


class PluginController:
    """Passes observations on; a command that is no pose is an error that names the plug-in."""

    def __init__(self, name: str, controller: Controller) -> None:
        self.name, self.controller = name, controller
        self.limited = bool(getattr(controller, "limited", True))

    @classmethod
    def load(cls, settings: Plugin, scenario: Scenario, entry_m: Floats, needle_length_m: float) -> PluginController:
        """Calls the factory: (scenario, entry_m, needle_length_m, settings). Raises PluginError."""
        factory = factory_of(settings.name)
        with _named(f"controller {settings.name!r}: its factory raised"):
            made = factory(scenario, entry_m.copy(), needle_length_m, dict(settings.settings))
        if not callable(getattr(made, "command", None)):
            raise PluginError(
                f"controller {settings.name!r}: its factory returned {type(made).__name__}, no Controller"
            )
        return cls(settings.name, made)

    def command(self, observation: Observation) -> Pose:
        """What the plug-in commands. Raises PluginError for anything but a finite pose within reach, and for what the
        plug-in raises, with the step."""
        with _named(f"controller {self.name!r}, step {observation.step}:"):
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
        if (problem := _unit_problem(position, observation.base.position_m)) is not None:
            raise self._wrong(observation, problem)
        return Pose(position, rotation)

    def _wrong(self, observation: Observation, answer: str) -> PluginError:
        return PluginError(f"controller {self.name!r} answered step {observation.step} with {answer}")


@contextmanager
def _named(where: str) -> Iterator[None]:
    """What is raised within says where. Raises PluginError; what is told apart by its type keeps it, with a note."""
    try:
        yield
    except ModelFailureError:
        raise
    except (MemoryError, OSError) as error:
        error.add_note(where.rstrip(":"))
        raise
    except Exception as error:
        raise PluginError(f"{where} {_shown(error)}") from error
    except BaseException as error:
        error.add_note(where.rstrip(":"))
        raise


def _shown(error: Exception) -> str:
    """Its kind and its text, which is somebody else's code."""
    try:
        text = str(error)
    except Exception:  # noqa: BLE001  (the kind alone will do)
        text = ""
    kind = type(error).__name__
    return f"{kind}: {text}" if text else kind


def _unit_problem(position_m: Floats, base_m: Floats) -> str | None:
    """Why a command (3,) is too far from the base (3,) to be meant, both m, world; None if it is not."""
    away_m = float(np.linalg.norm(position_m - base_m))
    where = f"position_m = {np.round(position_m, 4).tolist()}, {away_m:.4g} m from the base"
    if away_m > FAR_M and np.linalg.norm(position_m * 1e-3 - base_m) < FAR_M / 2:
        return f"{where}: that looks like millimetres, position_m is in metres"
    if away_m > FARTHEST_M:
        return f"{where}: at most {FARTHEST_M:g} m are allowed"
    return None
