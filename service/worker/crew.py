"""Many insertions in worker processes, each result as soon as it is there: the `run_many` of suites and campaigns."""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from benchmarks.cases import Case, Outcome
from service.worker import attempt as worker
from service.worker import process as pool
from simcore.errors import NeedlebenchError

if TYPE_CHECKING:
    from numpy.typing import NDArray

INSERTION = "service.worker.crew:insertion"
RECORDING = "service.worker.crew:recording"
ATTEMPTS = 3  # of a case whose worker died; a dead process is seldom the fault of the case
CRASHED = "crashed"
_TICK_S = 0.2
STATE = (
    "tip_m",
    "target_m",
    "base_position_m",
    "base_rotation",
    "limited",
    "depth_m",
    "insertion_force_n",
    "rcm_error_m",
)


class CannotStart(NeedlebenchError):
    """Worker processes die before they are ready."""


class Crew:
    """Warm worker processes with one thread each; a context manager, on leaving which they are gone.

    workers: processes, started when there is something to run. folder: for the series, and the lock that lets one
    worker at a time compile. files: folder in which the file names in scenarios are looked up. runner:
    module:function, as for the service's engine.
    """

    def __init__(self, workers: int, *, folder: Path, files: Path, runner: str = INSERTION) -> None:
        if workers < 1:
            raise ValueError(f"workers = {workers}: must be at least 1")
        self._workers, self._folder, self._files, self._runner = workers, folder, files, runner
        self._seats: list[_Seat] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for seat in self._seats:
            seat.stop()

    def run_many(
        self, cases: Sequence[Case], *, alone: bool = False, runner: str | None = None, folder: Path | None = None
    ) -> Generator[Outcome, None, None]:
        """Outcomes in the order in which they end. Closing the iterator early ends the processes that are at work.

        A case that raises, or whose worker died three times, has the status `crashed` and no measures.
        alone: one after the other, in one process. runner, folder: others than the crew's.
        """
        waiting = deque(_Task(case, runner or self._runner, folder or self._folder) for case in cases)
        wanted = min(1 if alone else self._workers, len(waiting))
        while len(self._seats) < wanted:
            self._seats.append(_Seat(self._folder, self._files, self._runner))
        seats = self._seats[:wanted]
        try:
            while waiting or any(seat.task for seat in seats):
                for seat in seats:
                    if waiting and seat.ready():
                        seat.begin(waiting.popleft())
                wait([seat.future for seat in seats if seat.pending], _TICK_S, FIRST_COMPLETED)
                for seat in seats:
                    if (ended := seat.ended()) is None:
                        continue
                    task, outcome = ended
                    if outcome is None:
                        waiting.appendleft(task)
                    else:
                        yield outcome
        finally:
            for seat in seats:
                seat.abandon()


@dataclass
class _Task:
    """A case, who does it and how often it was tried."""

    case: Case
    runner: str
    folder: Path
    attempts: int = 0


class _Seat:
    """A worker process, replaced when it dies, and what it is at."""

    def __init__(self, folder: Path, files: Path, runner: str) -> None:
        self._folder, self._files, self._runner = folder, files, runner
        self.task: _Task | None = None
        self._deaths = 0  # in a row, before it was warm
        self._start()

    def _start(self) -> None:
        self._worker = pool.Worker()
        self._warm = False
        self.future: Future[Any] = self._worker.call(pool.warm, self._runner, str(self._folder / "warm.lock"))

    @property
    def pending(self) -> bool:
        return not self.future.done()

    def ready(self) -> bool:
        """Whether it can take a case. Raises CannotStart when its workers never get ready."""
        if self.task is not None:
            return False
        if not self._worker.alive:
            self._replace("it died while it had nothing to do")
            return False
        if not self._warm and self.future.done():
            try:
                pool.answer(self.future)
            except pool.Lost as loss:
                self._replace(str(loss))
                return False
            self._warm, self._deaths = True, 0
        return self._warm

    def begin(self, task: _Task) -> None:
        task.attempts += 1
        self.task = task
        whole = task.case.labels.get("group") == "DATA"
        spec = {"scenario": task.case.scenario, "job_id": task.case.id, "files": str(self._files), "whole": whole}
        try:
            self.future = self._worker.call(worker.execute, task.runner, spec, str(task.folder))
        except pool.Lost as loss:
            self.future = Future()
            self.future.set_exception(loss)

    def ended(self) -> tuple[_Task, Outcome | None] | None:
        """The task and its outcome, None for one that is to be tried again; None while it is running."""
        task = self.task
        if task is None or (self.pending and self._worker.alive):
            return None
        self.task = None
        try:
            if self.pending:
                raise pool.Lost("its worker process died")
            answer = pool.answer(self.future)
        except pool.Lost as loss:
            self.stop()
            self._start()
            message = f"{loss}, {task.attempts} times"
            return task, crashed(task.case, message) if task.attempts >= ATTEMPTS else None
        if answer["error"] is not None:
            return task, crashed(task.case, answer["error"]["message"])
        cost = {"cpu_s": answer["cpu_s"], "max_rss_mb": answer["max_rss_mb"], "attempts": task.attempts}
        return task, Outcome(task.case, {**answer["result"], "cost": cost})

    def _replace(self, reason: str) -> None:
        self._deaths += 1
        if self._deaths >= ATTEMPTS:
            raise CannotStart(f"a worker process could not be started in {ATTEMPTS} attempts: {reason}")
        self.stop()
        self._start()

    def abandon(self) -> None:
        """Forget the case at hand and end its process."""
        if self.task is not None:
            self.task = None
            self.stop()

    def stop(self) -> None:
        self._worker.stop()


def crashed(case: Case, message: str) -> Outcome:
    """The outcome of a case that left no result: the same shape, nothing measured, neither stable nor successful."""
    from simcore.metrics import MEASURED

    metrics = {"stable": False, "success": False, "steps_completed": 0, "steps": None, **dict.fromkeys(MEASURED)}
    result = {"status": CRASHED, "message": message, "metrics": metrics, "timing": {}, "solver": {}, "digest": None}
    return Outcome(case, {**result, "warnings": [], "provenance": {"scenario": case.scenario}})


# ---- in the worker


def insertion(spec: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Run `spec["scenario"]`, keep its series without tissue as `<job_id>.npz`; the JSON of its result.

    spec: {"scenario", "job_id", "files", "whole"}. Whole are the series of training insertions; of any other the state
    is kept in single precision: what errors, forces and paths are drawn from.
    """
    import numpy as np

    from simcore.rollout import rollout
    from simcore.rollout.artefacts import replace_atomically
    from simcore.scenario.scenario import Scenario

    with _files(spec):
        done = rollout.run(Scenario.load(spec["scenario"]))
        result = done.result()
    if spec["whole"]:
        kept = {name: array for name, array in done.series.items() if not name.startswith("tissue_")}
    else:
        kept = {name: _single(done.series[name]) for name in STATE}
    path = folder / f"{spec['job_id']}.npz"
    replace_atomically(path, lambda file: np.savez_compressed(file, allow_pickle=False, **kept))
    return result


def recording(spec: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Run `spec["scenario"]` again with its recording on, into `<job_id>.rrd`; the JSON of its result, with the
    `recording_warning` of a recording that is missing or incomplete, else None."""
    from service.recording.observer import RerunObserver
    from simcore.rollout import rollout
    from simcore.scenario.scenario import Scenario

    scenario = spec["scenario"]
    shown = {**scenario, "recording": {**scenario["recording"], "enabled": True}}
    recorder = RerunObserver(folder / f"{spec['job_id']}.rrd", recording_id=spec["job_id"])
    with _files(spec), recorder:
        result = rollout.run(Scenario.load(shown), recorder).result()
    return {**result, "recording_warning": recorder.warning}


def _files(spec: dict[str, Any]) -> AbstractContextManager[None]:
    from simcore.file_names import names_mean

    folder = Path(spec["files"])
    return names_mean(lambda name: folder / name)


def _single(array: NDArray[Any]) -> NDArray[Any]:
    return array.astype("f4") if array.dtype.kind == "f" else array


def warm_up() -> None:
    """Compile every kernel, or load it from the cache."""
    from simcore.rollout.rollout import compile_kernels

    compile_kernels()
