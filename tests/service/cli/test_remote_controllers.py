"""The printed examples of remote controllers steer runs of the command line, in Python and in C++; what goes wrong
beside a run is said."""

from __future__ import annotations

import json
import shutil
import socket
import subprocess
import sys
from typing import TYPE_CHECKING, Any

import pytest
from click.testing import CliRunner

from service.admission.cost import check_cost
from service.cli.main import main
from service.settings import Limits
from simcore.errors import ScenarioError
from simcore.remote.messages import message_schema
from simcore.rollout.rollout import run
from simcore.scenario.scenario import Scenario

if TYPE_CHECKING:
    from pathlib import Path

FIELDS = (
    "tissue.element_size_mm=12",
    "needle.elements=6",
    "dt_s=0.02",
    "trajectory.target_mm=[24,41,30]",
    "recording.enabled=false",
)


def example(name: str) -> str:
    done = CliRunner().invoke(main, ["example", name])
    assert done.exit_code == 0
    return done.stdout


def run_beside(folder: Path, command: str | None, *more: str) -> subprocess.CompletedProcess[str]:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    fields = ("controller.kind=remote", f"controller.address=127.0.0.1:{port}", *FIELDS, *more)
    options = ["--controller-command", command] if command else []
    arguments = [
        "run",
        "line",
        "--out",
        str(folder / "out"),
        *options,
        *(part for f in fields for part in ("--set", f)),
    ]
    return subprocess.run(
        [sys.executable, "-m", "service.cli", *arguments], capture_output=True, text=True, timeout=300, check=False
    )


def result(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "out" / "result.json").read_text())
    return found


@pytest.mark.slow
def test_the_python_example_steers(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(example("remote"))
    done = run_beside(
        tmp_path, f"{sys.executable} {tmp_path / 'mine.py'} {{address}}", 'controller.settings={"gain":0.2}'
    )
    assert done.returncode == 0, done.stderr
    assert "run ended: completed" in done.stderr
    steered = result(tmp_path)["metrics"]
    assert steered["success"]
    blind = run(Scenario.load(result(tmp_path)["provenance"]["scenario"] | {"controller": {"kind": "rigid"}}))
    assert steered["final_same_time_mm"] < 0.5 * blind.metrics["final_same_time_mm"]


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("g++") is None, reason="g++ is not installed")
def test_the_cpp_example_steers_as_the_python_example_does(tmp_path: Path) -> None:
    (tmp_path / "mine.cpp").write_text(example("remote-cpp"))
    built = [str(tmp_path / "mine.cpp"), "-o", str(tmp_path / "mine")]
    subprocess.run(["g++", "-std=c++17", "-Wall", "-Wextra", "-Werror", "-O2", *built], check=True, timeout=300)
    done = run_beside(tmp_path, f"{tmp_path / 'mine'} {{address}}")
    assert done.returncode == 0, done.stderr
    (tmp_path / "mine.py").write_text(example("remote"))
    (tmp_path / "python").mkdir()
    run_beside(tmp_path / "python", f"{sys.executable} {tmp_path / 'mine.py'} {{address}}")
    assert result(tmp_path)["digest"] == result(tmp_path / "python")["digest"]


@pytest.mark.slow
def test_a_controller_that_ends_at_once_is_a_named_failure(tmp_path: Path) -> None:
    done = run_beside(tmp_path, f"{sys.executable} -c pass", "controller.connect_timeout_s=1")
    assert done.returncode == 3
    assert result(tmp_path)["status"] == "controller_failed"
    assert "no controller has connected within 1 s" in result(tmp_path)["message"]


@pytest.mark.slow
def test_without_a_command_the_run_says_where_it_waits(tmp_path: Path) -> None:
    done = run_beside(tmp_path, None, "controller.connect_timeout_s=0.5")
    assert "waiting for a controller at 127.0.0.1:" in done.stderr
    assert done.returncode == 3


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["line"], "needs --set controller.kind=remote"),
        (["line", "--set", "controller.kind=remote"], "cannot be started"),
    ],
)
def test_a_command_that_makes_no_sense_is_refused(tmp_path: Path, arguments: list[str], told: str) -> None:
    command = ["--controller-command", str(tmp_path / "no such program")]
    done = CliRunner().invoke(main, ["run", *arguments, "--out", str(tmp_path / "out"), *command])
    assert done.exit_code == 2
    assert told in done.stderr
    assert not (tmp_path / "out").exists()


def test_no_service_runs_one() -> None:
    with pytest.raises(ScenarioError, match="which no service starts or lets in"):
        check_cost(Scenario.load({"controller": {"kind": "remote"}}), Limits())


def test_the_schema_is_printed() -> None:
    assert json.loads(example("remote-schema")) == message_schema()
