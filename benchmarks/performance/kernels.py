"""The kernels of a step one by one, on a needle half-way in, with L0 between them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.builtin_scenarios import benchmark_scenario
from benchmarks.measurements import Figure, Part, figure
from benchmarks.performance.step_clock import MeasurementError, limit_of
from simcore.errors import Status
from simcore.insertion.response import responses
from simcore.insertion.state import Pose
from simcore.needle.beam import internal
from simcore.rollout.rollout import compile_kernels
from simcore.scenario.build import insertion_of

if TYPE_CHECKING:
    from benchmarks.ports import BenchPorts, Clock
    from simcore.insertion.insertion import Insertion, InsertionState
    from simcore.scenario.scenario import Scenario

ROUNDS = 30
CALLS = 10
DEPTH_SHARE = 0.5
ADVANCE_M = 0.25e-3

Kernel = Callable[[], object]


def micro(ports: BenchPorts) -> Part:
    """Median time of one call; a run is a round of calls."""
    compile_kernels()
    scenario = benchmark_scenario("line", quick=ports.quick)
    ports.say("micro: pushing the needle half-way in")
    insertion, state = half_way(scenario)
    limit = limit_of(scenario)
    kernels: dict[str, Kernel] = {
        **_kernels(insertion, state),
        "limit": limit.run,
        "limit_back_solve": limit.solve,
        "limit_force": limit.evaluate,
    }
    rounds = 3 if ports.quick else ROUNDS
    times: dict[str, list[float]] = {name: [] for name in kernels}
    ports.say(f"micro: {rounds} rounds of {', '.join(kernels)}")
    for _ in range(rounds):
        for name, kernel in kernels.items():
            times[name].append(_per_call(kernel, 1 if name == "refactor" else CALLS, ports.clock))
    return Part(tuple(_figure(name, values) for name, values in times.items()))


def half_way(scenario: Scenario) -> tuple[Insertion, InsertionState]:
    """The plant with the straight needle pushed along the path's first tangent to half its length."""
    insertion, path = insertion_of(scenario), scenario.path()
    tangent = path.first_tangent()
    state = insertion.initial_state(tangent)
    start = insertion.initial_base(tangent)
    for i in range(round(DEPTH_SHARE * path.length_m / ADVANCE_M)):
        base = Pose(start.position_m + (i + 1) * ADVANCE_M * tangent, start.rotation)
        state = insertion.step(state, base)
        if state.report.status is not Status.COMPLETED:
            raise MeasurementError(f"step {i + 1} of the push ended as {state.report.status}: {state.report.message}")
    return insertion, state


def _kernels(insertion: Insertion, state: InsertionState) -> dict[str, Kernel]:
    workspace, solved = insertion.workspace, state.solved
    between = workspace.compliance.between_points
    bodies, needle, right = state.bodies, insertion.needle, np.ones(insertion.tissue.unknowns)
    columns = np.ones((3, insertion.tissue.unknowns), np.float32)
    rotations = workspace.blocks.rotations()
    held, elements, beams = np.zeros_like(bodies.x), solved.active.elements, solved.beams
    return {
        "force": lambda: workspace.blocks.evaluate(bodies.x, held),
        "back_solve": lambda: workspace.compliance.solve(right),
        "columns": lambda: workspace.compliance.solve(columns),
        "w": lambda: responses(elements, solved.at.points, beams.diag, beams.upper, beams.lower, between),
        "beams": lambda: internal(bodies.needle_x, bodies.needle_R, needle.section, workspace.beams),
        "refactor": lambda: workspace.compliance.refactor(rotations),
    }


def _per_call(kernel: Kernel, calls: int, clock: Clock) -> float:
    kernel()
    started = clock()
    for _ in range(calls):
        kernel()
    return (clock() - started) / calls


def _figure(name: str, seconds: list[float]) -> Figure:
    notes = {
        "columns": "back-solve of the three columns of a constraint point",
        "w": "factor of the needle and W = H A^-1 H^T",
        "limit": "L0",
    }
    return figure(f"micro.{name}_ms", "ms", [1e3 * s for s in seconds], note=notes.get(name, ""))
