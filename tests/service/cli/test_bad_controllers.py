"""A controller that goes wrong at its sixth step, by Python, by the command and in a worker: named with arm, step and
value, and what was run until then is kept, everywhere alike."""

from __future__ import annotations

import json
import math
import threading
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from click.testing import CliRunner

from needlebench import Pose, register_controller
from service.cli.main import main
from service.settings import RUNNER
from service.worker.attempt import execute
from service.worker.specs import InsertionSpec
from simcore.errors import Status
from simcore.rollout.rollout import run
from tests.simcore.short_run import short

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from needlebench import Observation, Scenario

WRONG_AT, ROWS = 5, 6
ENOUGH = threading.Event()  # whoever hangs may go on


class Wrong:
    """Follows its target, until it does what its settings say."""

    limited = True

    def __init__(self, _scenario: Scenario, _entry_m: object, _length_m: float, settings: dict[str, str]) -> None:
        self.how = settings["how"]

    def command(self, seen: Observation) -> Any:
        position_m = seen.base.position_m + (seen.target_m - seen.tip_m)
        if seen.step != WRONG_AT:
            return Pose(position_m, seen.base.rotation)
        match self.how:
            case "NaN":
                return Pose(np.array([0.012, math.nan, -0.08]), seen.base.rotation)
            case "shape":
                return Pose(position_m[:2], seen.base.rotation)
            case "millimetres":
                return Pose(1e3 * position_m, seen.base.rotation)
            case "far":
                return Pose(np.array([0.0, 0.0, 1e4]), seen.base.rotation)
            case "no rotation":
                return Pose(position_m, 2.0 * np.eye(3))
            case "no pose":
                return position_m
            case "raises":
                raise ValueError("singular matrix")
            case "no file":
                raise FileNotFoundError(2, "No such file or directory", "net.pt")
            case _:
                return ENOUGH.wait(600.0)


ANSWERED = "controller 'wrong' answered with a Pose with"
TOLD = {
    "NaN": f"{ANSWERED} position_m = [0.012, nan, -0.08], values that are not finite",
    "shape": f"{ANSWERED} position_m (2,) and rotation (3, 3), not (3,) and (3, 3)",
    "millimetres": "that looks like millimetres, position_m is in metres",
    "far": f"{ANSWERED} position_m = [0.0, 0.0, 10000.0], 1e+04 m from the base: at most 10 m are allowed",
    "no rotation": f"{ANSWERED} rotation = [[2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0]], which is no rotation",
    "no pose": "controller 'wrong' answered with a ndarray, not a Pose",
    "raises": "controller 'wrong': ValueError: singular matrix (test_bad_controllers.py, line",
    "no file": "controller 'wrong': FileNotFoundError: [Errno 2] No such file or directory: 'net.pt' (test_bad_",
    "hangs": "controller 'wrong': has not answered within controller.step_timeout_s = 1 s, step 5",
}


@pytest.fixture(autouse=True)
def enough() -> Iterator[None]:
    register_controller("wrong", Wrong)
    yield
    ENOUGH.set()
    for thread in threading.enumerate():
        if thread.name == "controller wrong":
            thread.join(60.0)
    ENOUGH.clear()


def wrong(how: str) -> Scenario:
    block = {"kind": "plugin", "name": "wrong", "settings": {"how": how}, "step_timeout_s": 1.0}
    return short(controller=block, recording={"enabled": False})


def check(result: dict[str, Any], series: Any, how: str) -> None:
    assert result["status"] == Status.CONTROLLER_FAILED
    assert result["message"].startswith("step 6 of 41, depth ")
    assert TOLD[how] in result["message"]
    assert result["provenance"]["arm"]["controller"] == "wrong"
    assert len(series["t_s"]) == len(series["tip_m"]) == ROWS
    assert result["metrics"]["steps_completed"] == ROWS - 1


@pytest.mark.parametrize("how", TOLD)
def test_in_python(how: str) -> None:
    done = run(wrong(how))
    check(done.result(), done.series, how)


@pytest.mark.parametrize("how", TOLD)
def test_by_the_command(how: str, tmp_path: Path) -> None:
    (tmp_path / "wrong.json").write_text(json.dumps(wrong(how).resolved()))
    done = CliRunner().invoke(main, ["run", str(tmp_path / "wrong.json"), "--out", str(tmp_path / "out")])
    assert done.exit_code == 3, done.output
    assert TOLD[how] in done.stdout.replace("\n", " ")
    with np.load(tmp_path / "out" / "series.npz") as series:
        check(json.loads((tmp_path / "out" / "result.json").read_text()), series, how)


@pytest.mark.parametrize("how", TOLD)
def test_in_a_worker_of_the_service(how: str, tmp_path: Path) -> None:
    """One that hangs costs the worker its process, which would go on with it."""
    spec = InsertionSpec(job_id="a", scenario=wrong(how).resolved(), files=tmp_path)
    report = execute(RUNNER, spec.to_json(), str(tmp_path / "1"))
    assert report.error is None
    with np.load(tmp_path / "1" / "series.npz") as series:
        check(report.result, series, how)
    assert {"result.json", "series.npz"} <= {file["name"] for file in report.artefacts}
    assert ("1 thread" in report.leftovers) == (how == "hangs")
