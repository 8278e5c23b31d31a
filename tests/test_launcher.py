"""The launcher that makes the environment."""

from __future__ import annotations

import ast
import json
import os
import shutil
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import bootstrap
import bootstrap_python

ROOT = Path(__file__).resolve().parent.parent


@pytest.mark.parametrize("name", ["bootstrap", "bootstrap_python"])
def test_launcher_reads_on_an_old_python_and_needs_no_package(name: str) -> None:
    tree = ast.parse((ROOT / f"{name}.py").read_text(encoding="utf-8"), feature_version=(3, 8))
    imports = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    imports |= {str(node.module) for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert {name.split(".")[0] for name in imports} <= sys.stdlib_module_names | {"bootstrap_python"}


def answer(**changes: Any) -> dict[str, Any]:
    """What a suitable Python says of itself."""
    return {"version": [3, 12, 1], "executable": "python", "venv": True, "pip": True, "fits": True, **changes}


@pytest.mark.parametrize(
    ("stamp", "here", "exists", "todo"),
    [
        (None, None, False, "rebuild"),
        (bootstrap.UNFINISHED, answer(), True, "rebuild"),
        (None, answer(), True, "packages"),
        ({}, answer(), True, "nothing"),
        ({"project": "other"}, answer(), True, "project"),
        ({"locks": {}}, answer(), True, "packages"),
        ({"locks": {"core": "other", "run": "other"}}, answer(), True, "packages"),
        ({"path": "elsewhere"}, answer(), True, "rebuild"),
        ({}, answer(version=[3, 12, 2]), True, "rebuild"),
        ({}, None, True, "rebuild"),
    ],
)
def test_launcher_does_no_more_than_needed(stamp: Any, here: dict[str, Any] | None, exists: bool, todo: str) -> None:
    """A dictionary stands for a complete stamp with these differences."""
    if isinstance(stamp, dict):
        stamp = {**bootstrap.wanted([3, 12, 1], "run"), **stamp}
    assert bootstrap.plan(stamp, here, exists, "run") == todo


@pytest.mark.parametrize(
    ("has", "asked", "todo"),
    [
        ("dev", "core", "nothing"),
        ("dev", "run", "nothing"),
        ("run", "core", "nothing"),
        ("run", "dev", "packages"),
        ("core", "run", "packages"),
    ],
)
def test_launcher_leaves_an_environment_with_the_larger_set_alone(has: str, asked: str, todo: str) -> None:
    assert bootstrap.plan(bootstrap.wanted([3, 12, 1], has), answer(), True, asked) == todo


def test_launcher_asks_for_no_more_than_changed_when_the_tools_alone_have_new_versions() -> None:
    stamp = bootstrap.wanted([3, 12, 1], "dev")
    stamp["locks"]["dev"] = "other"
    assert bootstrap.plan(stamp, answer(), True, "run") == "nothing"
    assert bootstrap.plan(stamp, answer(), True, "dev") == "packages"


@pytest.mark.parametrize("here", [None, answer(version=[3, 10, 0]), answer(pip=False)])
def test_launcher_never_deletes_an_environment_made_by_hand(here: dict[str, Any] | None) -> None:
    with pytest.raises(bootstrap_python.Problem, match="Move it away"):
        bootstrap.plan(None, here, True, "run")


@pytest.mark.parametrize(
    ("found", "message"),
    [
        ([None, answer(venv=False, version=[3, 11, 2])], r"python3\.11-venv|python\.org"),
        ([None, answer(version=[3, 10, 1]), answer(fits=False)], r"No Python 3\.11 to"),
    ],
)
def test_launcher_says_the_one_command_that_mends_it(
    monkeypatch: pytest.MonkeyPatch, found: list[dict[str, Any] | None], message: str
) -> None:
    monkeypatch.setattr(bootstrap_python, "probe", lambda command: found[int(command[0])])
    with pytest.raises(bootstrap_python.Problem, match=message):
        bootstrap_python.find_python([str(i)] for i in range(len(found)))


@pytest.mark.skipif(os.name == "nt", reason="scripts with a shebang")
def test_launcher_skips_a_python_that_does_not_run(tmp_path: Path) -> None:
    shim = tmp_path / "python3.12"
    shim.write_text("#!/bin/sh\necho 'version 3.12 is not installed' >&2\nexit 127\n")
    shim.chmod(0o755)
    assert bootstrap_python.probe([str(shim)]) is None
    found = bootstrap_python.probe([sys.executable])
    assert found is not None
    assert tuple(found["version"]) == sys.version_info[:3]


@pytest.fixture
def launcher(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """The launcher with an environment of its own and a suitable Python; the list gets the commands that it calls."""
    calls: list[list[str]] = []
    monkeypatch.setattr(bootstrap, "VENV", tmp_path / ".venv")
    monkeypatch.setattr(bootstrap, "PYTHON", tmp_path / ".venv" / "python")
    monkeypatch.setattr(bootstrap, "find_python", lambda commands: answer())
    monkeypatch.setattr(bootstrap, "probe", lambda command: answer())

    def call(command: list[str], text: str) -> None:
        calls.append(command)
        if "venv" in command:
            bootstrap.PYTHON.touch()

    monkeypatch.setattr(bootstrap, "call", call)
    return calls


def interrupted(command: list[str], text: str) -> None:
    raise KeyboardInterrupt


def test_launcher_marks_an_environment_unfinished_until_it_is_complete(
    launcher: list[list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bootstrap, "call", interrupted)
    assert bootstrap.main([]) == 130
    assert json.loads((bootstrap.VENV / "bootstrap.json").read_text()) == bootstrap.UNFINISHED


def test_launcher_installs_the_set_that_is_asked_for_and_once_only(
    launcher: list[list[str]], capsys: pytest.CaptureFixture[str]
) -> None:
    assert bootstrap.main([]) == 0
    assert [Path(call[-1]).name for call in launcher if "--require-hashes" in call] == ["requirements.lock"]
    assert bootstrap.main(["--dev"]) == 0
    assert [Path(call[-1]).name for call in launcher if "--require-hashes" in call][1:] == ["requirements-dev.lock"]
    said = [line for line in capsys.readouterr().out.splitlines() if line.startswith("Installing")]
    run, dev = bootstrap.SETS["run"], bootstrap.SETS["dev"]
    assert f"what running needs: at most {run.download_mb} MB to download, {run.disk_mb} MB in .venv" in said[0]
    assert f"what testing needs: at most {dev.download_mb - run.download_mb} MB to download, " in said[1]
    assert f", {dev.disk_mb - run.disk_mb} MB more in .venv" in said[1]
    done = len(launcher)
    for arguments in ([], ["--core"], ["--dev"]):
        assert bootstrap.main(arguments) == 0
    assert len(launcher) == done
    assert capsys.readouterr().out == ""


def test_launcher_keeps_what_running_needs_when_adding_the_tools_is_interrupted(
    launcher: list[list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert bootstrap.main([]) == 0
    with monkeypatch.context() as patched:
        patched.setattr(bootstrap, "call", interrupted)
        assert bootstrap.main(["--dev"]) == 130
    assert bootstrap.plan(bootstrap.read_stamp(), answer(), True, "run") == "nothing"
    assert bootstrap.plan(bootstrap.read_stamp(), answer(), True, "dev") == "rebuild"
    assert bootstrap.main(["--dev"]) == 0
    assert bootstrap.plan(bootstrap.read_stamp(), answer(), True, "dev") == "nothing"


def test_launcher_rebuilds_when_replacing_packages_was_interrupted(
    launcher: list[list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert bootstrap.main(["--dev"]) == 0
    bootstrap.write_stamp({**bootstrap.read_stamp(), "locks": {"core": "old", "run": "old", "dev": "old"}})
    monkeypatch.setattr(bootstrap, "call", interrupted)
    assert bootstrap.main([]) == 130
    assert bootstrap.read_stamp() == bootstrap.UNFINISHED


def test_launcher_refuses_to_begin_what_the_disk_cannot_hold(
    launcher: list[list[str]], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda path: SimpleNamespace(free=1_400_000_000))
    assert bootstrap.main([]) == 1
    assert "1400 MB are free" in capsys.readouterr().err
    assert not launcher
    assert bootstrap.main(["--core"]) == 0


def test_launcher_repeats_only_the_step_that_failed(launcher: list[list[str]], monkeypatch: pytest.MonkeyPatch) -> None:
    """A broken pyproject.toml costs one more second, not all packages again."""
    texts: list[str] = []

    def call(command: list[str], text: str) -> None:
        texts.append(text)
        if "--editable" in command:
            raise bootstrap_python.Problem("no README")

    monkeypatch.setattr(bootstrap, "call", call)
    assert bootstrap.main([]) == 1
    assert len(texts) == 3
    assert bootstrap.plan(bootstrap.read_stamp(), answer(), True, "run") == "project"
