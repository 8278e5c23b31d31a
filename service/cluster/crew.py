"""Many insertions on a cluster, each result as soon as it is there: the second `run_many`, with Dask as its engine."""

from __future__ import annotations

import asyncio
import hashlib
import json
import queue
from collections import deque
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Self

import click
from distributed import CancelledError

from benchmarks.cases import Case, Outcome
from service.cluster.connection import Connection
from service.cluster.identity import identity
from service.cluster.shared_store import FOLDER, SharedStore
from service.cluster.task import ATTEMPTS, NotSharedError, Order, WorkerStartError, run_case
from service.worker.crew import crashed
from service.worker.failures import described
from service.worker.insertion_job import SERIES_RUNNER
from service.worker.specs import InsertionSpec

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Sequence
    from pathlib import Path
    from types import TracebackType

    from distributed import Future

    from service.cluster.address import ClusterAddress

PATIENCE_S = 600.0  # for a scheduler that is away, as one whose job waits in a batch system
_WINDOW = 2  # submissions for each worker: what is queued at the scheduler can be blamed for nothing
_LEAST_WINDOW = 4
_TICK_S = 0.5


def _to_standard_error(text: str) -> None:
    click.echo(f"needlebench: {text}", err=True)


class ClusterCrew:
    """The workers of a cluster; a context manager, as `service.worker.crew.Crew` is, with the same `run_many`.

    folder: for the series, on a disk that all workers see under the same name. files: folder in which the file names in
    scenarios are looked up, on such a disk too. say: what happens to scheduler and workers, a line each.
    """

    def __init__(
        self,
        address: ClusterAddress,
        *,
        folder: Path,
        files: Path,
        runner: str = SERIES_RUNNER,
        say: Callable[[str], None] = _to_standard_error,
        patience_s: float = PATIENCE_S,
    ) -> None:
        self._folder, self._files, self._runner, self._say = folder.absolute(), files.absolute(), runner, say
        self._connection = Connection(address, say=say, patience_s=patience_s)

    def __enter__(self) -> Self:
        self._connection.open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._connection.close()

    @property
    def scratch(self) -> Path:
        """Where temporary folders can be that all workers see."""
        return self._folder

    @property
    def slots(self) -> int:
        """How many insertions can run at once, now."""
        return self._connection.slots()

    def run_many(
        self, cases: Sequence[Case], *, alone: bool = False, runner: str | None = None, folder: Path | None = None
    ) -> Generator[Outcome, None, None]:
        """Outcomes in the order in which they end; those that an earlier call left on the shared disk come first.

        A case that raises, or whose worker died in each of five attempts, has the status `crashed` and no measures. A
        scheduler that dies is waited for, and what is missing goes to the next one. alone: one after the other.
        runner, folder: others than the crew's. Raises NoSchedulerError, RefusedError, NotSharedError, StoreError.
        """
        if not cases:
            return
        home = (folder or self._folder).absolute()
        home.mkdir(parents=True, exist_ok=True)
        store = SharedStore(home / FOLDER)
        token = store.open()
        orders = {}
        for case in cases:
            order = self._order(case, store, token, runner)
            orders[order.key] = _Task(case, order)
        there = store.keys()
        for key in [key for key in orders if key in there]:
            yield from _taken(store, orders.pop(key), home)
        window = _Window(self._connection, self._say, 1 if alone else None)
        for task in window.results(deque(orders.values())):
            yield from [task.failed] if task.failed else _taken(store, task, home)
        store.remove()

    def _order(self, case: Case, store: SharedStore, token: str, runner: str | None) -> Order:
        spec = InsertionSpec(
            job_id=case.id,
            scenario=case.scenario,
            files=self._files,
            names="paths",
            full_series=case.labels.get("group") == "DATA",
        ).to_json()
        chosen, ours = runner or self._runner, identity()
        content = json.dumps([spec, chosen, ours["code"], ours["commit"]], sort_keys=True)
        return Order(
            store=str(store.path),
            token=token,
            key=hashlib.sha256(content.encode()).hexdigest()[:32],
            runner=chosen,
            spec=spec,
            identity=ours,
        )


@dataclass(eq=False)
class _Task:
    """A case, what is sent for it, how often that failed; failed: the outcome of one that left none."""

    case: Case
    order: Order
    failures: int = 0
    failed: Outcome | None = None


def _taken(store: SharedStore, task: _Task, home: Path) -> Generator[Outcome, None, None]:
    """The outcome of a case that ended; forgotten in the store when the next one is asked for: it is kept by then."""
    ended = store.take(task.order.key, home)
    if ended["error"] is not None:
        outcome = crashed(task.case, ended["error"])
    else:
        outcome = Outcome(task.case, {**ended["result"], "cost": ended["cost"]})
    yield outcome
    store.forget(task.order.key, ended["cost"]["attempts"])


@dataclass
class _Window:
    """Submissions at the scheduler, about twice as many as there are workers. most: no more than so many."""

    connection: Connection
    say: Callable[[str], None]
    most: int | None
    submitted: int = 0
    ended: queue.SimpleQueue[Future[Any]] = field(default_factory=queue.SimpleQueue)
    running: dict[Future[Any], _Task] = field(default_factory=dict)

    def results(self, waiting: deque[_Task]) -> Generator[_Task, None, None]:
        """Tasks whose case has ended, as they end."""
        lonely = False
        try:
            while waiting or self.running:
                if self.connection.lost:
                    self._again(waiting)
                while waiting and len(self.running) < self._size():
                    self._submit(waiting.popleft())
                if lonely != (self.connection.slots() == 0):
                    lonely = not lonely
                    self.say("waiting for workers" if lonely else "workers have come")
                with suppress(queue.Empty):
                    yield from self._ended(self.ended.get(timeout=_TICK_S), waiting)
        finally:
            for future in self.running:
                with suppress(OSError, TimeoutError, RuntimeError, asyncio.CancelledError):
                    future.cancel()
            self.running.clear()

    def _size(self) -> int:
        return self.most or max(_LEAST_WINDOW, _WINDOW * self.connection.slots())

    def _submit(self, task: _Task) -> None:
        self.submitted += 1
        future = self.connection.submit(run_case, task.order, f"insertion-{task.order.key}-{self.submitted}")
        self.running[future] = task
        future.add_done_callback(self.ended.put)

    def _again(self, waiting: deque[_Task]) -> None:
        """The scheduler is gone: what it had goes to the next one."""
        self.say(f"the scheduler is gone; {len(self.running)} insertions at work are sent again")
        waiting.extendleft(self.running.values())
        self.running.clear()
        self.connection.open()

    def _ended(self, future: Future[Any], waiting: deque[_Task]) -> Generator[_Task, None, None]:
        task = self.running.pop(future, None)
        if task is None:  # of a scheduler that is gone
            return
        try:
            future.result(timeout=60)
        except (NotSharedError, WorkerStartError):
            raise
        except (CancelledError, asyncio.CancelledError):
            self.connection.doubt()
            waiting.appendleft(task)
            return
        except Exception as error:  # noqa: BLE001  (whatever a worker raises: another attempt)
            task.failures += 1
            if task.failures < ATTEMPTS:
                waiting.appendleft(task)
                return
            task.failed = crashed(task.case, f"{described(error)}, attempt {task.failures}")
        yield task
