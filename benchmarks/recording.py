"""What a recording costs: the same run with and without, recorder opened and closed included."""

from __future__ import annotations

import time
from dataclasses import dataclass

from benchmarks.figures import Part, figure
from benchmarks.scenarios import measured
from benchmarks.stepclock import Unusable
from benchmarks.tools import Tools
from simcore.rollout import run
from simcore.scenario import Scenario

ROUNDS = 7


@dataclass(frozen=True)
class Cost:
    """Of one run, s: wall time of all of it, of its loop alone, and processor time of all threads."""

    whole_s: float
    loop_s: float
    processor_s: float


def recording(tools: Tools) -> Part:
    """Pairs of runs, alternating which comes first; the ratio is taken pair by pair.

    Whole means from before the recorder is opened until its file is closed and compacted.
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
            figure("recording.processor_ratio", "x", [on.processor_s / off.processor_s for on, off in pairs]),
            figure("recording.on_s", "s", [on.whole_s for on, _ in pairs]),
            figure("recording.off_s", "s", [off.whole_s for _, off in pairs]),
        )
    )


def _cost(tools: Tools, scenario: Scenario, recorded: bool) -> Cost:
    started, worked = tools.clock(), time.process_time()
    if recorded:
        with tools.recorder(tools.folder / "bench.rrd") as observer:
            done = run(scenario, observer)
        warning = getattr(observer, "warning", None)
        if warning is not None:
            raise Unusable(f"the recording is incomplete: {warning}")
    else:
        done = run(scenario)
    whole, processor = tools.clock() - started, time.process_time() - worked
    return Cost(whole, done.timing["loop_wall_s"], processor)
