"""How the step grows: with nodes (next to L0), with depth, with beams, with the time step."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from benchmarks.builtin_scenarios import benchmark_scenario, with_blocks
from benchmarks.measurements import EXPONENT_MARGIN, Figure, Part, Table, Target, figure
from benchmarks.performance.step_clock import TimedRun, limit_of, timed_run
from benchmarks.svg_plot import Line, Panel, svg

if TYPE_CHECKING:
    from collections.abc import Callable

    from benchmarks.ports import BenchPorts
    from simcore.scenario.scenario import Scenario

ROUNDS = 3
EDGES_MM, QUICK_EDGES_MM = (8.0, 6.0, 5.0, 4.0), (15.0, 10.0)
BEAMS, DTS_S = (10, 20, 40, 80), (0.01, 0.005, 0.002, 0.0012)
DEPTHS, QUICK_DEPTHS = (0.02, 0.12), (0.004, 0.011)  # m
WINDOW_M = 2.5e-3

# SOFA 26.06, ms for one linearised step on one core like the one this was first measured on; nodes -> ms
SOFA_DIRECT = {1080: 46.0, 2112: 182.0, 4200: 674.0, 7980: 2687.0}
SOFA_STALE = {1080: 23.0, 2112: 59.0, 4200: 201.0, 7980: 997.0}


def scaling(ports: BenchPorts) -> Part:
    """Straight insertions with the default controller; the variants of one sweep take turns."""
    base = benchmark_scenario("line", quick=ports.quick)
    nodes, runs = _mesh_sweep(ports, base)
    figures = [*_node_figures(nodes, runs), _depth(ports, runs)]
    figures += _sweep(ports, "beams", {str(n): with_blocks(base, needle={"elements": n}) for n in BEAMS})
    figures += _sweep(ports, "dt", {f"{1e3 * dt:g}ms": with_blocks(base, dt_s=dt) for dt in DTS_S})
    return Part(tuple(figures), (_table(nodes, runs),), {"scaling.svg": _plot(nodes, runs)})


def _mesh_sweep(ports: BenchPorts, base: Scenario) -> tuple[list[int], list[list[TimedRun]]]:
    """Node counts, and of each mesh its runs."""
    edges = QUICK_EDGES_MM if ports.quick else EDGES_MM
    scenarios = [with_blocks(base, tissue={"element_size_mm": edge}) for edge in edges]
    limits = [limit_of(scenario) for scenario in scenarios]
    runs: list[list[TimedRun]] = [[] for _ in scenarios]
    for number in range(ports.rounds(ROUNDS)):
        for i, scenario in enumerate(scenarios):
            ports.say(f"scaling: h = {edges[i]:g} mm, round {number + 1} of {ports.rounds(ROUNDS)}")
            runs[i].append(timed_run(scenario, limits[i], ports.clock))
    return [len(limit.mesh.nodes_m) for limit in limits], runs


def _node_figures(nodes: list[int], runs: list[list[TimedRun]]) -> list[Figure]:
    def exponents(part: Callable[[TimedRun], float]) -> list[float]:
        return [fitted_exponent(nodes, [part(timed) for timed in round_]) for round_ in zip(*runs, strict=True)]

    limit = figure("scaling.limit.exponent", "", exponents(_limit))
    assert limit.median is not None
    bound = Target(limit.median + EXPONENT_MARGIN)
    figures = [figure("scaling.nodes.exponent", "", exponents(_whole), target=bound), limit]
    figures.append(figure("scaling.plant.exponent", "", exponents(_plant)))
    for count, repeated in zip(nodes, runs, strict=True):
        for name, part in (("step", _whole), ("plant", _plant), ("limit", _limit)):
            figures.append(figure(f"scaling.nodes.{count}.{name}_ms", "ms", [1e3 * part(t) for t in repeated]))
    return figures


def _whole(timed: TimedRun) -> float:
    return float(np.median(timed.whole_s))


def _plant(timed: TimedRun) -> float:
    return float(np.median(timed.plant_s))


def _limit(timed: TimedRun) -> float:
    return timed.limit_s


def fitted_exponent(nodes: list[int], seconds: list[float]) -> float:
    """The p of the least-squares fit seconds ~ nodes^p."""
    return float(np.polyfit(np.log(nodes), np.log(seconds), 1)[0])


def _depth(ports: BenchPorts, runs: list[list[TimedRun]]) -> Figure:
    """In the default mesh, the second of the sweep either way."""
    shallow, deep = QUICK_DEPTHS if ports.quick else DEPTHS
    ratios = [timed.near(deep, WINDOW_M) / timed.near(shallow, WINDOW_M) for timed in runs[1]]
    return figure("scaling.depth.ratio", "x", ratios, note=f"{1e3 * deep:g} over {1e3 * shallow:g} mm")


def _sweep(ports: BenchPorts, name: str, scenarios: dict[str, Scenario]) -> list[Figure]:
    limit = limit_of(next(iter(scenarios.values())))
    runs: dict[str, list[TimedRun]] = {label: [] for label in scenarios}
    for number in range(ports.rounds(ROUNDS)):
        for label, scenario in scenarios.items():
            ports.say(f"scaling: {name} {label}, round {number + 1} of {ports.rounds(ROUNDS)}")
            runs[label].append(timed_run(scenario, limit, ports.clock))
    return [
        figure(f"scaling.{name}.{label}.step_ms", "ms", [1e3 * _whole(timed) for timed in repeated])
        for label, repeated in runs.items()
    ]


def _middle(runs: list[list[TimedRun]], part: Callable[[TimedRun], float]) -> list[float]:
    return [1e3 * float(np.median([part(timed) for timed in repeated])) for repeated in runs]


def _table(nodes: list[int], runs: list[list[TimedRun]]) -> Table:
    columns = zip(nodes, *(_middle(runs, part) for part in (_plant, _whole, _limit)), strict=True)
    rows = tuple((count, plant, whole, limit, whole / limit) for count, plant, whole, limit in columns)
    return Table("Median step over nodes", ("nodes", "plant ms", "whole step ms", "L0 ms", "whole in L0"), rows)


def _plot(nodes: list[int], runs: list[list[TimedRun]]) -> str:
    """The README's picture: plant, whole step and L0 next to one linearised step of SOFA."""
    x = [float(n) for n in nodes]
    lines = [
        Line("SOFA, refactored every step", [*map(float, SOFA_DIRECT)], [*SOFA_DIRECT.values()], dashed=True),
        Line("SOFA, stale factor, two threads", [*map(float, SOFA_STALE)], [*SOFA_STALE.values()], dashed=True),
        Line("whole I-FEM step", x, _middle(runs, _whole)),
        Line("converged plant step", x, _middle(runs, _plant)),
        Line("L0", x, _middle(runs, _limit)),
    ]
    panel = Panel("Median time of a step", "nodes", "ms", tuple(lines), x_log=True, y_log=True)
    return svg([[panel]], width=640, height=460)
