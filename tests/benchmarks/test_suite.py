"""The benchmarks by name, each as a quick run with stand-ins for processes and recorder; and the command."""

from __future__ import annotations

import contextlib
import json
import sys
import time
from typing import TYPE_CHECKING

import numpy as np
import pytest
from click.testing import CliRunner

from benchmarks.bench_report import SCHEMA
from benchmarks.observed_run import ObservedRun, observe
from benchmarks.performance.environments import environments
from benchmarks.performance.kernels import micro
from benchmarks.performance.probe import ProbeError, probe
from benchmarks.performance.recording_cost import recording
from benchmarks.performance.scaling import MeshSweep, fitted_exponent, scaling, sofa_figures, sofa_ms
from benchmarks.performance.start_and_memory import start
from benchmarks.performance.step_clock import TimedRun
from benchmarks.performance.step_profile import METHODS, PYTHON, Stages, patch_kernels, profile
from benchmarks.performance.throughput import throughput
from benchmarks.performance.whole_step import step
from benchmarks.ports import BenchPorts
from benchmarks.registry import BENCHMARKS, select
from service.cli.main import main
from simcore.contact import kernels
from simcore.errors import ScenarioError
from simcore.rollout.records import Silent

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from benchmarks.measurements import Part
    from simcore.scenario.scenario import Scenario

pytestmark = pytest.mark.slow

NAMES = (
    "micro",
    "step",
    "scaling",
    "throughput",
    "recording",
    "start-up",
    "memory",
    "envs",
    "profile",
    "convergence",
    "work-precision",
    "sweeps",
    "cluster",
    "forces",
)
RECORDER = "tests.benchmarks.test_suite:silent"


@contextlib.contextmanager
def silent(_path: Path) -> Iterator[Silent]:
    """A recorder that records nothing."""
    yield Silent()


class Alone:
    """A crew of this one process."""

    def seconds(self, batches: Sequence[Sequence[Scenario]]) -> float:
        started = time.perf_counter()
        for batch in batches:
            for scenario in batch:
                observe(scenario)
        return time.perf_counter() - started

    def run_many(self, scenarios: Sequence[Scenario]) -> list[ObservedRun]:
        return [observe(scenario) for scenario in scenarios]


@contextlib.contextmanager
def crew(_workers: int) -> Iterator[Alone]:
    yield Alone()


@pytest.fixture
def ports(tmp_path: Path) -> BenchPorts:
    return BenchPorts(
        say=lambda _: None,
        recorder=silent,
        recorder_name=RECORDER,
        crew=crew,
        folder=tmp_path,
        quick=True,
    )


def keys(part: Part) -> set[str]:
    return {figure.key for figure in part.figures}


# ---- names


def test_the_names() -> None:
    assert tuple(BENCHMARKS) == NAMES
    assert select([]) == list(NAMES[:-5])
    assert select(["step", "micro", "step"]) == ["step", "micro"]
    with pytest.raises(ScenarioError, match=r"steps.*micro, step"):
        select(["steps"])


# ---- each benchmark


def test_micro(ports: BenchPorts) -> None:
    part = micro(ports)
    names = ("force", "back_solve", "columns", "w", "beams", "refactor", "limit", "limit_back_solve", "limit_force")
    assert keys(part) == {f"micro.{name}_ms" for name in names}
    assert all(figure.median is not None and figure.median > 0.0 for figure in part.figures)


def test_step_has_every_key_of_the_specification(ports: BenchPorts) -> None:
    part = step(ports)
    assert keys(part) >= {
        "step.line.plant_in_limits",
        "step.sine.plant_in_limits",
        "step.line.in_limits",
        "step.sine.in_limits",
        "step.sine.exact_in_limits",
        "jacobian.perturbation.in_limits",
        "realtime.line",
        "realtime.sine",
        "step.sine.p99_over_median",
        "step.sine.max_over_median",
    }
    assert all(figure.median is not None or figure.note for figure in part.figures)


def test_scaling(ports: BenchPorts) -> None:
    part = scaling(ports)
    assert keys(part) >= {"scaling.nodes.exponent", "scaling.limit.exponent", "scaling.depth.ratio"}
    exponents = {figure.key: figure for figure in part.figures}
    target, limit = exponents["scaling.nodes.exponent"].target, exponents["scaling.limit.exponent"].median
    assert target is not None
    assert limit is not None
    assert target.bound == pytest.approx(limit + 0.1)
    assert set(part.files) == {"scaling.svg"}
    over_nodes, over_depth = part.tables
    assert keys(part) >= {f"scaling.hard.{row[0]}.plant_ms" for row in over_nodes.rows}
    assert all(row[0] < 1080 and row[-2:] == (None, None) for row in over_nodes.rows)  # coarser than what SOFA ran on
    assert [row[0] for row in over_depth.rows] == [4.0, 11.0]


def test_the_step_of_sofa_lies_on_the_power_laws_between_its_sizes() -> None:
    assert sofa_ms(1080) == pytest.approx(46.0)
    assert sofa_ms(7980) == pytest.approx(2687.0)
    middle = sofa_ms(round((1080 * 2112) ** 0.5))
    assert middle is not None
    assert middle == pytest.approx((46.0 * 182.0) ** 0.5, rel=1e-3)
    assert sofa_ms(765) is None
    assert sofa_ms(9000) is None


def test_the_ratio_to_sofa_is_of_the_plant_step_and_of_meshes_within_its_sizes() -> None:
    some = np.full(4, 0.001)
    runs = [[TimedRun(9.0 * some, 2.0 * some, some, some, limit_s=0.001, dt_s=0.01)] for _ in range(3)]
    found = sofa_figures(MeshSweep([765, 1080, 9000], runs))
    assert [(one.key, one.values, one.better) for one in found] == [("scaling.sofa.1080.ratio", (23.0,), "higher")]


def test_the_exponent_of_a_power_law() -> None:
    nodes = [765, 1617, 2925, 4743]
    assert fitted_exponent(nodes, [3e-6 * n**1.4 for n in nodes]) == pytest.approx(1.4)


def test_throughput_and_recording(ports: BenchPorts) -> None:
    assert "throughput.two_over_one" in keys(throughput(ports))
    assert "recording.ratio" in keys(recording(ports))


def test_an_episode_an_environment_and_two_at_once_take_the_same_steps(ports: BenchPorts) -> None:
    found = {figure.key: figure.median for figure in environments(ports).figures}
    rates = ("envs.episode_steps_s", "envs.one_steps_s", "envs.two_steps_s")
    assert set(found) == {*rates, "envs.one_over_episode", "envs.two_over_one"}
    episode, one, two = (found[name] for name in rates)
    assert episode
    assert one
    assert two
    assert found["envs.one_over_episode"] == pytest.approx(one / episode)
    assert found["envs.two_over_one"] == pytest.approx(two / one)


def test_without_gymnasium_the_episode_is_measured_alone(ports: BenchPorts, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    figures = {figure.key: figure for figure in environments(ports).figures}
    assert figures["envs.episode_steps_s"].median
    assert figures["envs.two_steps_s"].median is None
    assert 'pip install "needlebench[gym]"' in figures["envs.two_steps_s"].note


def test_start_up_in_a_process_of_its_own(ports: BenchPorts) -> None:
    warm, cold = start(ports).figures
    assert (warm.key, cold.key) == ("start.warm_s", "start.cold_s")
    assert warm.median is not None
    assert cold.median is None
    assert "--quick" in cold.note


def test_a_probe_runs_to_the_end_and_counts_memory(ports: BenchPorts) -> None:
    small = {"tissue": {"element_size_mm": 20}, "trajectory": {"target_mm": [18, 31, 1]}}
    done = probe(small, recorder=RECORDER, recording=ports.folder / "none")
    assert done.status == "completed"
    assert done.peak_mb is None or 20.0 < done.peak_mb < 5000.0


def test_a_probe_that_fails_says_so(ports: BenchPorts, capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ProbeError, match="exit code 1"):
        probe({"tissue": {"element_size_mm": -1}}, recorder=RECORDER, recording=ports.folder / "none")
    assert "element_size_mm" in capfd.readouterr().err


# ---- the profile


def test_the_profile_adds_up_and_leaves_no_trace(ports: BenchPorts) -> None:
    before = kernels.to_local
    part = profile(ports)
    assert kernels.to_local is before
    for table in part.tables:
        assert sum(row[3] for row in table.rows) == pytest.approx(100.0)
        stages = {row[0] for row in table.rows}
        assert {PYTHON, "tissue forces", "back-solve", "Jacobian", "contact laws"} <= stages


def test_what_the_profile_wraps_exists() -> None:
    missing = [f"{owner.__name__}.{name}" for owner, name, _, _ in METHODS if not hasattr(owner, name)]
    assert missing == []


def test_a_stage_is_not_charged_for_what_it_calls() -> None:
    now = [0.0]

    def spend(seconds: float) -> None:
        now[0] += seconds

    stages = Stages(lambda: now[0])
    inner = stages.wrap("inner", spend, False)

    def both(own: float, other: float) -> None:
        spend(own)
        inner(other)

    stages.wrap("outer", both, False)(1.0, 2.0)
    stages.wrap("whole", both, True)(4.0, 8.0)
    assert stages.seconds == {"outer": 1.0, "inner": 2.0, "whole": 12.0}
    assert stages.calls == {"outer": 1, "inner": 1, "whole": 1}


def test_patching_is_undone_after_an_error() -> None:
    before = {(owner, name): getattr(owner, name) for owner, name, _, _ in METHODS}
    with pytest.raises(RuntimeError, match="on purpose"), patch_kernels(Stages(time.perf_counter)):
        raise RuntimeError("on purpose")
    assert before == {(owner, name): getattr(owner, name) for owner, name, _, _ in METHODS}


# ---- the command


def test_the_command_lists() -> None:
    done = CliRunner().invoke(main, ["bench", "--list"])
    assert done.exit_code == 0
    assert [line.split()[0] for line in done.stdout.splitlines()] == list(NAMES)


def test_the_command_measures_stores_and_compares(tmp_path: Path) -> None:
    report = tmp_path / "new" / "report.json"
    done = CliRunner().invoke(
        main, ["bench", "micro", "--quick", "--json", str(report), "--out", str(tmp_path / "out")]
    )
    assert done.exit_code == 0, done.output
    assert "micro.force_ms" in done.stdout
    stored = json.loads(report.read_bytes())
    assert stored["schema"] == SCHEMA
    assert stored["names"] == ["micro"]
    assert stored["quick"] is True
    same = CliRunner().invoke(main, ["bench", "--compare", str(report), str(report)])
    assert (same.exit_code, same.stdout.splitlines()[-1]) == (0, "nothing got worse")
    stored["figures"]["micro.force_ms"]["median"] *= 100.0
    worse = tmp_path / "worse.json"
    worse.write_text(json.dumps(stored))
    slower = CliRunner().invoke(main, ["bench", "--compare", str(report), str(worse)])
    assert slower.exit_code == 1
    assert "1 of 9 figures got worse" in slower.stdout


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (["nothing"], "nothing"),
        (["micro", "--out", "FILE/below"], "--out"),
        (["micro", "--json", "FILE/below/report.json"], "--json"),
        (["--compare", "FILE", "FILE"], "not readable JSON"),
    ],
)
def test_bad_input_ends_before_any_measurement(arguments: list[str], why: str, tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("text")
    placed = [argument.replace("FILE", str(file)) for argument in arguments]
    if "--out" not in placed:
        placed += ["--out", str(tmp_path)]
    done = CliRunner().invoke(main, ["bench", "--quick", *placed])
    assert done.exit_code == 2
    assert why in done.stderr


@pytest.mark.slow
def test_the_studies_and_the_processes_through_the_command(tmp_path: Path) -> None:
    """Real workers, real recorder, pictures and tables; quick, so half a minute."""
    names = ["throughput", "recording", "memory", "convergence", "forces"]
    done = CliRunner().invoke(main, ["bench", *names, "--quick", "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    pictures = ("convergence.svg", "closed_loop.svg", "forces.svg")
    for name in ("convergence.md", "convergence.json", "forces.md", "forces.csv", *pictures):
        assert (tmp_path / name).stat().st_size > 100
    loops = json.loads((tmp_path / "convergence.json").read_text())["closed_loop"]
    assert set(loops["suites"]) == {"LIN", "CUR"}
    assert all(0.0 < loops["suites"][suite]["ifem"] < 1.0 for suite in loops["suites"])
    assert len(json.loads((tmp_path / "closed_loop_runs.json").read_text())["runs"]) == 36
    assert "memory.1617_mb" in done.stdout
