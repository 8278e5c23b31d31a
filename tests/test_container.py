"""Dockerfile and compose.yaml, as far as they can be checked without an engine: what they say is tried here."""

from __future__ import annotations

import fnmatch
import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import click
import pytest

from service.cli.main import main
from tests.acceptance.server import PATIENCE_S, running_server, until

ROOT = Path(__file__).resolve().parent.parent
PORT = "8321"
LEFT_OUT = ("benchmarks/results/", "benchmarks/pictures/")
Step = tuple[str, str]


def stages() -> list[list[Step]]:
    """Instructions and their arguments, stage by stage, lines that go on put together."""
    lines = [line for line in (ROOT / "Dockerfile").read_text().splitlines() if not line.lstrip().startswith("#")]
    text = re.sub(r"\\\n", " ", "\n".join(lines))
    steps = [(word, rest.strip()) for word, _, rest in (line.partition(" ") for line in text.splitlines() if line)]
    found: list[list[Step]] = []
    for word, rest in steps:
        if word == "FROM":
            found.append([])
        found[-1].append((word, rest))
    return found


def said(word: str, stage: int = -1) -> list[str]:
    return [rest for name, rest in stages()[stage] if name == word]


def variables() -> dict[str, str]:
    """What ENV sets in the image."""
    return dict(part.split("=", 1) for text in said("ENV") for part in shlex.split(text))


def health_command() -> list[str]:
    (text,) = said("HEALTHCHECK")
    command: list[str] = json.loads(text[text.index("[") :])
    assert text[: text.index("[")].endswith("CMD ")
    return command


# ---- the image


def test_two_stages_of_one_base_and_only_the_environment_goes_over() -> None:
    build, image = stages()
    base = build[0][1].partition(" AS ")[0]
    assert build[0][1] == f"{base} AS build"
    assert image[0][1] == base
    version = re.fullmatch(r"python:3\.(\d+)-slim", base)
    assert version is not None
    assert 11 <= int(version[1]) <= 13
    assert said("COPY") == ["--from=build /opt/needlebench /opt/needlebench"]


def test_it_runs_as_a_numbered_user_who_owns_the_volume_alone() -> None:
    (user,) = said("USER")
    assert re.fullmatch(r"[1-9]\d{3,}:[1-9]\d{3,}", user)
    assert said("VOLUME") == ["/data"]
    assert f"mkdir /data && chown {user} /data" in said("RUN")
    words = [word for word, _ in stages()[-1]]
    assert words.index("USER") > max(i for i, word in enumerate(words) if word in ("COPY", "RUN"))
    written = {name: value for name, value in variables().items() if name in ("HOME", "XDG_CACHE_HOME")}
    assert all(value == "/data" or value.startswith("/data/") for value in written.values())
    assert variables()["NEEDLEBENCH_DATA"] == "/data"


def test_what_is_copied_exists_and_is_let_through() -> None:
    sources = [text.split()[:-1] for text in said("COPY", 0)]
    assert sources == [["requirements.lock"], ["."]]
    assert let_through("requirements.lock")


def test_every_package_is_checked_against_the_lock_and_nothing_else_is_fetched() -> None:
    runs = said("RUN", 0)
    (fetched,) = [run for run in runs if "pip download" in run]
    assert "--require-hashes" in fetched
    assert "--no-deps" in fetched
    assert re.findall(r"\S+\.lock", " ".join(runs)) == ["requirements.lock"], "what running needs, no tools"
    installs = [part for run in runs for part in run.split("&&") if "install" in part and "pip" in part]
    assert len(installs) == 2
    assert all("--no-index" in part and "--find-links /wheels" in part for part in installs)
    assert not re.search(r"https?://", " ".join([*runs, *said("RUN")]))
    assert not re.search(r"(KEY|TOKEN|SECRET|PASSWORD)\s*=", (ROOT / "Dockerfile").read_text().split("FROM", 1)[1])


def test_the_command_is_one_that_the_command_line_takes() -> None:
    program, *words = json.loads(said("CMD")[0])
    assert program == "needlebench"
    name, command, rest = main.resolve_command(click.Context(main), words)
    assert name == "serve"
    assert command is not None
    asked = command.make_context(name, rest).params
    assert (asked["host"], asked["port"], str(asked["data"])) == ("0.0.0.0", int(PORT), "/data")
    assert said("EXPOSE") == [PORT]


@pytest.mark.slow
def test_without_a_key_the_command_refuses_to_start(tmp_path: Path) -> None:
    words = json.loads(said("CMD")[0])[1:]
    words = [str(tmp_path / "data") if word == "/data" else word for word in words]
    environment = {k: v for k, v in os.environ.items() if not k.startswith("NEEDLEBENCH_")}
    command = [sys.executable, "-m", "service.cli", *words]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert "needs a key" in done.stderr


@pytest.mark.slow
def test_the_health_check_tells_a_service_that_answers_from_one_that_does_not(tmp_path: Path) -> None:
    program, flag, code = health_command()
    assert (program, flag) == ("python", "-c")
    assert code.count(f":{PORT}/") == 1
    with running_server(tmp_path) as server:
        port = server.url.rpartition(":")[2]
        until(lambda: _exit_code(code, port) == 0)  # a try has 4 s; Docker tries again too
    assert _exit_code(code, port) != 0


def _exit_code(code: str, port: str) -> int:
    command = [sys.executable, "-c", code.replace(f":{PORT}/", f":{port}/")]
    return subprocess.run(command, capture_output=True, timeout=PATIENCE_S, check=False).returncode


# ---- what gets into the build


def let_through(path: str) -> bool:
    """Whether .dockerignore lets a file into the build: the last line that fits it decides."""
    allowed = True
    for line in (ROOT / ".dockerignore").read_text().splitlines():
        if not line or line.startswith("#"):
            continue
        pattern, keeps = line.removeprefix("!"), line.startswith("!")
        above = ["/".join(path.split("/")[: i + 1]) for i in range(path.count("/") + 1)]
        tail = pattern.removeprefix("**/")
        fits = any(fnmatch.fnmatchcase(part, pattern) for part in above) or (
            pattern != tail and any(fnmatch.fnmatchcase(part.rpartition("/")[2], tail) for part in above)
        )
        allowed = keeps if fits else allowed
    return allowed


@pytest.mark.parametrize(
    "path",
    [
        *(".git/config", ".venv/bin/python", ".env", "needlebench.env", "compose.yaml", "data/needlebench.sqlite"),
        *(
            "requirements-dev.lock",
            ".venv-3.13/bin/python",
            "benchmarks/results/LICENSE",
            "benchmarks/pictures/demo.png",
        ),
        *("out/models/data.npz", "tests/conftest.py", "service/__pycache__/a.pyc", "simcore/a.pyc", ".ci/pipeline"),
    ],
)
def test_secrets_data_and_leftovers_stay_out(path: str) -> None:
    assert not let_through(path)


def test_all_that_the_wheel_is_built_from_gets_in() -> None:
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False)
    if listed.returncode:
        pytest.skip("needs a git checkout, to know which files are the project's")
    folders = ("needlebench/", "simcore/", "service/", "benchmarks/")
    packages = [name for name in listed.stdout.split() if name.startswith(folders) and not name.startswith(LEFT_OUT)]
    needed = ["pyproject.toml", "hatch_build.py", "README.md", "LICENSE", "NOTICE", "requirements.lock"]
    assert len(packages) > 200
    assert [name for name in [*needed, *packages] if not let_through(name)] == []


@pytest.mark.slow
def test_the_step_that_builds_the_wheel_works_on_what_gets_in(tmp_path: Path) -> None:
    """The same command as in the Dockerfile, in a folder that holds no more than the build sees."""
    (run,) = [run for run in said("RUN", 0) if "hatchling build" in run]
    words = shlex.split(run.rpartition("-m ")[2])
    assert words[:2] == ["hatchling", "build"]
    source, wheels = tmp_path / "source", tmp_path / "wheels"
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False)
    if listed.returncode:
        pytest.skip("needs a git checkout, to know which files are the project's")
    for name in filter(let_through, listed.stdout.split()):
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        (source / name).write_bytes((ROOT / name).read_bytes())
    command = [sys.executable, "-m", *(str(wheels) if word == "/wheels" else word for word in words)]
    environment = {**os.environ, "NEEDLEBENCH_COMMIT": "0123456789" * 4}
    subprocess.run(command, cwd=source, env=environment, check=True, timeout=120, stdout=subprocess.DEVNULL)
    assert [path.suffix for path in wheels.iterdir()] == [".whl"]


# ---- compose


@pytest.fixture
def composed() -> dict[str, Any]:
    yaml = pytest.importorskip("yaml", reason="needs PyYAML, which comes with schemathesis")
    found: dict[str, Any] = yaml.safe_load((ROOT / "compose.yaml").read_text())
    return found


def test_compose_gives_no_more_than_is_needed(composed: dict[str, Any]) -> None:
    (service,) = composed["services"].values()
    assert service["read_only"] is True
    assert service["cap_drop"] == ["ALL"]
    assert service["security_opt"] == ["no-new-privileges:true"]
    assert [service["user"]] == said("USER")
    assert service["restart"] == "unless-stopped"
    assert (service["cpus"], service["mem_limit"]) == (2, "4g")
    assert "privileged" not in service
    assert [tmpfs.partition(":")[0] for tmpfs in service["tmpfs"]] == ["/tmp"]
    (volume,) = service["volumes"]
    assert volume.split(":") == [*composed["volumes"], "/data"]
    (port,) = service["ports"]
    assert port == f"127.0.0.1:{PORT}:{PORT}"
    assert not {"healthcheck", "command", "entrypoint"} & service.keys(), "those of the image hold"


def test_compose_takes_the_key_from_a_file_that_is_kept_nowhere(composed: dict[str, Any]) -> None:
    (service,) = composed["services"].values()
    assert not any("KEY" in name for name in service["environment"])
    assert not let_through(service["env_file"])
    ignored = subprocess.run(["git", "check-ignore", "-q", service["env_file"]], cwd=ROOT, check=False)
    assert ignored.returncode in (0, 128), "add it to .gitignore"


def test_compose_sets_what_the_service_reads(composed: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    from service.settings import Settings, limits_help, variables_help

    (service,) = composed["services"].values()
    known = {name for name, _ in [*variables_help(), *limits_help()]}
    assert service["environment"].keys() <= known
    for name, value in service["environment"].items():
        monkeypatch.setenv(name, str(value))
    settings = Settings.load()
    jobs_mb = settings.workers * settings.limits.job_memory_mb
    assert jobs_mb + 700 < 4096, "two full jobs and the server stay below the limit of the container"
