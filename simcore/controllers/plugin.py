"""Controllers of other packages: made by their factory, named in whatever they raise."""

from __future__ import annotations

import traceback
from contextlib import contextmanager
from pathlib import PurePath
from typing import TYPE_CHECKING

from simcore.controllers.base import seed_of_controller
from simcore.episode.observation import Observation
from simcore.errors import ModelFailureError
from simcore.plugins import PluginError, factory_of

if TYPE_CHECKING:
    from collections.abc import Iterator

    from simcore.arrays import Floats
    from simcore.controllers.base import Controller
    from simcore.episode.observation import Observation
    from simcore.insertion.state import Pose
    from simcore.scenario.scenario import Plugin, Scenario


class PluginController:
    """Passes observations on; an error names the plug-in."""

    def __init__(self, name: str, controller: Controller) -> None:
        self.name, self.controller = name, controller
        self.limited = bool(getattr(controller, "limited", True))

    @classmethod
    def load(cls, settings: Plugin, scenario: Scenario, entry_m: Floats, needle_length_m: float) -> PluginController:
        """Calls the factory: (scenario, entry_m, needle_length_m, settings), then `reset(seed)` of what it made, if
        there is one. Raises PluginError.

        The scenario has that seed too: with its own, the noise of the run could be taken out of what is seen.
        """
        factory, seed = factory_of(settings.name), seed_of_controller(scenario.seed)
        with _named(f"controller {settings.name!r}: its factory raised", ""):
            shown = scenario.model_copy(update={"seed": seed})
            made = factory(shown, entry_m.copy(), needle_length_m, dict(settings.settings))
        if not callable(getattr(made, "command", None)):
            raise PluginError(
                f"controller {settings.name!r}: its factory returned {type(made).__name__}, no Controller"
            )
        if callable(reset := getattr(made, "reset", None)):
            with _named(f"controller {settings.name!r}: its reset raised", ""):
                reset(seed)
        return cls(settings.name, made)

    def command(self, observation: Observation) -> Pose:
        """What the plug-in commands, which may be no pose: that is for the episode to say. Raises PluginError for what
        the plug-in raises."""
        with _named(f"controller {self.name!r}:", f", step {observation.step}"):
            pose: Pose = self.controller.command(observation)
        return pose


@contextmanager
def _named(where: str, step: str) -> Iterator[None]:
    """What is raised within says where. Raises PluginError; what is told apart by its type keeps it, with a note."""
    try:
        yield
    except ModelFailureError:
        raise
    except (MemoryError, OSError) as error:
        error.add_note(where.rstrip(":") + step)
        raise
    except Exception as error:
        raise PluginError(f"{where} {_shown(error)}{_place(error)}") from error
    except BaseException as error:
        error.add_note(where.rstrip(":") + step)
        raise


def _shown(error: Exception) -> str:
    """Its kind and its text, which is somebody else's code."""
    try:
        text = str(error).encode("utf-8", "backslashreplace").decode()
    except Exception:  # noqa: BLE001  (the kind alone will do)
        text = ""
    kind = type(error).__name__
    return f"{kind}: {text}" if text else kind


def _place(error: Exception) -> str:
    """File and line of the code that raised it."""
    frames = traceback.extract_tb(error.__traceback__)
    return f" ({PurePath(frames[-1].filename).name}, line {frames[-1].lineno})" if len(frames) > 1 else ""
