"""`needlebench run`: what it writes, refuses, replaces, and leaves when it is stopped."""

from __future__ import annotations

import json
import sys
import types
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import simcore.rollout
from tests.service.cli.invoked import invoke
from tests.service.fake_run import FakeRollout, FakeRun
from tests.service.recording.recorded import recorded, short

if TYPE_CHECKING:
    from simcore.scenario.scenario import Scenario

    pass

FILES = {"result.json", "series.npz", "recording.rrd"}


class Simulation:
    """Stands in for simcore.rollout.rollout and simcore.rollout.artefacts; remembers what it was asked to run."""

    def __init__(self) -> None:
        self.scenarios: list[Scenario] = []
        self.status, self.success = "completed", True
        self.warnings: list[str] = []
        self.stop_at: int | None = None
        self.error: BaseException | None = None
        self.write_error: BaseException | None = None

    def run(self, scenario: Scenario, observer: Any) -> FakeRollout:
        self.scenarios.append(scenario)
        rollout = FakeRun(scenario, stop_at=self.stop_at, error=self.error).run(observer)
        rollout.status, rollout.success, rollout.warnings = self.status, self.success, self.warnings
        return rollout

    def write(self, rollout: FakeRollout, folder: Path) -> None:
        np.savez(folder / "series.npz", t_s=np.zeros(3))
        if self.write_error is not None:
            raise self.write_error
        (folder / "result.json").write_text(json.dumps(rollout.result()))


@pytest.fixture
def simulation(monkeypatch: pytest.MonkeyPatch) -> Simulation:
    fake = Simulation()
    for name, function in (("rollout", "run"), ("artefacts", "write")):
        module = types.SimpleNamespace(**{function: getattr(fake, function)})
        monkeypatch.setitem(sys.modules, f"simcore.rollout.{name}", module)
        monkeypatch.setattr(simcore.rollout, name, module, raising=False)
    return fake


@pytest.fixture
def source(tmp_path: Path) -> str:
    path = tmp_path / "mine.json"
    path.write_text(json.dumps(short().resolved()))
    return str(path)


@pytest.mark.slow
def test_run_writes_everything_and_reports(simulation: Simulation, source: str, tmp_path: Path) -> None:
    out = tmp_path / "results" / "first"
    result = invoke("run", source, "--out", str(out))
    assert result.exit_code == 0, result.output
    assert {path.name for path in out.iterdir()} == FILES
    assert simulation.scenarios == [short()]
    for text in (
        "short: completed",
        "rmse_commanded_mm",
        "0.25",
        "realtime_factor",
        "0123456789abcdef",
        "recording.rrd",
    ):
        assert text in result.stdout
    assert result.stderr == ""


@pytest.mark.slow
def test_run_without_recording(simulation: Simulation, source: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = invoke("run", source, "--out", str(out), "--set", "recording.enabled=false")
    assert result.exit_code == 0
    assert {path.name for path in out.iterdir()} == FILES - {"recording.rrd"}


@pytest.mark.slow
@pytest.mark.parametrize(("status", "success"), [("completed", False), ("not_converged", False), ("inverted", True)])
def test_run_without_success_is_a_result_with_exit_3(
    simulation: Simulation, source: str, tmp_path: Path, status: str, success: bool
) -> None:
    simulation.status, simulation.success = status, success
    result = invoke("run", source, "--out", str(tmp_path / "out"))
    assert result.exit_code == 3
    assert {path.name for path in (tmp_path / "out").iterdir()} == FILES
    assert f"short: {status}, without success" in result.stdout


@pytest.mark.parametrize("name", sorted(FILES))
def test_run_refuses_a_folder_that_holds_a_result(
    simulation: Simulation, source: str, tmp_path: Path, name: str
) -> None:
    (tmp_path / name).write_text("precious")
    result = invoke("run", source, "--out", str(tmp_path))
    assert result.exit_code == 2
    assert f"holds {name}; use --force to replace" in result.stderr
    assert (tmp_path / name).read_text() == "precious"
    assert simulation.scenarios == []


@pytest.mark.slow
def test_run_with_force_replaces_the_whole_result(simulation: Simulation, source: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    for name in (*FILES, "notes.txt"):
        (out / name).write_text("old")
    result = invoke("run", source, "--out", str(out), "--force", "--set", "recording.enabled=false")
    assert result.exit_code == 0
    assert {path.name for path in out.iterdir()} == {"result.json", "series.npz", "notes.txt"}
    assert (out / "notes.txt").read_text() == "old"
    assert json.loads((out / "result.json").read_text())["status"] == "completed"


@pytest.mark.slow
def test_run_set_applies_left_to_right(simulation: Simulation, source: str, tmp_path: Path) -> None:
    changes = ["tissue.young_kpa=3", "tissue.young_kpa=4.5", "name=softer", 'tissue.fixed_faces=["z_max"]']
    arguments = [part for change in changes for part in ("--set", change)]
    result = invoke("run", source, "--out", str(tmp_path / "out"), *arguments)
    assert result.exit_code == 0, result.output
    (ran,) = simulation.scenarios
    assert (ran.tissue.young_kpa, ran.name, ran.tissue.fixed_faces) == (4.5, "softer", ("z_max",))


@pytest.mark.slow
def test_run_set_kind_replaces_the_block(simulation: Simulation, tmp_path: Path) -> None:
    changes = ["--set", "controller.kind=open_loop", "--set", "trajectory.kind=line"]
    result = invoke("run", "demo", "--out", str(tmp_path / "out"), *changes, "--set", "dt_s=0.1")
    assert result.exit_code == 0, result.output
    (ran,) = simulation.scenarios
    assert ran.controller.kind == "open_loop"
    assert ran.trajectory == type(ran.trajectory)()


def test_run_with_other_elements_takes_the_spacing_of_hard_points_along(simulation: Simulation, tmp_path: Path) -> None:
    change = ["--set", "interaction.line_compliance=false", "--set", "tissue.element_size_mm=10", "--set", "dt_s=0.1"]
    result = invoke("run", "line", "--out", str(tmp_path / "out"), *change)
    assert result.exit_code == 0, result.output
    (ran,) = simulation.scenarios
    assert (ran.tissue.element_size_mm, ran.interaction.spacing_mm) == (10.0, 10.0)


@pytest.mark.slow
def test_run_reads_standard_input(simulation: Simulation, tmp_path: Path) -> None:
    result = invoke("run", "-", "--out", str(tmp_path / "out"), input=json.dumps(short().resolved()))
    assert result.exit_code == 0
    assert simulation.scenarios == [short()]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ('{"dt_s": 7}', "dt_s = 7"),
        ('{"tissue": {"young": 7}}', "tissue.young = 7: unknown field"),
        ('{"schema": "needlebench/scenario/2"}', "schema = 'needlebench/scenario/2'"),
        ("[1]", "must hold a JSON object"),
        ("{", "is not readable JSON"),
        ("\x00", "is not readable JSON"),
    ],
)
def test_run_with_a_bad_scenario(simulation: Simulation, tmp_path: Path, text: str, told: str) -> None:
    path, out = tmp_path / "bad.json", tmp_path / "out"
    path.write_text(text)
    result = invoke("run", str(path), "--out", str(out))
    assert (result.exit_code, result.stdout) == (2, "")
    assert told in result.stderr
    assert result.stderr.startswith("needlebench: ")
    assert not out.exists()


def test_run_names_every_problem_on_a_line(simulation: Simulation, source: str, tmp_path: Path) -> None:
    bad = ["--set", "dt_s=7", "--set", "tissue.poisson=0.5", "--set", "needle.colour=red"]
    result = invoke("run", source, "--out", str(tmp_path / "out"), *bad)
    assert result.exit_code == 2
    lines = result.stderr.splitlines()
    assert sorted(line.split()[1] for line in lines) == ["dt_s", "needle.colour", "tissue.poisson"]


@pytest.mark.parametrize("change", ["tissue.young_kpa", "=3", "name.first=x"])
def test_run_with_a_change_that_is_none(simulation: Simulation, source: str, tmp_path: Path, change: str) -> None:
    result = invoke("run", source, "--out", str(tmp_path / "out"), "--set", change)
    assert result.exit_code == 2
    assert simulation.scenarios == []


def test_run_with_neither_file_nor_name(simulation: Simulation, tmp_path: Path) -> None:
    result = invoke("run", "nothing.json", "--out", str(tmp_path / "out"))
    assert result.exit_code == 2
    assert "'nothing.json': is neither a file nor a built-in scenario: demo, line" in result.stderr


def test_run_into_a_place_that_cannot_be(simulation: Simulation, source: str, tmp_path: Path) -> None:
    result = invoke("run", source, "--out", str(Path(source) / "below"))
    assert result.exit_code == 2
    assert "cannot be written" in result.stderr
    assert simulation.scenarios == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("error", "code", "told"),
    [
        (KeyboardInterrupt(), 130, "needlebench: interrupted"),
        (ValueError("the stiffness\nis gone"), 1, "needlebench: crashed: ValueError: the stiffness\n"),
    ],
)
@pytest.mark.parametrize("when", ["while it runs", "while it writes"])
def test_run_that_is_stopped_leaves_nothing(
    simulation: Simulation, source: str, tmp_path: Path, error: BaseException, code: int, told: str, when: str
) -> None:
    if when == "while it runs":
        simulation.stop_at, simulation.error = 60, error
    else:
        simulation.write_error = error
    out = tmp_path / "out"
    result = invoke("run", source, "--out", str(out))
    assert (result.exit_code, result.stdout) == (code, "")
    assert told in result.stderr
    assert "Traceback" not in result.stderr
    assert not out.exists()


@pytest.mark.slow
def test_run_that_is_stopped_leaves_the_old_result(simulation: Simulation, source: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert invoke("run", source, "--out", str(out)).exit_code == 0
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    simulation.write_error = ValueError("no")
    assert invoke("run", source, "--out", str(out), "--force").exit_code == 1
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


@pytest.mark.parametrize("how", [["--debug"], []])
def test_a_crash_shows_its_traceback_on_demand(
    simulation: Simulation, source: str, tmp_path: Path, how: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    simulation.stop_at, simulation.error = 3, ValueError("here")
    if not how:
        monkeypatch.setenv("NEEDLEBENCH_DEBUG", "1")
    result = invoke(*how, "run", source, "--out", str(tmp_path / "out"))
    assert result.exit_code == 1
    assert "Traceback" in result.stderr
    assert "ValueError: here" in result.stderr


@pytest.mark.slow
def test_run_warns_of_what_is_unusual(simulation: Simulation, source: str, tmp_path: Path) -> None:
    simulation.warnings = ["RCM authority: lost"]
    result = invoke("run", source, "--out", str(tmp_path / "out"), "--set", "interaction.friction=0.5")
    assert result.exit_code == 0
    before, after = result.stderr.splitlines()  # each once
    assert before.startswith("needlebench: warning: interaction.friction = 0.5")
    assert after == "needlebench: warning: RCM authority: lost"


@pytest.mark.slow
def test_run_of_the_real_thing(tmp_path: Path) -> None:
    poses = [[18.0, 31.0, -180.0 + 0.5 * i, 1.0, 0.0, 0.0, 0.0] for i in range(1, 13)]
    scenario = {
        "tissue": {"element_size_mm": 20.0},
        "trajectory": {"target_mm": [18, 31, 30], "speed_mm_s": 50.0},
        "controller": {"kind": "replay", "poses": poses},
        "recording": {"every_steps": 5},
    }
    digests = []
    for out, change in ((tmp_path / "a", []), (tmp_path / "b", ["--set", "recording.enabled=false"])):
        result = invoke("run", "-", "--out", str(out), *change, input=json.dumps(scenario))
        assert result.exit_code in (0, 3), result.output
        written = json.loads((out / "result.json").read_text())
        assert written["digest"] in result.stdout
        digests.append(written["digest"])
    assert digests[0] == digests[1]
    with np.load(tmp_path / "a" / "series.npz") as series:
        tips = recorded(tmp_path / "a" / "recording.rrd", "world/tip", "Points3D:positions")
        assert np.array_equal(np.concatenate(list(tips.values())), series["tip_m"].astype(np.float32))
        frames = recorded(tmp_path / "a" / "recording.rrd", "world/tissue/surface", "Mesh3D:vertex_positions")
        assert list(frames) == list(series["tissue_frame_step"]) == [0, 5, 10, 12]
