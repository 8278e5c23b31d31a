"""Two jobs at once on two cores against the same two one after the other, through warm worker processes."""

from __future__ import annotations

from benchmarks.builtin_scenarios import benchmark_scenario
from benchmarks.measurements import Part, figure
from benchmarks.ports import BenchPorts

ROUNDS = 5


def throughput(ports: BenchPorts) -> Part:
    """Two equal jobs: a worker does both, then each of two workers does one; recorded as every job is."""
    jobs = [benchmark_scenario("sine", quick=ports.quick)] * 2
    alone, at_once = [], []
    with ports.crew(2) as crew:
        crew.seconds([jobs[:1], jobs[1:]])  # files and both processes are warm now
        for number in range(ports.rounds(ROUNDS)):
            ports.say(f"throughput: round {number + 1} of {ports.rounds(ROUNDS)}")
            alone.append(crew.seconds([jobs, []] if number % 2 == 0 else [[], jobs]))
            at_once.append(crew.seconds([jobs[:1], jobs[1:]]))
    ratios = [one / two for one, two in zip(alone, at_once, strict=True)]
    return Part(
        (
            figure("throughput.two_over_one", "x", ratios, better="higher"),
            figure("throughput.one_after_other_s", "s", alone),
            figure("throughput.at_once_s", "s", at_once),
        )
    )
