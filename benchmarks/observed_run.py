"""A run with everything that the studies look at: the series of the rollout, and the lateral force at the entry.

`job` is the same for a worker process: a JSON specification and a folder in, a JSON result out, the series in a file.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simcore.rollout.records import Scene, StepRecord
from simcore.rollout.result import Rollout
from simcore.rollout.rollout import compile_kernels, run
from simcore.rollout.series import lateral_forces
from simcore.scenario.scenario import Scenario

JOB = "benchmarks.observed_run:job"
_FILE = "observed.npz"


@dataclass(frozen=True)
class ObservedRun:
    """One finished run. series: as in series.npz, and entry_force_n (steps + 1,)."""

    status: str
    message: str
    metrics: dict[str, Any]
    solver: dict[str, Any]
    series: dict[str, NDArray[Any]]


class EntryForce:
    """Observer: magnitude of the lateral force at the constraint point nearest to the entry, N, at every step."""

    def __init__(self) -> None:
        self.force_n: list[float] = []

    def begin(self, scene: Scene, first: StepRecord) -> None:
        """Note the entry."""
        self.entry_m = scene.entry_m
        self.step(first)

    def step(self, record: StepRecord) -> None:
        """Append the force of this step; 0 as long as nothing is inserted."""
        if not len(record.points_m):
            self.force_n.append(0.0)
            return
        nearest = int(np.argmin(((record.points_m - self.entry_m) ** 2).sum(axis=1)))
        self.force_n.append(float(np.linalg.norm(lateral_forces(record)[nearest])))

    def end(self, rollout: Rollout) -> None:
        """Nothing is left to do."""


def observe(scenario: Scenario) -> ObservedRun:
    """Run a scenario in this process."""
    observer = EntryForce()
    done = run(scenario, observer)
    series = {**done.series, "entry_force_n": np.array(observer.force_n)}
    return ObservedRun(str(done.status), done.message, done.metrics, done.solver, series)


def job(spec: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Run `spec["scenario"]`; the series go to a file in `folder`, the rest is returned."""
    done = observe(Scenario.load(spec["scenario"]))
    np.savez(folder / _FILE, allow_pickle=False, **done.series)
    return {"status": done.status, "message": done.message, "metrics": done.metrics, "solver": done.solver}


def load(folder: Path, result: dict[str, Any]) -> ObservedRun:
    """What a job left."""
    with np.load(folder / _FILE) as arrays:
        return ObservedRun(**result, series={name: arrays[name] for name in arrays.files})


def warm_up() -> None:
    """In a worker: be ready for jobs."""
    compile_kernels()
