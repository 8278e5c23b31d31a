"""Controllers of other packages: made by their factory, named in whatever they raise."""

from __future__ import annotations

import errno
import traceback
from contextlib import contextmanager
from pathlib import PurePath
from typing import TYPE_CHECKING

from simcore.controllers.base import seed_of_controller
from simcore.controllers.plugin_thread import LateError, PluginThread
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

_DISK = (errno.ENOSPC, errno.EDQUOT, errno.EROFS)  # full, beyond the quota, read-only


class PluginController:
    """Passes observations on and waits for the answers; an error names the plug-in, one that comes too late too."""

    def __init__(self, name: str, controller: Controller, thread: PluginThread, step_timeout_s: float) -> None:
        """thread: that the controller was made in, for it alone."""
        self.name, self.controller, self.step_timeout_s = name, controller, step_timeout_s
        self.limited = bool(getattr(controller, "limited", True))
        self._thread = thread

    @classmethod
    def load(cls, settings: Plugin, scenario: Scenario, entry_m: Floats, needle_length_m: float) -> PluginController:
        """Calls the factory: (scenario, entry_m, needle_length_m, settings), then `reset(seed)` of what it made, if
        there is one. Raises PluginError.

        The scenario has that seed too: with its own, the noise of the run could be taken out of what is seen.
        """
        factory, seed = factory_of(settings.name), seed_of_controller(scenario.seed)
        shown = scenario.model_copy(update={"seed": seed})
        thread = PluginThread(settings.name)
        limit = settings.start_timeout_s
        late = f"has not ended within controller.start_timeout_s = {limit:g} s"
        try:
            with _named(settings.name, " its factory raised", "", f"its factory {late}"):
                made = thread.call(
                    lambda: factory(shown, entry_m.copy(), needle_length_m, dict(settings.settings)), limit
                )
            if not callable(getattr(made, "command", None)):
                kind = type(made).__name__
                raise PluginError(f"controller {settings.name!r}: its factory returned {kind}, no Controller")
            if callable(reset := getattr(made, "reset", None)):
                with _named(settings.name, " its reset raised", "", f"its reset {late}"):
                    thread.call(lambda: reset(seed), limit)
        except BaseException:
            thread.end()
            raise
        return cls(settings.name, made, thread, settings.step_timeout_s)

    def command(self, observation: Observation) -> Pose:
        """What the plug-in commands, which may be no pose: that is for the episode to say. Raises PluginError for what
        the plug-in raises, and where it has not answered in time."""
        late = f"has not answered within controller.step_timeout_s = {self.step_timeout_s:g} s"
        with _named(self.name, "", f", step {observation.step}", late):
            pose: Pose = self._thread.call(lambda: self.controller.command(observation), self.step_timeout_s)
        return pose

    def close(self, status: str, message: str) -> None:  # noqa: ARG002  (as every controller that holds something)
        """Let its thread end."""
        self._thread.end()


@contextmanager
def _named(name: str, doing: str, step: str, late: str) -> Iterator[None]:
    """What is raised within says which plug-in and where, and what comes too late says `late`. Raises PluginError; what
    is told apart by its type (memory, a full disk, what ends a process) keeps it, with a note."""
    who = f"controller {name!r}"
    try:
        yield
    except ModelFailureError:
        raise
    except LateError:
        raise PluginError(f"{who}: {late}{step}") from None
    except BaseException as error:
        if isinstance(error, Exception) and not isinstance(error, MemoryError) and not _of_the_disk(error):
            raise PluginError(f"{who}:{doing} {_shown(error)}{_place(error)}") from error
        error.add_note(f"{who}{step}")
        raise


def _of_the_disk(error: Exception) -> bool:
    """Whether no file can be written: a fault of the machine, and none of the plug-in."""
    return isinstance(error, OSError) and error.errno in _DISK


def _shown(error: Exception) -> str:
    """Its kind and its text, which is somebody else's code."""
    try:
        text = str(error).encode("utf-8", "backslashreplace").decode()
    except Exception:  # noqa: BLE001  (the kind alone will do)
        text = ""
    kind = type(error).__name__
    return f"{kind}: {text}" if text else kind


def _place(error: Exception) -> str:
    """File and line of the code that raised it, unless that is the call here, which did not fit."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    return "" if last.filename == __file__ else f" ({PurePath(last.filename).name}, line {last.lineno})"
