"""What is built, what is locked, and the launcher that installs it."""

from __future__ import annotations

import ast
import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from importlib.metadata import PackageNotFoundError, metadata, packages_distributions
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import bootstrap
import bootstrap_python

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).resolve().parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
LOCKS = ("requirements-core.lock", "requirements.lock", "requirements-dev.lock")  # each holds the one before it
PACKAGES = ("needlebench", "simcore", "service", "benchmarks")
LEFT_OUT = ("benchmarks/results/", "benchmarks/pictures/")
COMMIT = "0123456789abcdef0123456789abcdef01234567"


# ---- wheel and source archive


def build(target: str, folder: Path, source: Path = ROOT) -> Path:
    """What `python -m hatchling build` makes of `source`, without a network."""
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "--target", target, "--directory", str(folder)],
        cwd=source,
        env={**os.environ, "NEEDLEBENCH_COMMIT": COMMIT},
        check=True,
    )
    (path,) = folder.iterdir()
    return path


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Iterator[zipfile.ZipFile]:
    """The wheel of this checkout."""
    with zipfile.ZipFile(build("wheel", tmp_path_factory.mktemp("wheel"))) as archive:
        yield archive


@pytest.mark.slow
def test_wheel_ships_every_file_of_the_packages_and_nothing_else(wheel: zipfile.ZipFile) -> None:
    here = {
        path.relative_to(ROOT).as_posix()
        for package in PACKAGES
        for path in (ROOT / package).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    expected = {name for name in here if not name.startswith(LEFT_OUT)} | {"simcore/_commit.txt"}
    shipped = {name for name in wheel.namelist() if ".dist-info/" not in name}
    assert shipped == expected
    assert here - shipped, "results and pictures are in the checkout"
    assert any(name.startswith("service/store/migrations/") for name in shipped)
    assert sum(item.compress_size for item in wheel.infolist()) < 1_500_000


@pytest.mark.parametrize("package", PACKAGES)
def test_each_package_says_that_it_is_typed(wheel: zipfile.ZipFile, package: str) -> None:
    assert f"{package}/py.typed" in wheel.namelist()


def test_wheel_has_command_licences_and_commit(wheel: zipfile.ZipFile) -> None:
    files = {name.split("/", 1)[1]: name for name in wheel.namelist() if ".dist-info/" in name}
    assert "needlebench = service.cli.main:main" in wheel.read(files["entry_points.txt"]).decode()
    assert "License-Expression: Apache-2.0 AND MIT\n" in wheel.read(files["METADATA"]).decode()
    for name in ("LICENSE", "NOTICE", "service/web/static/vendor/uplot/LICENSE"):
        assert wheel.read(files[f"licenses/{name}"]) == (ROOT / name).read_bytes()
    licence = (ROOT / "LICENSE").read_text(encoding="utf-8")
    assert "Apache License" in licence
    assert "END OF TERMS AND CONDITIONS" in licence
    assert wheel.read("simcore/_commit.txt").decode() == COMMIT + "\n"


@pytest.mark.slow
def test_the_source_archive_builds_the_same_wheel(wheel: zipfile.ZipFile, tmp_path: Path) -> None:
    with tarfile.open(build("sdist", tmp_path / "sdist")) as archive:
        archive.extractall(tmp_path / "source", filter="data")
    (source,) = (tmp_path / "source").iterdir()
    with zipfile.ZipFile(build("wheel", tmp_path / "again", source)) as again:
        assert sorted(again.namelist()) == sorted(wheel.namelist())
        assert all(again.read(name) == wheel.read(name) for name in wheel.namelist())
    here = {path.relative_to(source).as_posix() for path in source.rglob("*") if path.is_file()}
    assert {"SECURITY.md", "CHANGELOG.md", "CITATION.cff", "README.md", "PKG-INFO"} <= here
    assert not {name for name in here if name.startswith((*LEFT_OUT, "tests/", "requirements"))}


# ---- licences


def test_notice_names_what_is_shipped_and_what_is_under_a_copyleft_licence() -> None:
    notice = (ROOT / "NOTICE").read_text(encoding="utf-8")
    copyleft = set()
    for name in locked("requirements.lock"):
        try:
            about = metadata(name)
        except PackageNotFoundError:  # of another platform
            continue
        fields = {field: about.get_all(field, []) for field in ("License-Expression", "License", "Classifier")}
        said = [*fields["License-Expression"], *(text[:100] for text in fields["License"]), *fields["Classifier"]]
        if re.search(r"\b(A?L?GPL|MPL|EPL)|General Public|Mozilla", str([text for text in said if text])):
            copyleft.add(name)
    assert "pebble" in copyleft
    assert {name for name in copyleft if name not in notice.lower()} == set()
    vendored = (ROOT / "service/web/static/vendor/NOTICE").read_text(encoding="utf-8").split(",")[0]
    assert vendored in notice
    assert "This is research software and no medical device." in notice


def test_committed_results_have_a_licence_of_their_own() -> None:
    text = (ROOT / "benchmarks/results/LICENSE").read_text(encoding="utf-8")
    for part in ("Creative Commons Attribution 4.0 International", "https://creativecommons.org/licenses/by/4.0/"):
        assert part in text
        assert part in (ROOT / "NOTICE").read_text(encoding="utf-8")


# ---- the commit


@pytest.mark.slow
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


def entries(lock: str) -> list[str]:
    """Each requirement of a lock with its marker and hashes, without comments."""
    lines = (ROOT / lock).read_text(encoding="utf-8").splitlines()
    text = "\n".join(line for line in lines if not line.lstrip().startswith("#"))
    return [entry.strip() for entry in re.split(r"^(?=[A-Za-z0-9])", text, flags=re.MULTILINE) if entry.strip()]


def locked(lock: str) -> dict[str, list[str]]:
    """Versions of each locked package (several where the Python version decides)."""
    versions: dict[str, list[str]] = {}
    for entry in entries(lock):
        name, version = entry.split()[0].split("==")
        versions.setdefault(canonicalize_name(name), []).append(version)
    return versions


def group(name: str) -> list[str]:
    """The requirements of a dependency group, those of the groups in it too."""
    lines: list[str] = []
    for entry in PROJECT["dependency-groups"][name]:
        lines += [entry] if isinstance(entry, str) else group(entry["include-group"])
    return lines


@pytest.mark.parametrize("lock", LOCKS)
def test_a_lock_names_no_index_and_hashes_every_package(lock: str) -> None:
    text = (ROOT / lock).read_text(encoding="utf-8")
    assert len(entries(lock)) >= 20
    for entry in entries(lock):
        assert re.match(r"[A-Za-z0-9_.-]+==[^ ]+ ", entry), entry
        assert re.search(r"--hash=sha256:[0-9a-f]{64}", entry), entry
    assert not re.search(r"https?:|file:|^\s*-(i|f|-index|-extra|-find)", text, re.MULTILINE)


def test_each_lock_holds_the_one_before_it_in_the_same_versions() -> None:
    """What makes it right to leave an environment with the larger set alone where the smaller one is wanted."""
    core, run, dev = (set(entries(lock)) for lock in LOCKS)
    assert core < run < dev
    assert tuple(packages.lock for packages in bootstrap.SETS.values()) == LOCKS


@pytest.mark.parametrize(
    ("lock", "asked"),
    [
        ("requirements-core.lock", group("core")),
        ("requirements.lock", PROJECT["project"]["dependencies"]),
        ("requirements-dev.lock", group("dev")),
    ],
    ids=["core", "run", "dev"],
)
def test_a_lock_satisfies_the_project(lock: str, asked: list[str]) -> None:
    for line in [*asked, *PROJECT["build-system"]["requires"]]:
        requirement = Requirement(line)
        versions = locked(lock)[canonicalize_name(requirement.name)]
        assert all(requirement.specifier.contains(version) for version in versions), (line, versions)


def test_what_running_needs_holds_no_tool_of_tests_and_docs() -> None:
    tools = {canonicalize_name(Requirement(line).name) for line in group("dev")}
    assert not tools & locked("requirements.lock").keys()


def test_the_core_is_part_of_what_running_needs_and_has_no_viewer_store_or_server() -> None:
    names = {canonicalize_name(Requirement(line).name) for line in PROJECT["project"]["dependencies"]}
    assert {canonicalize_name(name) for name in group("core")} < names
    left_out = {"rerun-sdk", "pyarrow", "sqlalchemy", "alembic", "fastapi", "starlette", "uvicorn", "httpx2"}
    assert left_out <= locked("requirements.lock").keys()
    assert not left_out & locked("requirements-core.lock").keys()


@pytest.mark.parametrize("name", ["uvicorn", "pebble"])
def test_packages_whose_insides_are_overridden_stay_at_the_version_that_was_tried(name: str) -> None:
    (asked,) = [r for r in map(Requirement, PROJECT["project"]["dependencies"]) if r.name == name]
    (version,) = locked("requirements.lock")[name]
    major, minor = map(int, version.split(".")[:2])
    assert asked.specifier.contains(f"{major}.{minor}.99")
    assert not asked.specifier.contains(f"{major}.{minor + 1}.0")
    assert not asked.specifier.contains(f"{major}.{minor - 1}.99")


# ---- the core

BLOCK = """
import sys

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {names!r}:
            raise ModuleNotFoundError(f"{{name}} is not in the core", name=name)

sys.meta_path.insert(0, Blocked())
"""


@pytest.fixture
def core_environment(tmp_path: Path) -> dict[str, str]:
    """Variables with which a Python and its children find no package but those of requirements-core.lock."""
    beyond = locked("requirements-dev.lock").keys() - locked("requirements-core.lock").keys()
    names = {
        name
        for name, homes in packages_distributions().items()
        if {canonicalize_name(home) for home in homes} <= beyond
    }
    assert {"rerun", "pyarrow", "sqlalchemy", "alembic", "fastapi", "starlette", "uvicorn", "httpx2", "jinja2"} <= names
    (tmp_path / "sitecustomize.py").write_text(BLOCK.format(names=names), encoding="utf-8")
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])}


def in_core(environment: dict[str, str], *arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "service.cli", *map(str, arguments)]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=600, check=False)


@pytest.mark.slow
def test_an_insertion_without_a_recording_needs_the_core_alone(
    core_environment: dict[str, str], tmp_path: Path
) -> None:
    settings = ["tissue.element_size_mm=12", "dt_s=0.05", "recording.enabled=false"]
    changes = [word for setting in settings for word in ("--set", setting)]
    done = in_core(core_environment, "run", "line", "--out", tmp_path / "line", *changes)
    assert done.returncode in (0, 3), done.stderr
    assert json.loads((tmp_path / "line" / "result.json").read_text())["status"] == "completed"
    with_recording = in_core(core_environment, "run", "line", "--out", tmp_path / "other", *changes[:-2])
    assert with_recording.returncode == 1, "the environment of this test holds more than the core"
    assert "this command needs the package rerun, which is not installed" in with_recording.stderr


@pytest.mark.slow
def test_training_insertions_in_several_processes_need_the_core_alone(
    core_environment: dict[str, str], tmp_path: Path
) -> None:
    coarse = ["--set", "tissue.element_size_mm=12", "--set", "dt_s=0.05", "--insertions", 2, "--samples", 50]
    data, model = tmp_path / "data.npz", tmp_path / "elm.json"
    done = in_core(core_environment, "dataset", "--out", data, *coarse)
    assert done.returncode == 0, done.stderr
    done = in_core(core_environment, "train", "--data", data, "--kind", "elm", "--out", model)
    assert done.returncode == 0, done.stderr
    assert json.loads(model.read_text())


# ---- the hooks


@pytest.fixture(scope="module")
def hooks() -> list[dict[str, Any]]:
    yaml = pytest.importorskip("yaml", reason="needs PyYAML, which comes with pre-commit")
    (repository,) = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8"))["repos"]
    assert repository["repo"] == "local", "a hook from elsewhere would be fetched"
    found: list[dict[str, Any]] = repository["hooks"]
    return found


def test_hooks_are_programs_of_the_environment(hooks: list[dict[str, Any]]) -> None:
    here = {path.stem for path in Path(sys.executable).parent.iterdir()}
    for hook in hooks:
        assert hook["language"] == "unsupported", "any other makes an environment, for which it fetches packages"
        folder, _, program = hook["entry"].split()[0].rpartition("/")
        assert folder == ".venv/bin"
        assert program in here


def test_hooks_run_what_make_check_runs(hooks: list[dict[str, Any]]) -> None:
    """File names apart, which git hands to a hook."""
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    recipe = makefile.split("\ncheck:", 1)[1].split("\n\n", 1)[0]
    checks = {
        command.replace(" --check", "").removesuffix(" .")
        for command in re.findall(r"^\t\$\(BIN\)/(.*)$", recipe, re.M)
    }
    run = {hook["entry"].replace(" --force-exclude", "").removeprefix(".venv/bin/") for hook in hooks}
    assert len(checks) >= 3
    assert checks <= run


# ---- the launcher


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
