"""Figures of a whole process: start-up with warm and cold kernel cache, peak memory, the recorder included."""

from __future__ import annotations

import shutil
import tempfile

from benchmarks.builtin_scenarios import changed, measured
from benchmarks.measurements import Figure, Part, absent, figure
from benchmarks.performance.probe import Probed, probe
from benchmarks.performance.step_clock import Unusable
from benchmarks.ports import Tools
from simcore.errors import Status
from simcore.scenario.scenario import Scenario

WARM_ROUNDS, COLD_ROUNDS, MEMORY_ROUNDS = 7, 2, 2
MESHES = {1617: 6.0, 5270: 4.0}  # nodes -> edge, mm


def start(tools: Tools) -> Part:
    """Process start to the end of the first step of `line`, with an open recorder.

    Cold is a kernel cache in an empty folder; bytecode and the system's file cache are left warm.
    """
    scenario = measured("line", quick=tools.quick)
    _first_step(tools, scenario, None)  # fills the cache
    warm = []
    for number in range(tools.rounds(WARM_ROUNDS)):
        tools.say(f"start: warm cache, {number + 1} of {tools.rounds(WARM_ROUNDS)}")
        warm.append(_first_step(tools, scenario, None))
    return Part((figure("start.warm_s", "s", warm), _cold(tools, scenario)))


def _cold(tools: Tools, scenario: Scenario) -> Figure:
    if tools.quick:
        return absent("start.cold_s", "s", "left out by --quick: it compiles every kernel")
    cold = []
    for number in range(COLD_ROUNDS):
        tools.say(f"start: empty cache, {number + 1} of {COLD_ROUNDS}")
        folder = tempfile.mkdtemp(dir=tools.folder, prefix="kernels-")
        try:
            cold.append(_first_step(tools, scenario, folder))
        finally:
            shutil.rmtree(folder, ignore_errors=True)
    return figure("start.cold_s", "s", cold)


def _first_step(tools: Tools, scenario: Scenario, cache: str | None) -> float:
    environment = {} if cache is None else {"NUMBA_CACHE_DIR": cache}
    return _probed(tools, scenario, first_step_only=True, environment=environment).first_step_s


def memory(tools: Tools) -> Part:
    """Peak of a process that runs and records a whole `line` insertion."""
    figures = []
    for nodes, edge in MESHES.items():
        key = f"memory.{nodes}_mb"
        scenario = changed(measured("line", quick=tools.quick), tissue={"element_size_mm": edge})
        peaks = []
        for number in range(tools.rounds(MEMORY_ROUNDS)):
            tools.say(f"memory: {nodes} nodes, {number + 1} of {tools.rounds(MEMORY_ROUNDS)}")
            done = _probed(tools, scenario)
            if done.status != Status.COMPLETED:
                raise Unusable(f"the insertion at {nodes} nodes ended as {done.status}")
            peaks.append(done.peak_mb)
        known = [peak for peak in peaks if peak is not None]
        figures.append(figure(key, "MB", known) if known else absent(key, "MB", "not counted on this platform"))
    return Part(tuple(figures))


def _probed(
    tools: Tools, scenario: Scenario, *, first_step_only: bool = False, environment: dict[str, str] | None = None
) -> Probed:
    return probe(
        scenario.resolved(),
        recorder=tools.recorder_name,
        recording=tools.folder / "probe.rrd",
        first_step_only=first_step_only,
        environment=environment,
        clock=tools.clock,
    )
