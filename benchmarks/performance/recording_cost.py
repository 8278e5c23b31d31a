"""What a recording costs: the same run with and without, recorder opened and closed included."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from benchmarks.builtin_scenarios import benchmark_scenario
from benchmarks.measurements import Part, figure
from benchmarks.performance.step_clock import MeasurementError
from simcore.rollout.rollout import run

if TYPE_CHECKING:
    from benchmarks.ports import BenchPorts
    from simcore.scenario.scenario import Scenario

ROUNDS = 7


@dataclass(frozen=True)
class RunTimes:
    """Of one run, s: wall time of all of it, of its loop alone, and processor time."""

    whole_s: float
    loop_s: float
    thread_s: float  # of the thread that simulates
    processor_s: float  # of all threads and child processes
    realtime: float  # simulated over wall time of the loop


def recording(ports: BenchPorts) -> Part:
    """Pairs of runs, alternating which comes first; the ratio is taken pair by pair.

    Whole means wall time from before the recorder is opened until its file is closed: what the user waits for. A
    recording of this length is not compacted. The same scenario runs without an observer, so its tissue frames are
    copied either way. The recorder is imported and warm, as in a worker; Rerun encodes on a thread of its own, which
    costs no wall time where a core is free. The processor ratio counts that thread, too, and the thread ratio the
    simulating thread alone: on a busy machine these two say more than the wall time.
    """
    scenario = benchmark_scenario("sine", quick=ports.quick)
    _run_times(ports, scenario, True)  # the recorder is imported and warm now
    pairs = []
    for number in range(ports.rounds(ROUNDS)):
        ports.say(f"recording: pair {number + 1} of {ports.rounds(ROUNDS)}")
        order = (True, False) if number % 2 == 0 else (False, True)
        costs = {on: _run_times(ports, scenario, on) for on in order}
        pairs.append((costs[True], costs[False]))
    return Part(
        (
            figure("recording.ratio", "x", [on.whole_s / off.whole_s for on, off in pairs]),
            figure("recording.loop_ratio", "x", [on.loop_s / off.loop_s for on, off in pairs], note="without the end"),
            figure("recording.thread_ratio", "x", [on.thread_s / off.thread_s for on, off in pairs]),
            figure("recording.processor_ratio", "x", [on.processor_s / off.processor_s for on, off in pairs]),
            figure("recording.on_s", "s", [on.whole_s for on, _ in pairs]),
            figure("recording.off_s", "s", [off.whole_s for _, off in pairs]),
            figure("recording.realtime", "x", [on.realtime for on, _ in pairs], better="higher"),
        )
    )


def _run_times(ports: BenchPorts, scenario: Scenario, recorded: bool) -> RunTimes:
    started, worked, simulated = ports.clock(), _processor_s(), time.thread_time()
    if recorded:
        with ports.recorder(ports.folder / "bench.rrd") as observer:
            done = run(scenario, observer)
        warning = getattr(observer, "warning", None)
        if warning is not None:
            raise MeasurementError(f"the recording is incomplete: {warning}")
    else:
        done = run(scenario)
    thread_s, processor_s = time.thread_time() - simulated, _processor_s() - worked
    loop = done.timing
    return RunTimes(ports.clock() - started, loop["loop_wall_s"], thread_s, processor_s, loop["realtime_factor"])


def _processor_s() -> float:
    """Of this process and its children that have ended; Windows does not count the children."""
    children = os.times()
    return time.process_time() + children.children_user + children.children_system
