"""The benchmarks by name, and a run of several."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from benchmarks.performance.cluster import cluster
from benchmarks.performance.environments import environments
from benchmarks.performance.kernels import micro
from benchmarks.performance.recording_cost import recording
from benchmarks.performance.scaling import scaling
from benchmarks.performance.start_and_memory import memory, start
from benchmarks.performance.step_profile import profile
from benchmarks.performance.throughput import throughput
from benchmarks.performance.whole_step import step
from benchmarks.studies.convergence import convergence
from benchmarks.studies.forces import forces
from benchmarks.studies.sweeps import sweeps_study
from benchmarks.studies.work_precision import work_precision
from simcore.errors import Problem, ScenarioError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from benchmarks.measurements import Part
    from benchmarks.ports import BenchPorts


@dataclass(frozen=True)
class Benchmark:
    """A benchmark; studies are run only when they are named."""

    run: Callable[[BenchPorts], Part]
    text: str
    study: bool = False


BENCHMARKS = {
    "micro": Benchmark(micro, "kernels one by one: forces, back-solve, refactor, W, beams"),
    "step": Benchmark(step, "plant step and whole I-FEM step along line and sine, in ms and in L0"),
    "scaling": Benchmark(scaling, "the step over nodes (next to L0), depth, beams, time step"),
    "throughput": Benchmark(throughput, "two jobs at once on two cores, compared with one after the other"),
    "recording": Benchmark(recording, "a run with and without its recording"),
    "start-up": Benchmark(start, "process start to first step, warm and cold kernel cache"),
    "memory": Benchmark(memory, "peak memory of a process at 1,617 and 4,743 nodes"),
    "envs": Benchmark(environments, "steps a second: an episode, one environment, two at once on two cores"),
    "profile": Benchmark(profile, "share of each stage of a step"),
    "convergence": Benchmark(convergence, "bands of the default: three meshes, three spacings", study=True),
    "work-precision": Benchmark(work_precision, "which mesh is worth its time: uniform, graded", study=True),
    "sweeps": Benchmark(sweeps_study, "tip, entry force and sum |lambda|, one parameter at a time", study=True),
    "cluster": Benchmark(cluster, "what a task costs on a Dask cluster of this machine: 10,000 of 5 ms", study=True),
    "forces": Benchmark(forces, "force over depth: push, hold, pull out", study=True),
}


def select(names: Sequence[str]) -> list[str]:
    """The benchmarks asked for, each once; without a name all that measure time or memory. Raises ScenarioError."""
    unknown = [name for name in names if name not in BENCHMARKS]
    if unknown:
        raise ScenarioError([Problem("NAME", name, f"is none of {', '.join(BENCHMARKS)}") for name in unknown])
    return list(dict.fromkeys(names)) or [name for name, benchmark in BENCHMARKS.items() if not benchmark.study]


def run_suite(names: Sequence[str], ports: BenchPorts) -> dict[str, Part]:
    """Each benchmark's part, in the order of the names."""
    return {name: BENCHMARKS[name].run(ports) for name in names}
