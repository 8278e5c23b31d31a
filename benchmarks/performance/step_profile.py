"""Where a step's time goes: every kernel and a few methods are wrapped from outside while one run is timed."""

from __future__ import annotations

import functools
import sys
from collections import defaultdict
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.builtin_scenarios import benchmark_scenario
from benchmarks.measurements import Part, Table
from simcore.controllers import ifem, plant_model
from simcore.insertion import compliance, insertion, step_kernel
from simcore.rollout import recorder, series
from simcore.rollout.rollout import run

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from benchmarks.ports import BenchPorts, Clock
    from simcore.rollout.records import Scene, StepRecord
    from simcore.rollout.result import Rollout
    from simcore.scenario.scenario import Scenario

PYTHON = "Python between the kernels"
STAGES = {  # kernel -> stage; a kernel that is not here is listed under its own name
    "block_forces": "tissue forces",
    "damping_forces": "tissue forces",
    "solve_band": "back-solve",
    "add_columns": "tissue moves by the columns",
    "residuals": "beams, constraint geometry and residuals",
    "responses": "W: beams factored, gaps per force",
    "solve_blocks": "beams: solves",
    "moved_shaft": "beams: solves",
    "advance": "beams: update",
    "increments": "beams: update",
    "staircases": "contact laws",
    "solve_laws": "contact laws",
}
METHODS: tuple[tuple[Any, str, str, bool], ...] = (  # owner, name, stage, whether what it calls counts as part of it
    (compliance.Compliance, "solve", "back-solve", True),
    (compliance.Compliance, "refactor", "refactor", True),
    (compliance.Compliance, "sync", "compliance columns and rows", True),
    (insertion.Insertion, "_settle", "channel: cut, create, drop", True),
    (ifem.InverseFemController, "command", "command", False),
    (plant_model, "linearise", "Jacobian", True),
    (recorder.Recorder, "record", "record of the step", True),
    (series.SeriesBuilder, "add", "series", True),
)


def profile(ports: BenchPorts) -> Part:
    """The share of each stage, along `line` and `sine`; the wrapped run is somewhat slower than a plain one."""
    tables = []
    for name in ("line", "sine"):
        ports.say(f"profile: {name}")
        scenario = benchmark_scenario(name, quick=ports.quick)
        plain = _median_step(scenario, None, ports.clock)
        with composed():
            run(scenario)
        stages = Stages(ports.clock)
        with composed(), patch_kernels(stages):
            wrapped = _median_step(scenario, stages, ports.clock)
        title = f"One step along {name}; looking at it makes it {wrapped / plain:.2f} times as long"
        tables.append(stages.table(title, scenario.steps))
    text = "\n".join(f"### {table.title}\n\n{table.markdown()}" for table in tables)
    return Part((), tuple(tables), {"profile.md": text})


class Stages:
    """Time by stage; a stage that calls another is not charged for it, unless it is `whole`."""

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self.seconds: dict[str, float] = defaultdict(float)
        self.calls: dict[str, int] = defaultdict(int)
        self.total_s = 0.0
        self._inner: list[float] = []
        self._whole = False

    def clear(self) -> None:
        """Forget what was before the first step."""
        self.seconds.clear()
        self.calls.clear()
        self._inner.clear()

    def wrap(self, stage: str, function: Callable[..., Any], whole: bool) -> Callable[..., Any]:
        """The function, timed."""

        @functools.wraps(function)
        def timed(*args: Any, **kwargs: Any) -> Any:
            if self._whole:
                return function(*args, **kwargs)
            started, self._whole = self.clock(), whole
            self._inner.append(0.0)
            try:
                return function(*args, **kwargs)
            finally:
                self._whole = False
                elapsed = self.clock() - started
                self.seconds[stage] += elapsed - self._inner.pop()
                self.calls[stage] += 1
                if self._inner:
                    self._inner[-1] += elapsed

        return timed

    def table(self, title: str, steps: int) -> Table:
        """Largest share first; what is in no stage is Python."""
        rest = self.total_s - sum(self.seconds.values())
        rows = [(stage, self.calls[stage] / steps, s) for stage, s in self.seconds.items()] + [(PYTHON, None, rest)]
        rows.sort(key=lambda row: -row[2])
        return Table(
            title,
            ("stage", "calls a step", "ms a step", "share %"),
            tuple((stage, calls, 1e3 * s / steps, 100.0 * s / self.total_s) for stage, calls, s in rows),
        )


class _Watch:
    """Observer: time of each step; everything before the first is forgotten."""

    def __init__(self, stages: Stages | None, clock: Clock) -> None:
        self.stages, self.clock, self.steps_s = stages, clock, list[float]()

    def begin(self, _scene: Scene, _first: StepRecord) -> None:
        if self.stages is not None:
            self.stages.clear()
        self.left = self.clock()

    def step(self, _record: StepRecord) -> None:
        now = self.clock()
        self.steps_s.append(now - self.left)
        self.left = now

    def end(self, _rollout: Rollout) -> None:
        if self.stages is not None:
            self.stages.total_s = float(np.sum(self.steps_s))


def _median_step(scenario: Scenario, stages: Stages | None, clock: Clock) -> float:
    watch = _Watch(stages, clock)
    run(scenario, watch)
    return float(np.median(watch.steps_s))


@contextmanager
def composed() -> Iterator[None]:
    """A step as its kernels, called by Python one after the other; it is one kernel otherwise."""
    undo: list[tuple[Any, str, Any]] = []
    try:
        for name in step_kernel.COMPOSED:
            _replace(step_kernel, name, getattr(step_kernel, name).py_func, undo)
        yield
    finally:
        _restore(undo)


@contextmanager
def patch_kernels(stages: Stages) -> Iterator[None]:
    """Every compiled kernel in the modules of simcore, and METHODS, replaced by timed ones while the context is open.

    A step is `composed` meanwhile, so that each kernel is seen. They must have been called so before: one that is
    compiled meanwhile would find a wrapper where it looks for a kernel.
    """
    undo: list[tuple[Any, str, Any]] = []
    wrapped: dict[int, Callable[..., Any]] = {}
    try:
        for owner, name, stage, whole in METHODS:
            if hasattr(owner, name):
                _replace(owner, name, stages.wrap(stage, getattr(owner, name), whole), undo)
        for module in [m for name, m in sys.modules.items() if name.startswith("simcore.")]:
            for name, value in list(vars(module).items()):
                if hasattr(value, "py_func") and hasattr(value, "signatures"):
                    stage = STAGES.get(value.__name__, value.__name__)
                    timed = wrapped.setdefault(id(value), stages.wrap(stage, value, False))
                    _replace(module, name, timed, undo)
        yield
    finally:
        _restore(undo)


def _restore(undo: list[tuple[Any, str, Any]]) -> None:
    for owner, name, original in reversed(undo):
        setattr(owner, name, original)


def _replace(owner: Any, name: str, value: Any, undo: list[tuple[Any, str, Any]]) -> None:
    undo.append((owner, name, getattr(owner, name)))
    setattr(owner, name, value)
