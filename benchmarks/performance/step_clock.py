"""Timing a run from outside: an observer that reads the clock between its calls and runs L0 now and then."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.performance.reference_kernels import ReferenceStep
from benchmarks.ports import Clock
from simcore.errors import NeedlebenchError, Status
from simcore.mesh.mesh import BoxMesh
from simcore.rollout.records import Scene, StepRecord
from simcore.rollout.result import Rollout
from simcore.rollout.rollout import run
from simcore.scenario.build import insertion_of
from simcore.scenario.scenario import Scenario

Vector = NDArray[np.float64]

LIMIT_EVERY_STEPS = 20
LIMIT_PASSES = 5  # the first of them is thrown away: it finds the caches full of the simulation


class MeasurementError(NeedlebenchError):
    """A run that was to be timed did not reach its end."""


@dataclass(frozen=True)
class TimedRun:
    """One timed run. whole_s: everything between two calls of the observer; plant_s, jacobian_s: as the run says, all
    (steps,) in seconds. depth_m: (steps,). limit_s: median of L0 during the run."""

    whole_s: Vector
    plant_s: Vector
    jacobian_s: Vector
    depth_m: Vector
    limit_s: float
    dt_s: float

    @property
    def realtime(self) -> float:
        """Simulated over elapsed time of the loop."""
        return self.dt_s * len(self.whole_s) / float(self.whole_s.sum())

    def near(self, depth_m: float, width_m: float) -> float:
        """Median of the whole step, s, where the depth is within `width_m` of `depth_m`."""
        return float(np.median(self.whole_s[np.abs(self.depth_m - depth_m) <= width_m]))


class _StepClock:
    """The observer."""

    def __init__(self, limit: ReferenceStep, clock: Clock) -> None:
        self.limit, self.clock = limit, clock
        self.whole_s: list[float] = []
        self.limit_s: list[float] = []
        self.left = 0.0

    def begin(self, _scene: Scene, _first: StepRecord) -> None:
        self.left = self.clock()

    def step(self, record: StepRecord) -> None:
        self.whole_s.append(self.clock() - self.left)
        if record.step % LIMIT_EVERY_STEPS == 0:
            self.limit_s += [self.limit.seconds(self.clock) for _ in range(LIMIT_PASSES)][1:]
        self.left = self.clock()

    def end(self, rollout: Rollout) -> None:
        pass


def limit_of(scenario: Scenario) -> ReferenceStep:
    """L0 on the mesh and material of a scenario."""
    tissue = insertion_of(scenario).tissue
    if not isinstance(tissue.mesh, BoxMesh):
        raise MeasurementError("the unit L0 is defined on the box mesh only")
    held = np.flatnonzero(tissue.unknown < 0)
    return ReferenceStep(tissue.mesh, held, mu_pa=tissue.mu_pa, lambda_pa=tissue.lambda_pa)


def timed_run(scenario: Scenario, limit: ReferenceStep, clock: Clock) -> TimedRun:
    """Run a scenario without a recorder, L0 interleaved. Raises Unusable if it does not complete."""
    observer = _StepClock(limit, clock)
    done = run(scenario, observer, clock=clock)
    if done.status is not Status.COMPLETED:
        raise MeasurementError(f"{scenario.name} ended as {done.status}: {done.message}")
    series = done.series
    limit_s = observer.limit_s or [limit.seconds(clock)]
    return TimedRun(
        whole_s=np.array(observer.whole_s),
        plant_s=series["plant_s"][1:],
        jacobian_s=series["jacobian_s"][1:],
        depth_m=series["depth_m"][1:],
        limit_s=float(np.median(limit_s)),
        dt_s=scenario.dt_s,
    )
