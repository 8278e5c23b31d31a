"""Controllers of other packages: installed while a process runs, changed meanwhile, raising, in the wrong unit."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import pytest

from simcore import plugins
from simcore.controllers.plugin import PluginController
from simcore.controllers.plugin_thread import PluginThread
from simcore.episode.observation import Observation
from simcore.errors import ModelFailureError, ScenarioError, Status
from simcore.file_names import located, names_mean
from simcore.insertion.state import Pose
from simcore.plugins import PluginError
from simcore.rollout.rollout import run
from simcore.scenario.scenario import Scenario
from tests.simcore.short_run import short

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
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
    thread = PluginThread("odd")
    try:
        return PluginController("odd", Answers(action), thread, 60.0).command(Observation(step, BASE, tip, tip))
    finally:
        thread.end()


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


@pytest.mark.parametrize("error", [FileNotFoundError(2, "no such file", "net.pt"), TimeoutError("the camera")])
def test_a_file_or_a_connection_of_its_own_is_a_fault_of_the_plug_in(error: OSError) -> None:
    with pytest.raises(PluginError, match=f"^controller 'odd': {type(error).__name__}"):
        asked(error)


class Unfit:
    """Takes no observation."""

    def command(self) -> None:
        """Never called."""


def test_one_that_does_not_fit_is_named_without_a_place() -> None:
    thread, tip = PluginThread("odd"), np.array([0.018, 0.031, 0.0])
    with pytest.raises(PluginError, match=r"^controller 'odd': TypeError: .*command\(\) takes 1 positional.*given$"):
        PluginController("odd", Unfit(), thread, 60.0).command(Observation(7, BASE, tip, tip))  # type: ignore[arg-type]
    thread.end()


def test_a_failure_of_its_model_ends_the_run_with_its_status() -> None:
    with pytest.raises(ModelFailureError):
        asked(ModelFailureError(Status.NOT_CONVERGED, "its own"))


def test_what_its_factory_raises_names_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plugins, "_registered", {"odd": lambda *_: 1 / 0})
    settings = Scenario.load({"controller": {"kind": "plugin", "name": "odd"}})
    with pytest.raises(PluginError, match=r"controller 'odd': its factory raised ZeroDivisionError: division by zero"):
        PluginController.load(settings.controller, settings, np.zeros(3), 0.2)  # type: ignore[arg-type]


# ---- the thread that it lives in

NEVER = threading.Event()
HANGS: dict[str, Callable[[], object]] = {"waits": lambda: NEVER.wait(600.0), "loops": lambda: list(repeat_for_ever())}


def repeat_for_ever() -> Iterator[None]:
    while not NEVER.is_set():
        for _ in range(1000):
            pass
    yield


class Thinks:
    """Follows its target, and at step 5 does what it was made for. `threads`: those that it was called in."""

    limited = True
    threads: ClassVar[list[threading.Thread]] = []

    def __init__(self, _scenario: Scenario, _entry_m: object, _length_m: float, settings: dict[str, str]) -> None:
        self.threads[:] = [threading.current_thread()]
        self.does = settings.get("does")
        if settings.get("factory"):
            HANGS["waits"]()

    def reset(self, _seed: int) -> None:
        self.threads.append(threading.current_thread())

    def command(self, seen: Observation) -> Pose:
        self.threads.append(threading.current_thread())
        if seen.step == 5 and self.does:
            HANGS[self.does]()
        return Pose(seen.base.position_m + (seen.target_m - seen.tip_m), seen.base.rotation)


def thinking(**block: Any) -> Scenario:
    plugins.register_controller("thinks", Thinks)
    return short(controller={"kind": "plugin", "name": "thinks", **block})


def test_all_of_it_is_called_in_one_thread_which_ends_with_the_run() -> None:
    done = run(thinking())
    assert len(Thinks.threads) == 2 + len(done.series["t_s"]) - 1
    (thread,) = set(Thinks.threads)
    assert thread is not threading.current_thread()
    assert not thread.is_alive()


@pytest.mark.parametrize("does", HANGS)
def test_one_that_hangs_ends_the_run_by_name_and_keeps_what_was_run(does: str) -> None:
    done = run(thinking(settings={"does": does}, step_timeout_s=1.0))
    NEVER.set()
    Thinks.threads[0].join(60.0)
    NEVER.clear()
    assert done.status is Status.CONTROLLER_FAILED
    told = "controller 'thinks': has not answered within controller.step_timeout_s = 1 s, step 5"
    assert done.message.endswith(told)
    assert done.message.startswith("step 6 of 41")
    assert len(done.series["t_s"]) == 6


def test_a_traced_process_does_not_stand_until_one_that_hangs_has_ended() -> None:
    """Under a debugger, or while coverage is measured."""
    code = (
        "import sys, threading\n"
        "from simcore.controllers.plugin_thread import LateError, PluginThread\n"
        "sys.settrace(lambda *_: None)\n"
        "try:\n"
        "    PluginThread('hangs').call(lambda: threading.Event().wait(600.0), 0.5)\n"
        "except LateError:\n"
        "    print('late')\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120.0, check=False)
    assert done.stdout == "late\n", done.stderr


@pytest.mark.skipif(
    sys.version_info < (3, 12) and sys.gettrace() is not None, reason="Python 3.11 is traced: it is not ended then"
)
def test_a_loop_of_python_that_nobody_waits_for_any_more_is_ended() -> None:
    run(thinking(settings={"does": "loops"}, step_timeout_s=1.0))
    Thinks.threads[0].join(60.0)
    assert not Thinks.threads[0].is_alive()


def test_a_factory_that_hangs_is_named() -> None:
    with pytest.raises(PluginError, match=r"^controller 'thinks': its factory has not ended within .*start_timeout_s"):
        run(thinking(settings={"factory": "yes"}, start_timeout_s=0.5))
    NEVER.set()
    Thinks.threads[0].join(60.0)
    NEVER.clear()


def test_what_names_of_files_mean_holds_in_it_too(tmp_path: Path) -> None:
    """A plug-in that makes an episode of its scenario finds the files that the scenario names."""
    with names_mean(lambda name: tmp_path / name):
        thread = PluginThread("odd")
    assert thread.call(lambda: located("field", "mesh.msh"), 60.0) == tmp_path / "mesh.msh"
    thread.end()


def test_whoever_is_interrupted_while_it_waits_waits_no_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    thread = PluginThread("odd")
    replies = thread._replies

    class Interrupted:
        def get(self, timeout: float) -> None:
            del timeout
            raise KeyboardInterrupt

        put = replies.put

    monkeypatch.setattr(thread, "_replies", Interrupted())
    with pytest.raises(KeyboardInterrupt):
        thread.call(lambda: NEVER.wait(600.0), 60.0)
    NEVER.set()
    thread._thread.join(60.0)
    NEVER.clear()
    assert not thread._thread.is_alive()
