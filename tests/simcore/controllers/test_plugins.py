"""Controllers of other packages: installed while a process runs, changed meanwhile, raising, in the wrong unit."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from simcore import plugins
from simcore.controllers.plugin import PluginController
from simcore.episode.observation import Observation
from simcore.errors import ModelFailureError, ScenarioError, Status
from simcore.insertion.state import Pose
from simcore.plugins import PluginError
from simcore.scenario.scenario import Scenario

if TYPE_CHECKING:
    from pathlib import Path

BASE = Pose(np.array([0.018, 0.031, -0.18]), np.eye(3))
MODULE = "class Still:\n    def __init__(self, *_): pass\n    def command(self, seen): return seen.base\n"


def install(folder: Path, name: str = "still", *, version: str = "1.0", module: str = MODULE) -> Path:
    """As pip would; the file of its module."""
    info = folder / f"{name}-{version}.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    (info / "entry_points.txt").write_text(f"[{plugins.GROUP}]\n{name} = {name}_package:Still\n")
    file = folder / f"{name}_package.py"
    file.write_text(module)
    return file


def load(name: str = "still") -> Scenario:
    return Scenario.load({"controller": {"kind": "plugin", "name": name}})


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "site"
    folder.mkdir()
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.setattr(plugins, "_first", {})
    plugins.note_installed()
    return folder


def test_one_that_is_installed_while_the_process_runs_works(site: Path) -> None:
    with pytest.raises(ScenarioError, match="is no controller of the group"):
        load()
    install(site)
    load()
    assert plugins.factory_of("still").__name__ == "Still"


def test_one_that_was_changed_meanwhile_is_refused(site: Path) -> None:
    file = install(site, "changed")
    plugins.note_installed()
    load("changed")
    os.utime(file, (1, 1))
    load("changed")  # its content is the same
    file.write_text(MODULE + "CHANGED = True\n")
    with pytest.raises(ScenarioError, match=r"controller\.name = 'changed': was changed .* restart the service"):
        load("changed")
    with pytest.raises(PluginError, match="restart the service"):
        plugins.factory_of("changed")


def test_one_of_another_version_is_refused(site: Path) -> None:
    file = install(site, "newer")
    load("newer")
    before = file.stat()
    (site / "newer-1.0.dist-info").rename(site / "newer-1.1.dist-info")
    (site / "newer-1.1.dist-info" / "METADATA").write_text("Metadata-Version: 2.1\nName: newer\nVersion: 1.1\n")
    os.utime(file, (before.st_atime, before.st_mtime))
    with pytest.raises(ScenarioError, match="restart the service"):
        load("newer")


def test_one_that_only_a_new_process_can_import_is_refused(site: Path) -> None:
    install(site, "editable").unlink()
    with pytest.raises(ScenarioError, match=r"cannot find its module editable_package.*restart the service"):
        load("editable")


class Answers:
    """Does what it is told."""

    limited = True

    def __init__(self, action: Any) -> None:
        self.action = action

    def command(self, _observation: Observation) -> Any:
        if isinstance(self.action, BaseException):
            raise self.action
        return self.action


def asked(action: Any, step: int = 7) -> Pose:
    tip = np.array([0.018, 0.031, 0.0])
    return PluginController("odd", Answers(action)).command(Observation(step, BASE, tip, tip))


def test_what_it_raises_comes_with_its_name_and_the_place() -> None:
    with pytest.raises(
        PluginError, match=r"^controller 'odd': KeyError: 'gain' \(test_plugins\.py, line \d+\)$"
    ) as caught:
        asked(KeyError("gain"))
    assert isinstance(caught.value.__cause__, KeyError)


@pytest.mark.parametrize("error", [MemoryError(), OSError(28, "full"), SystemExit(3), KeyboardInterrupt()])
def test_what_is_told_apart_by_its_type_keeps_it(error: BaseException) -> None:
    with pytest.raises(type(error)) as caught:
        asked(error)
    assert caught.value.__notes__ == ["controller 'odd', step 7"]


def test_a_failure_of_its_model_ends_the_run_with_its_status() -> None:
    with pytest.raises(ModelFailureError):
        asked(ModelFailureError(Status.NOT_CONVERGED, "its own"))


def test_what_its_factory_raises_names_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plugins, "_registered", {"odd": lambda *_: 1 / 0})
    settings = Scenario.load({"controller": {"kind": "plugin", "name": "odd"}})
    with pytest.raises(PluginError, match=r"controller 'odd': its factory raised ZeroDivisionError: division by zero"):
        PluginController.load(settings.controller, settings, np.zeros(3), 0.2)  # type: ignore[arg-type]
