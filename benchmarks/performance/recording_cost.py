"""What a recording costs: the same run with and without, recorder opened and closed included."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass

from benchmarks.builtin_scenarios import measured
from benchmarks.measurements import Part, figure
from benchmarks.performance.step_clock import Unusable
from benchmarks.ports import Tools
from simcore.rollout.rollout import run
from simcore.scenario.scenario import Scenario

ROUNDS = 7


@dataclass(frozen=True)
class Cost:
    """Of one run, s: wall time of all of it, of its loop alone, and processor time."""

    whole_s: float
    loop_s: float
    thread_s: float  # of the thread that simulates
    processor_s: float  # of all threads and child processes


def recording(tools: Tools) -> Part:
    """Pairs of runs, alternating which comes first; the ratio is taken pair by pair.

    Whole means wall time from before the recorder is opened until its file is closed: what whoever waits for the run
    waits for. A recording of this length is not compacted. The same scenario runs without an observer, so its tissue
    frames are copied either way. The recorder is imported and warm, as in a worker; Rerun encodes on a thread of its
    own, which costs no wall time where a core is free. The processor ratio counts that thread, too, and the thread
    ratio the simulating thread alone: on a busy machine these two say more than the wall time.
    """
    scenario = measured("sine", quick=tools.quick)
    _cost(tools, scenario, True)  # the recorder is imported and warm now
    pairs = []
    for number in range(tools.rounds(ROUNDS)):
        tools.say(f"recording: pair {number + 1} of {tools.rounds(ROUNDS)}")
        order = (True, False) if number % 2 == 0 else (False, True)
        costs = {on: _cost(tools, scenario, on) for on in order}
        pairs.append((costs[True], costs[False]))
    return Part(
        (
            figure("recording.ratio", "x", [on.whole_s / off.whole_s for on, off in pairs]),
            figure("recording.loop_ratio", "x", [on.loop_s / off.loop_s for on, off in pairs], note="without the end"),
            figure("recording.thread_ratio", "x", [on.thread_s / off.thread_s for on, off in pairs]),
            figure("recording.processor_ratio", "x", [on.processor_s / off.processor_s for on, off in pairs]),
            figure("recording.on_s", "s", [on.whole_s for on, _ in pairs]),
            figure("recording.off_s", "s", [off.whole_s for _, off in pairs]),
        )
    )


def _cost(tools: Tools, scenario: Scenario, recorded: bool) -> Cost:
    started, worked, simulated = tools.clock(), _processor_s(), time.thread_time()
    if recorded:
        with tools.recorder(tools.folder / "bench.rrd") as observer:
            done = run(scenario, observer)
        warning = getattr(observer, "warning", None)
        if warning is not None:
            raise Unusable(f"the recording is incomplete: {warning}")
    else:
        done = run(scenario)
    thread_s, processor_s = time.thread_time() - simulated, _processor_s() - worked
    return Cost(tools.clock() - started, done.timing["loop_wall_s"], thread_s, processor_s)


def _processor_s() -> float:
    """Of this process and its children that have ended; Windows does not count the children."""
    children = os.times()
    return time.process_time() + children.children_user + children.children_system
