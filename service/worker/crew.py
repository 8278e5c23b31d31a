"""Many insertions in worker processes, each result as soon as it is there: the `run_many` of studies and data sets."""

from __future__ import annotations

from collections import deque
from concurrent.futures import FIRST_COMPLETED, wait
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, Self

from benchmarks.cases import Case, Outcome
from service.worker.insertion_job import SERIES_RUNNER
from service.worker.process import WorkerDiedError, WorkerProcess
from service.worker.specs import InsertionSpec
from simcore.errors import NeedlebenchError

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator, Sequence
    from pathlib import Path
    from types import TracebackType

ATTEMPTS = 3  # of a case whose worker died; a dead process is seldom the fault of the case
CRASHED = "crashed"
_TICK_S = 0.2


class CaseRunner(Protocol):
    """Runs many cases: the worker processes of this machine, or a cluster."""

    @property
    def slots(self) -> int:
        """How many insertions can run at once, now."""

    @property
    def scratch(self) -> Path | None:
        """Where a temporary folder must be made for all workers to see it; None = anywhere."""

    def run_many(
        self, cases: Sequence[Case], *, alone: bool = False, runner: str | None = None, folder: Path | None = None
    ) -> Generator[Outcome, None, None]:
        """Outcomes in the order in which they end. alone: one after the other. runner, folder: others than usual."""


class CrewStartError(NeedlebenchError):
    """Worker processes die before they are ready."""


class Crew:
    """Warm worker processes with one thread each; a context manager, on leaving which they are gone.

    workers: processes, started when there is something to run, or by `start`. folder: for the series, and the lock that
    lets one worker at a time compile. files: folder in which the file names in scenarios are looked up. runner:
    module:function, as for the service's engine.
    """

    def __init__(self, workers: int, *, folder: Path, files: Path, runner: str = SERIES_RUNNER) -> None:
        if workers < 1:
            raise ValueError(f"workers = {workers}: must be at least 1")
        self._workers, self._folder, self._files, self._runner = workers, folder, files, runner
        self._slots: list[_WorkerSlot] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for slot in self._slots:
            slot.worker.kill()

    @property
    def slots(self) -> int:
        """How many insertions can run at once."""
        return self._workers

    @property
    def scratch(self) -> Path | None:
        """Temporary folders may be anywhere."""
        return None

    def start(self) -> None:
        """Have every worker warm. Raises CrewStartError."""
        slots = self._started(self._workers)
        while not all(slot.ready(_TICK_S) for slot in slots):
            pass

    def run_many(
        self,
        cases: Sequence[Case],
        *,
        alone: bool = False,
        runner: str | None = None,
        folder: Path | None = None,
        own_folders: bool = False,
    ) -> Generator[Outcome, None, None]:
        """Outcomes in the order in which they end. Closing the iterator early ends the processes that are at work.

        A case that raises, or whose worker died three times, has the status `crashed` and no measures.
        alone: one after the other, in one process. runner, folder: others than the crew's. own_folders: each case in a
        folder of its own below, named by its id.
        """
        home = folder or self._folder
        waiting = deque(_Task(case, runner or self._runner, home / case.id if own_folders else home) for case in cases)
        slots = self._started(min(1 if alone else self._workers, len(waiting)))
        yield from _run(slots, [waiting] * len(slots))

    def run_batches(self, batches: Sequence[Sequence[Case]]) -> list[Outcome]:
        """The outcomes of one batch for each worker, all workers at once, in the order in which they end.

        Each case has a folder of its own, named by its id, and one attempt: a second one would spoil a measured time.
        """
        if len(batches) != self._workers:
            raise ValueError(f"{len(batches)} batches for {self._workers} workers")
        queues = [
            deque(_Task(case, self._runner, self._folder / case.id, allowed=1) for case in batch) for batch in batches
        ]
        return list(_run(self._started(self._workers), queues))

    def _started(self, wanted: int) -> list[_WorkerSlot]:
        while len(self._slots) < wanted:
            self._slots.append(_WorkerSlot(self._folder, self._files, self._runner))
        return self._slots[:wanted]


@dataclass
class _Task:
    """A case, who does it, how often it was tried and how often it may be."""

    case: Case
    runner: str
    folder: Path
    allowed: int = ATTEMPTS
    attempts: int = 0


def _run(slots: Sequence[_WorkerSlot], queues: Sequence[deque[_Task]]) -> Iterator[Outcome]:
    """Outcomes as they end; each slot takes from its own queue, which several may share."""
    try:
        while any(queues) or any(slot.task for slot in slots):
            for slot, queue in zip(slots, queues, strict=True):
                if queue and slot.ready():
                    slot.begin(queue.popleft())
            pending = [slot.worker.pending for slot in slots if slot.worker.pending is not None]
            wait(pending, _TICK_S, FIRST_COMPLETED)
            for slot, queue in zip(slots, queues, strict=True):
                if (ended := slot.ended()) is None:
                    continue
                task, outcome = ended
                if outcome is None:
                    queue.appendleft(task)
                else:
                    yield outcome
    finally:
        for slot in slots:
            slot.abandon()


class _WorkerSlot:
    """A worker process, replaced when it dies, and its task."""

    def __init__(self, folder: Path, files: Path, runner: str) -> None:
        self._files = files
        self.task: _Task | None = None
        self._failed_starts = 0  # in a row
        self.worker = WorkerProcess(runner, folder / "warm.lock")
        self.worker.start()

    def ready(self, timeout_s: float = 0.0) -> bool:
        """Whether it can take a case. Raises CrewStartError when its workers never get ready."""
        if self.task is not None:
            return False
        if not self.worker.alive and self.worker.pending is None:
            self.worker.start()
        try:
            if self.worker.ready(timeout_s):
                self._failed_starts = 0
                return True
        except WorkerDiedError as death:
            self._failed_starts += 1
            if self._failed_starts >= ATTEMPTS:
                message = f"a worker process could not be started in {ATTEMPTS} attempts: {death}"
                raise CrewStartError(message) from None
            self.worker.start()
        return False

    def begin(self, task: _Task) -> None:
        """Send a case to the worker."""
        task.attempts += 1
        self.task = task
        spec = InsertionSpec(
            job_id=task.case.id,
            scenario=task.case.scenario,
            files=self._files,
            names="paths",
            full_series=task.case.labels.get("group") == "DATA",
        )
        try:
            self.worker.send(task.runner, spec, task.folder)
        except WorkerDiedError:
            self.worker.kill()  # `ended` finds it so

    def ended(self) -> tuple[_Task, Outcome | None] | None:
        """The task and its outcome, None for one that is to be tried again; None while it is running."""
        task = self.task
        if task is None:
            return None
        try:
            if self.worker.pending is None:
                raise WorkerDiedError("its worker process died")
            if not self.worker.wait(0):
                return None
            report = self.worker.collect()
        except WorkerDiedError as death:
            self.task = None
            self.worker.kill()
            tried_enough = task.attempts >= task.allowed
            return task, crashed(task.case, f"{death}, attempt {task.attempts}") if tried_enough else None
        self.task = None
        if report.leftovers:
            self.worker.kill()  # `ready` starts another one
        if report.error is not None:
            return task, crashed(task.case, report.error)
        cost = {"cpu_s": report.cpu_s, "max_rss_mb": report.max_rss_mb, "attempts": task.attempts}
        return task, Outcome(task.case, {**report.result, "cost": cost})

    def abandon(self) -> None:
        """Forget the case at hand and end its process."""
        if self.task is not None:
            self.task = None
            self.worker.kill()


def crashed(case: Case, message: str) -> Outcome:
    """The outcome of a case that left no result: the same shape, nothing measured, neither stable nor successful."""
    from simcore.metrics import MEASURED

    metrics = {"stable": False, "success": False, "steps_completed": 0, "steps": None, **dict.fromkeys(MEASURED)}
    result = {"status": CRASHED, "message": message, "metrics": metrics, "timing": {}, "solver": {}, "digest": None}
    return Outcome(case, {**result, "warnings": [], "provenance": {"scenario": case.scenario}})
