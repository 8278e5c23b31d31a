"""What the benchmarks need and must not know: processes, the recorder, files. The command line provides them."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

if TYPE_CHECKING:
    from contextlib import AbstractContextManager
    from pathlib import Path

    from benchmarks.observed_run import ObservedRun
    from simcore.rollout.records import Observer
    from simcore.scenario.scenario import Scenario

Clock = Callable[[], float]


class Recording(Protocol):
    """A recorder for one run, open."""

    def __enter__(self) -> Observer: ...
    def __exit__(self, *error: Any) -> bool | None: ...


class Crew(Protocol):
    """Warm worker processes."""

    def seconds(self, batches: Sequence[Sequence[Scenario]]) -> float:
        """Wall time until each worker has done its batch, one scenario after the other, all workers at once."""

    def run_many(self, scenarios: Sequence[Scenario]) -> list[ObservedRun]:
        """Run all, two at a time; results in the order of the scenarios."""


class ClusterCost(NamedTuple):
    """What so many tasks of 5 ms took on a cluster of this machine: wall time, and CPU time of scheduler, campaign and
    all workers together; s."""

    tasks: int
    workers: int
    wall_s: float
    scheduler_cpu_s: float
    campaign_cpu_s: float
    workers_cpu_s: float


def _no_cluster(_tasks: int, _workers: int) -> ClusterCost:
    """Where nobody can start one."""
    raise NotImplementedError("no cluster was handed in")


def _nothing_kept(_name: str) -> str | None:
    """Without a place to keep anything."""
    return None


def _not_kept(_name: str, _text: str) -> None:
    """Without a place to keep anything."""


@dataclass(frozen=True)
class BenchPorts:
    """What the command line provides.

    say: progress, one line. recorder: opens a recording at a path. recorder_name: the same, as `module:function`, for a
    process of its own. crew: so many workers while the context is open. folder: where scratch files may be. kept: the
    text that an interrupted benchmark kept under a name, or None; keep: keep it, in place of what was there. cluster:
    (tasks, workers) -> what tasks of 5 ms cost on a cluster of this machine.
    """

    say: Callable[[str], None]
    recorder: Callable[[Path], Recording]
    recorder_name: str
    crew: Callable[[int], AbstractContextManager[Crew]]
    folder: Path
    clock: Clock = time.perf_counter
    quick: bool = False
    kept: Callable[[str], str | None] = _nothing_kept
    keep: Callable[[str, str], None] = _not_kept
    cluster: Callable[[int, int], ClusterCost] = _no_cluster

    def rounds(self, full: int) -> int:
        """How often a measurement is repeated."""
        return 1 if self.quick else full
