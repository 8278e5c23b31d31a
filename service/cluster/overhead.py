"""What a task costs on a cluster of this machine: real processes, and CPU time of each of them."""

from __future__ import annotations

import subprocess
import sys
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import psutil

from benchmarks.cases import Case
from benchmarks.ports import ClusterCost
from service.cluster.address import FILE, ClusterAddress
from service.cluster.crew import ClusterCrew
from simcore.errors import NeedlebenchError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

RUNNER = "service.cluster.overhead:five_milliseconds"
_WARM_UP = 8  # tasks for each worker before anything is measured
_START_S = 300.0


class WorkersMissingError(NeedlebenchError):
    """The workers of this machine have not signed on."""


def five_milliseconds(spec: dict[str, Any], folder: Path) -> dict[str, Any]:
    """A job that does nothing for 5 ms, and leaves a file as an insertion does."""
    time.sleep(0.005)
    (folder / f"{spec['job_id']}.npz").write_text(spec["job_id"])
    return {"status": "completed"}


def warm_up() -> None:
    """Nothing to compile."""


def measure(tasks: int, workers: int, folder: Path) -> ClusterCost:
    """Run so many tasks of 5 ms on so many workers. folder: an empty one. Raises WorkersMissingError."""
    with _processes(workers, folder / "cluster") as (scheduler, started):
        address = ClusterAddress(f"{FILE}{folder}/cluster/scheduler.json")
        with ClusterCrew(address, folder=folder, files=folder, runner=RUNNER, patience_s=_START_S) as crew:
            _await(crew, workers)
            _run(crew, _WARM_UP * workers, "warm")
            before = [_cpu_s(scheduler), _cpu_s(psutil.Process(), children=False), sum(map(_cpu_s, started))]
            began = time.perf_counter()
            _run(crew, tasks, "task")
            wall_s = time.perf_counter() - began
            after = [_cpu_s(scheduler), _cpu_s(psutil.Process(), children=False), sum(map(_cpu_s, started))]
    return ClusterCost(tasks, workers, wall_s, *(b - a for a, b in zip(before, after, strict=True)))


def _run(crew: ClusterCrew, tasks: int, name: str) -> None:
    for outcome in crew.run_many([Case(f"{name}-{i}", {"name": name}, {}) for i in range(tasks)]):
        (crew.scratch / f"{outcome.case.id}.npz").unlink()


def _await(crew: ClusterCrew, workers: int) -> None:
    deadline = time.monotonic() + _START_S
    while crew.slots < workers:
        if time.monotonic() > deadline:
            raise WorkersMissingError(f"{crew.slots} of {workers} workers have signed on within {_START_S:g} s")
        time.sleep(0.5)


def _cpu_s(process: psutil.Process, *, children: bool = True) -> float:
    """CPU time of a process, and of the processes that it has started and that live."""
    members = [process, *(process.children(recursive=True) if children else [])]
    return float(sum(times.user + times.system for times in (one.cpu_times() for one in members)))


@contextmanager
def _processes(workers: int, folder: Path) -> Iterator[tuple[psutil.Process, list[psutil.Process]]]:
    """A scheduler and its workers, gone at the end."""
    folder.mkdir(parents=True)
    where = f"{FILE}{folder}/scheduler.json"
    commands = [["scheduler", "--out", str(folder)], *[["worker", where]] * workers]
    started = []
    with (folder / "log").open("wb") as log:
        try:
            for command in commands:
                words = [sys.executable, "-m", "service.cli", "cluster", *command]
                started.append(subprocess.Popen(words, stdout=log, stderr=log))
            first, *others = (psutil.Process(one.pid) for one in started)
            yield first, others
        finally:
            for one in reversed(started):
                one.terminate()
            for one in started:
                one.wait()
