"""Figures of a whole process: start-up with warm and cold kernel cache, peak memory, the recorder included."""

from __future__ import annotations

import shutil
import tempfile
from typing import TYPE_CHECKING

from benchmarks.builtin_scenarios import benchmark_scenario, with_blocks
from benchmarks.measurements import Figure, Part, figure, missing_figure
from benchmarks.performance.probe import ProbeResult, probe
from benchmarks.performance.step_clock import MeasurementError
from simcore.errors import Status

if TYPE_CHECKING:
    from benchmarks.ports import BenchPorts
    from simcore.scenario.scenario import Scenario

WARM_ROUNDS, COLD_ROUNDS, MEMORY_ROUNDS = 7, 2, 2
MESHES = {1617: 6.0, 4743: 4.0}  # nodes -> edge, mm


def start(ports: BenchPorts) -> Part:
    """Process start to the end of the first step of `line`, with an open recorder.

    Cold is a kernel cache in an empty folder; bytecode and the system's file cache are left warm.
    """
    scenario = benchmark_scenario("line", quick=ports.quick)
    _first_step(ports, scenario, None)  # fills the cache
    warm = []
    for number in range(ports.rounds(WARM_ROUNDS)):
        ports.say(f"start: warm cache, {number + 1} of {ports.rounds(WARM_ROUNDS)}")
        warm.append(_first_step(ports, scenario, None))
    return Part((figure("start.warm_s", "s", warm), _cold(ports, scenario)))


def _cold(ports: BenchPorts, scenario: Scenario) -> Figure:
    if ports.quick:
        return missing_figure("start.cold_s", "s", "left out by --quick: it compiles every kernel")
    cold = []
    for number in range(COLD_ROUNDS):
        ports.say(f"start: empty cache, {number + 1} of {COLD_ROUNDS}")
        folder = tempfile.mkdtemp(dir=ports.folder, prefix="kernels-")
        try:
            cold.append(_first_step(ports, scenario, folder))
        finally:
            shutil.rmtree(folder, ignore_errors=True)
    return figure("start.cold_s", "s", cold)


def _first_step(ports: BenchPorts, scenario: Scenario, cache: str | None) -> float:
    environment = {} if cache is None else {"NUMBA_CACHE_DIR": cache}
    return _probe_run(ports, scenario, first_step_only=True, environment=environment).first_step_s


def memory(ports: BenchPorts) -> Part:
    """Peak of a process that runs and records a whole `line` insertion."""
    figures = []
    for nodes, edge in MESHES.items():
        key = f"memory.{nodes}_mb"
        scenario = with_blocks(benchmark_scenario("line", quick=ports.quick), tissue={"element_size_mm": edge})
        peaks = []
        for number in range(ports.rounds(MEMORY_ROUNDS)):
            ports.say(f"memory: {nodes} nodes, {number + 1} of {ports.rounds(MEMORY_ROUNDS)}")
            done = _probe_run(ports, scenario)
            if done.status != Status.COMPLETED:
                raise MeasurementError(f"the insertion at {nodes} nodes ended as {done.status}")
            peaks.append(done.peak_mb)
        known = [peak for peak in peaks if peak is not None]
        figures.append(figure(key, "MB", known) if known else missing_figure(key, "MB", "not counted on this platform"))
    return Part(tuple(figures))


def _probe_run(
    ports: BenchPorts, scenario: Scenario, *, first_step_only: bool = False, environment: dict[str, str] | None = None
) -> ProbeResult:
    return probe(
        scenario.resolved(),
        recorder=ports.recorder_name,
        recording=ports.folder / "probe.rrd",
        first_step_only=first_step_only,
        environment=environment,
        clock=ports.clock,
    )
