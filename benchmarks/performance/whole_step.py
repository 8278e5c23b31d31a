"""A whole step along `line` and `sine`, in ms and in L0, with each form of the Jacobian."""

from __future__ import annotations

import numpy as np

from benchmarks.builtin_scenarios import benchmark_scenario, is_supported
from benchmarks.measurements import Figure, Part, figure, missing_figure
from benchmarks.performance.step_clock import TimedRun, limit_of, timed_run
from benchmarks.ports import BenchPorts

ROUNDS = 5
SLOW = ("exact", "perturbation")  # measured in the first round only: some 50 ms a step
FAST = "controller.derivative=fast"
EXACT = "controller.derivative=exact"
PERTURBATION = "controller.jacobian=perturbation"


def step(ports: BenchPorts) -> Part:
    """Rounds of one run of each fast variant, so that a busy minute meets all of them; one run of each slow one."""
    variants = _variants()
    scenarios = {
        name: benchmark_scenario(preset, quick=ports.quick, changes=changes)
        for name, (preset, changes) in variants.items()
    }
    limit = limit_of(scenarios["line"])
    runs: dict[str, list[TimedRun]] = {name: [] for name in scenarios}
    for number in range(ports.rounds(ROUNDS)):
        for name, scenario in scenarios.items():
            if number > 0 and name in SLOW:
                continue
            ports.say(f"step: {name}, round {number + 1} of {ports.rounds(ROUNDS)}")
            runs[name].append(timed_run(scenario, limit, ports.clock))
    return Part((*_basic("line", runs["line"]), *_basic("sine", runs["sine"]), *_tail(runs["sine"]), *_forms(runs)))


def _variants() -> dict[str, tuple[str, tuple[str, ...]]]:
    fast: tuple[str, ...] = (FAST,) if is_supported(FAST) else ()
    variants: dict[str, tuple[str, tuple[str, ...]]] = {"line": ("line", fast), "sine": ("sine", fast)}
    if is_supported(EXACT):
        variants["exact"] = ("sine", (EXACT,))
    if is_supported(PERTURBATION):
        variants["perturbation"] = ("sine", (PERTURBATION,))
    return variants


def _medians(runs: list[TimedRun], part: str) -> list[float]:
    return [float(np.median(getattr(timed, part))) for timed in runs]


def _in_limits(runs: list[TimedRun], part: str) -> list[float]:
    return [median / timed.limit_s for median, timed in zip(_medians(runs, part), runs, strict=True)]


def _basic(name: str, runs: list[TimedRun]) -> list[Figure]:
    return [
        figure(f"step.{name}.plant_in_limits", "L0", _in_limits(runs, "plant_s")),
        figure(f"step.{name}.in_limits", "L0", _in_limits(runs, "whole_s")),
        figure(f"realtime.{name}", "x", [timed.realtime for timed in runs], better="higher"),
        figure(f"step.{name}.plant_ms", "ms", [1e3 * s for s in _medians(runs, "plant_s")]),
        figure(f"step.{name}.ms", "ms", [1e3 * s for s in _medians(runs, "whole_s")]),
        figure(f"step.{name}.jacobian_ms", "ms", [1e3 * s for s in _medians(runs, "jacobian_s")]),
        figure(f"step.{name}.limit_ms", "ms", [1e3 * timed.limit_s for timed in runs], note="L0 in the same run"),
    ]


def _tail(runs: list[TimedRun]) -> list[Figure]:
    p99 = [float(np.percentile(timed.whole_s, 99) / np.median(timed.whole_s)) for timed in runs]
    worst = [float(timed.whole_s.max() / np.median(timed.whole_s)) for timed in runs]
    return [
        figure("step.sine.p99_over_median", "x", p99),
        figure("step.sine.max_over_median", "x", worst),
    ]


def _forms(runs: dict[str, list[TimedRun]]) -> list[Figure]:
    """The other forms of the Jacobian; the key of the perturbation is the Jacobian alone."""
    figures = []
    if "exact" in runs:
        figures.append(figure("step.sine.exact_in_limits", "L0", _in_limits(runs["exact"], "whole_s")))
    else:
        figures.append(
            missing_figure("step.sine.exact_in_limits", "L0", "scenarios have no controller.derivative = exact")
        )
    if "perturbation" in runs:
        alone, whole = (_in_limits(runs["perturbation"], part) for part in ("jacobian_s", "whole_s"))
        figures.append(figure("jacobian.perturbation.in_limits", "L0", alone, note="the Jacobian alone"))
        figures.append(figure("step.sine.perturbation_in_limits", "L0", whole))
    else:
        why = "scenarios have no controller.jacobian = perturbation"
        figures.append(missing_figure("jacobian.perturbation.in_limits", "L0", why))
    return figures
