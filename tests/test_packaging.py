"""What is built, and what is locked."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from importlib.metadata import PackageNotFoundError, metadata, packages_distributions
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import bootstrap

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
