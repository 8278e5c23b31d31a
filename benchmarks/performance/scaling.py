"""How the step grows: with nodes (next to L0, to hard points and to SOFA), points, depth, beams, the time step."""

from __future__ import annotations

from dataclasses import dataclass
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
EDGES_MM, QUICK_EDGES_MM = (8.0, 6.0, 5.0, 4.0, 3.4), (15.0, 10.0)
DEFAULT = 1  # place of the default mesh among them
SPACINGS_MM = (1.5, 2.0, 3.0, 4.0, 6.0)
BEAMS, DTS_S = (10, 20, 40, 80), (0.01, 0.005, 0.002, 0.0012)
DEPTHS, QUICK_DEPTHS = (0.02, 0.04, 0.06, 0.08, 0.1, 0.12), (0.004, 0.011)  # m
WINDOW_M = 2.5e-3

# SOFA 26.06, not tuned: ms for one linearised step with 60 rows and a beam, on one core like the one this was first
# measured on; nodes -> ms
SOFA_DIRECT = {1080: 46.0, 2112: 182.0, 4200: 674.0, 7980: 2687.0}
SOFA_STALE = {1080: 23.0, 2112: 59.0, 4200: 201.0, 7980: 997.0}


@dataclass(frozen=True)
class MeshSweep:
    """Runs of one plant over meshes. nodes: of each mesh; runs: of each mesh, one for each round."""

    nodes: list[int]
    runs: list[list[TimedRun]]

    def median_ms(self, part: Callable[[TimedRun], float]) -> list[float]:
        """Of each mesh, the middle of its rounds."""
        return [1e3 * float(np.median([part(timed) for timed in repeated])) for repeated in self.runs]

    def exponents(self, part: Callable[[TimedRun], float]) -> list[float]:
        """Of each round, the p of seconds ~ nodes^p."""
        return [fitted_exponent(self.nodes, [part(run) for run in round_]) for round_ in zip(*self.runs, strict=True)]


def scaling(ports: BenchPorts) -> Part:
    """Straight insertions with the default controller; the variants of one sweep take turns."""
    base = benchmark_scenario("line", quick=ports.quick)
    plant, hard = _mesh_sweeps(ports, base)
    figures = [*_node_figures(plant), *_hard_figures(hard), *sofa_figures(plant), _depth_ratio(ports, plant)]
    figures += _sweep(ports, "spacing", {f"{s:g}mm": _spaced(base, s) for s in SPACINGS_MM})
    figures += _sweep(ports, "beams", {str(n): with_blocks(base, needle={"elements": n}) for n in BEAMS})
    figures += _sweep(ports, "dt", {f"{1e3 * dt:g}ms": with_blocks(base, dt_s=dt) for dt in DTS_S})
    tables = (_table(plant, hard), _depth_table(ports, plant))
    return Part(tuple(figures), tables, {"scaling.svg": _plot(plant, hard)})


def _mesh_sweeps(ports: BenchPorts, base: Scenario) -> tuple[MeshSweep, MeshSweep]:
    """Of the plant, and of the one with hard constraint points, whose runs take turns."""
    edges = QUICK_EDGES_MM if ports.quick else EDGES_MM
    plants = [base, with_blocks(base, interaction={"line_compliance": False, "spacing_mm": None})]
    scenarios = [[with_blocks(plant, tissue={"element_size_mm": edge}) for edge in edges] for plant in plants]
    limits = [limit_of(scenario) for scenario in scenarios[0]]
    runs: list[list[list[TimedRun]]] = [[[] for _ in edges] for _ in plants]
    for number in range(ports.rounds(ROUNDS)):
        for i, edge in enumerate(edges):
            ports.say(f"scaling: h = {edge:g} mm, round {number + 1} of {ports.rounds(ROUNDS)}")
            for variants, timed in zip(scenarios, runs, strict=True):
                timed[i].append(timed_run(variants[i], limits[i], ports.clock))
    nodes = [len(limit.mesh.nodes_m) for limit in limits]
    return MeshSweep(nodes, runs[0]), MeshSweep(nodes, runs[1])


def _node_figures(plant: MeshSweep) -> list[Figure]:
    limit = figure("scaling.limit.exponent", "", plant.exponents(_limit))
    assert limit.median is not None
    bound = Target(limit.median + EXPONENT_MARGIN)
    figures = [figure("scaling.nodes.exponent", "", plant.exponents(_whole), target=bound), limit]
    figures.append(figure("scaling.plant.exponent", "", plant.exponents(_plant)))
    for count, repeated in zip(plant.nodes, plant.runs, strict=True):
        for name, part in (("step", _whole), ("plant", _plant), ("limit", _limit)):
            figures.append(figure(f"scaling.nodes.{count}.{name}_ms", "ms", [1e3 * part(t) for t in repeated]))
    return figures


def _hard_figures(hard: MeshSweep) -> list[Figure]:
    return [
        figure(f"scaling.hard.{count}.plant_ms", "ms", [1e3 * _plant(timed) for timed in repeated], note="hard points")
        for count, repeated in zip(hard.nodes, hard.runs, strict=True)
    ]


def sofa_figures(plant: MeshSweep) -> list[Figure]:
    """How many converged plant steps fit into SOFA's one linearised step, for the meshes within its sizes."""
    note = "one linearised step of SOFA, not tuned, over a converged plant step"
    return [
        figure(
            f"scaling.sofa.{count}.ratio", "x", [sofa / 1e3 / _plant(t) for t in repeated], better="higher", note=note
        )
        for count, repeated in zip(plant.nodes, plant.runs, strict=True)
        if (sofa := sofa_ms(count)) is not None
    ]


def sofa_ms(nodes: int) -> float | None:
    """One linearised step of SOFA, refactored, ms: on the power laws between its measured sizes, None beyond them."""
    if not min(SOFA_DIRECT) <= nodes <= max(SOFA_DIRECT):
        return None
    return float(np.exp(np.interp(np.log(nodes), np.log([*SOFA_DIRECT]), np.log([*SOFA_DIRECT.values()]))))


def _spaced(base: Scenario, spacing_mm: float) -> Scenario:
    return with_blocks(base, interaction={"spacing_mm": spacing_mm})


def _whole(timed: TimedRun) -> float:
    return float(np.median(timed.whole_s))


def _plant(timed: TimedRun) -> float:
    return float(np.median(timed.plant_s))


def _limit(timed: TimedRun) -> float:
    return timed.limit_s


def fitted_exponent(nodes: list[int], seconds: list[float]) -> float:
    """The p of the least-squares fit seconds ~ nodes^p."""
    return float(np.polyfit(np.log(nodes), np.log(seconds), 1)[0])


def _depths(ports: BenchPorts) -> tuple[float, ...]:
    return QUICK_DEPTHS if ports.quick else DEPTHS


def _depth_ratio(ports: BenchPorts, plant: MeshSweep) -> Figure:
    """In the default mesh."""
    shallow, deep = _depths(ports)[0], _depths(ports)[-1]
    ratios = [timed.near(deep, WINDOW_M) / timed.near(shallow, WINDOW_M) for timed in plant.runs[DEFAULT]]
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


def _table(plant: MeshSweep, hard: MeshSweep) -> Table:
    """A row for each mesh."""
    rows = tuple(
        (count, plant_ms, whole_ms, limit_ms, plant_ms / limit_ms, whole_ms / limit_ms, hard_ms, sofa, sofa_ratio)
        for count, plant_ms, whole_ms, limit_ms, hard_ms in zip(
            plant.nodes,
            plant.median_ms(_plant),
            plant.median_ms(_whole),
            plant.median_ms(_limit),
            hard.median_ms(_plant),
            strict=True,
        )
        for sofa in [sofa_ms(count)]
        for sofa_ratio in [None if sofa is None else sofa / plant_ms]
    )
    head = (
        "nodes",
        "plant ms",
        "whole step ms",
        "L0 ms",
        "plant L0",
        "whole L0",
        "hard points ms",
        "SOFA ms",
        "SOFA / plant",
    )
    return Table("Median step over nodes", head, rows)


def _depth_table(ports: BenchPorts, plant: MeshSweep) -> Table:
    runs = plant.runs[DEFAULT]
    near = [(1e3 * depth, [timed.near(depth, WINDOW_M) for timed in runs]) for depth in _depths(ports)]
    rows = tuple((depth_mm, 1e3 * float(np.median(seconds))) for depth_mm, seconds in near)
    return Table("Median whole step over depth", ("depth mm", "whole step ms"), rows)


def _plot(plant: MeshSweep, hard: MeshSweep) -> str:
    """The README's picture: both plants, whole step and L0 next to one linearised step of SOFA."""
    x = [float(n) for n in plant.nodes]
    lines = [
        Line("SOFA, refactored every step", [*map(float, SOFA_DIRECT)], [*SOFA_DIRECT.values()], dashed=True),
        Line("SOFA, stale factor, two threads", [*map(float, SOFA_STALE)], [*SOFA_STALE.values()], dashed=True),
        Line("whole I-FEM step", x, plant.median_ms(_whole)),
        Line("converged plant step", x, plant.median_ms(_plant)),
        Line("the same, hard points", x, hard.median_ms(_plant)),
        Line("L0", x, plant.median_ms(_limit)),
    ]
    panel = Panel("Median time of a step", "nodes", "ms", tuple(lines), x_log=True, y_log=True)
    return svg([[panel]], width=640, height=460)
