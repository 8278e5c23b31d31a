"""What is built, what is locked, and the launcher that installs it."""

from __future__ import annotations

import ast
import json
import os
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import bootstrap

ROOT = Path(__file__).resolve().parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
LOCK = (ROOT / "requirements.lock").read_text(encoding="utf-8")
COMMIT = "0123456789abcdef0123456789abcdef01234567"


# ---- the wheel


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    """The wheel of this checkout, built without a network."""
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(folder)],
        cwd=ROOT,
        env={**os.environ, "NEEDLEBENCH_COMMIT": COMMIT},
        check=True,
    )
    (path,) = folder.glob("*.whl")
    return zipfile.ZipFile(path)


def test_wheel_ships_every_file_of_the_packages_and_nothing_else(wheel: zipfile.ZipFile) -> None:
    packages = ("simcore", "service", "benchmarks")
    here = {
        path.relative_to(ROOT).as_posix()
        for package in packages
        for path in (ROOT / package).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    shipped = {name for name in wheel.namelist() if ".dist-info/" not in name}
    assert shipped == here | {"needlebench.py", "simcore/_commit.txt"}
    assert any(name.startswith("service/store/migrations/") for name in shipped)


def test_wheel_has_command_licence_and_commit(wheel: zipfile.ZipFile) -> None:
    metadata = {name.split("/", 1)[1]: name for name in wheel.namelist() if ".dist-info/" in name}
    assert "needlebench = service.cli.main:main" in wheel.read(metadata["entry_points.txt"]).decode()
    licence = wheel.read(metadata["licenses/LICENSE"]).decode()
    assert licence == (ROOT / "LICENSE").read_text(encoding="utf-8")
    assert "Apache License" in licence
    assert "END OF TERMS AND CONDITIONS" in licence
    assert wheel.read("simcore/_commit.txt").decode() == COMMIT + "\n"


def test_commit_comes_from_git_when_nothing_else_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    hatch_build = pytest.importorskip("hatch_build")
    monkeypatch.delenv("NEEDLEBENCH_COMMIT", raising=False)
    for name in ("GIT_DIR", "GIT_WORK_TREE", "GIT_INDEX_FILE"):
        monkeypatch.delenv(name, raising=False)
    assert hatch_build.commit_of(tmp_path) is None
    (tmp_path / "file").write_text("one")
    identity = ["-c", "user.name=a", "-c", "user.email=a@example.org"]
    for arguments in (["init", "-q"], ["add", "file"], [*identity, "commit", "-qm", "first"]):
        subprocess.run(["git", *arguments], cwd=tmp_path, check=True)
    clean = hatch_build.commit_of(tmp_path)
    assert re.fullmatch("[0-9a-f]{40}", clean)
    (tmp_path / "file").write_text("two")
    assert hatch_build.commit_of(tmp_path) == clean + "-dirty"


# ---- the lock


def locked() -> dict[str, list[str]]:
    """Versions of each locked package (several where the Python version decides)."""
    versions: dict[str, list[str]] = {}
    for name, version in re.findall(r"^([A-Za-z0-9_.-]+)==([^ ;\\]+)", LOCK, re.MULTILINE):
        versions.setdefault(canonicalize_name(name), []).append(version)
    return versions


def test_lock_names_no_index_and_hashes_every_package() -> None:
    entries = re.split(r"^(?=[A-Za-z0-9])", LOCK, flags=re.MULTILINE)[1:]
    assert len(entries) >= 50
    for entry in entries:
        assert re.match(r"[A-Za-z0-9_.-]+==[^ ]+ ", entry), entry
        assert re.search(r"--hash=sha256:[0-9a-f]{64}", entry), entry
    assert not re.search(r"https?:|file:|^\s*-(i|f|-index|-extra|-find)", LOCK, re.MULTILINE)


def test_lock_satisfies_the_project() -> None:
    project = PROJECT["project"]
    asked = [
        *project["dependencies"],
        *project["optional-dependencies"]["dev"],
        *PROJECT["build-system"]["requires"],
    ]
    for line in asked:
        requirement = Requirement(line)
        versions = locked()[canonicalize_name(requirement.name)]
        assert all(requirement.specifier.contains(version) for version in versions), (line, versions)


# ---- the launcher


def test_launcher_reads_on_an_old_python_and_needs_no_package() -> None:
    tree = ast.parse((ROOT / "bootstrap.py").read_text(encoding="utf-8"), feature_version=(3, 8))
    imports = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    imports |= {str(node.module) for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert {name.split(".")[0] for name in imports} <= sys.stdlib_module_names


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
        ({"lock": "other"}, answer(), True, "packages"),
        ({"path": "elsewhere"}, answer(), True, "rebuild"),
        ({}, answer(version=[3, 12, 2]), True, "rebuild"),
        ({}, None, True, "rebuild"),
    ],
)
def test_launcher_does_no_more_than_needed(stamp: Any, here: dict[str, Any] | None, exists: bool, todo: str) -> None:
    """A dictionary stands for a complete stamp with these differences."""
    if isinstance(stamp, dict):
        stamp = {**bootstrap.wanted([3, 12, 1]), **stamp}
    assert bootstrap.plan(stamp, here, exists) == todo


@pytest.mark.parametrize("here", [None, answer(version=[3, 10, 0]), answer(pip=False)])
def test_launcher_never_deletes_an_environment_made_by_hand(here: dict[str, Any] | None) -> None:
    with pytest.raises(bootstrap.Problem, match="Move it away"):
        bootstrap.plan(None, here, True)


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
    monkeypatch.setattr(bootstrap, "candidates", lambda: [[str(i)] for i in range(len(found))])
    monkeypatch.setattr(bootstrap, "probe", lambda command: found[int(command[0])])
    with pytest.raises(bootstrap.Problem, match=message):
        bootstrap.find_python()


@pytest.mark.skipif(os.name == "nt", reason="scripts with a shebang")
def test_launcher_skips_a_python_that_does_not_run(tmp_path: Path) -> None:
    shim = tmp_path / "python3.12"
    shim.write_text("#!/bin/sh\necho 'version 3.12 is not installed' >&2\nexit 127\n")
    shim.chmod(0o755)
    assert bootstrap.probe([str(shim)]) is None
    found = bootstrap.probe([sys.executable])
    assert found is not None
    assert tuple(found["version"]) == sys.version_info[:3]


def test_launcher_marks_an_environment_unfinished_until_it_is_complete(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bootstrap, "VENV", tmp_path / ".venv")
    monkeypatch.setattr(bootstrap, "find_python", answer)

    def interrupted(command: list[str], text: str) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(bootstrap, "call", interrupted)
    assert bootstrap.main([]) == 130
    assert json.loads((tmp_path / ".venv" / "bootstrap.json").read_text()) == bootstrap.UNFINISHED


def test_launcher_repeats_only_the_step_that_failed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A broken pyproject.toml costs one more second, not all packages again."""
    monkeypatch.setattr(bootstrap, "VENV", tmp_path / ".venv")
    monkeypatch.setattr(bootstrap, "find_python", answer)
    monkeypatch.setattr(bootstrap, "probe", lambda command: answer())
    texts: list[str] = []

    def call(command: list[str], text: str) -> None:
        texts.append(text)
        if "--editable" in command:
            raise bootstrap.Problem("no README")

    monkeypatch.setattr(bootstrap, "call", call)
    assert bootstrap.main([]) == 1
    assert len(texts) == 3
    assert bootstrap.plan(bootstrap.read_stamp(), answer(), True) == "project"
