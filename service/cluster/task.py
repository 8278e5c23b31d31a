"""What a Dask worker does with one case: an attempt in a warm process of its own, its result onto the shared disk.

The insertion runs in a process that this one supervises, exactly as on one machine, so that a plug-in which crashes
costs an attempt and not a worker; Dask's own heartbeat goes on meanwhile.
"""

from __future__ import annotations

import os
import platform
import tempfile
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from service.cluster.identity import difference, identity
from service.cluster.shared_store import SharedStore
from service.logs import LOG
from service.worker.process import WorkerDiedError, WorkerProcess
from service.worker.specs import AttemptReport, InsertionSpec
from simcore.errors import NeedlebenchError

ATTEMPTS = 5  # of a case; more than on one machine, for here machines are taken away from under it
_STARTS = 3
_TICK_S = 0.2
_over = threading.Event()
_thread = ThreadPoolExecutor(1, "insertions")  # outlives each connection to a scheduler: Linux ends a child with it


class NotSharedError(NeedlebenchError):
    """The worker does not see the folder of the campaign."""


class WorkerEndedError(NeedlebenchError):
    """The worker is being ended: the case is for another one."""


class WorkerStartError(NeedlebenchError):
    """The worker's process for insertions dies before it is ready."""


@dataclass(frozen=True, kw_only=True)
class Order:
    """One case as it is sent. store, token: of the shared disk. key: of the case in it. identity: of the campaign."""

    store: str
    token: str
    key: str
    runner: str
    spec: dict[str, Any]
    identity: dict[str, str | None]


def run_case(order: Order) -> dict[str, Any]:
    """Run a case until it has ended, and publish that; a receipt: {"key", "attempts"}.

    Raises NotSharedError, WorkerStartError; and asks the scheduler for another worker if this one differs.
    """
    if difference(identity(), order.identity) is not None:
        from distributed import Reschedule

        time.sleep(1.0)  # it is being sent away
        raise Reschedule
    return _thread.submit(_run_case, order).result()


def _run_case(order: Order) -> dict[str, Any]:
    store = SharedStore(Path(order.store))
    if not store.shows(order.token):
        where = f"worker process {os.getpid()} on {platform.node()}"
        raise NotSharedError(f"{where} does not see {order.store}: it must be on a disk that all machines share")
    ended = store.ended(order.key)
    while ended is None:
        if _over.is_set():
            raise WorkerEndedError(f"worker process {os.getpid()} on {platform.node()} was ended")
        ended = _attempt(order, store)
    return {"key": order.key, "attempts": ended["cost"]["attempts"]}


def _attempt(order: Order, store: SharedStore) -> dict[str, Any] | None:
    """How the case ended; None if it is to be tried again."""
    number = store.begin(order.key, f"{platform.node()} {os.getpid()}")
    current.set(_Attempt(store, order.key, number))
    try:
        if number > ATTEMPTS:
            return store.publish(order.key, _crashed(f"its worker died, attempt {ATTEMPTS}", ATTEMPTS))
        with tempfile.TemporaryDirectory(prefix="needlebench-attempt-") as scratch:
            try:
                report = _process.run(order.runner, order.spec, Path(scratch))
            except WorkerDiedError as death:
                if number < ATTEMPTS:
                    return None
                return store.publish(order.key, _crashed(f"{death}, attempt {number}", number))
            return store.publish(order.key, _ended(report, _Attempt(store, order.key, number), Path(scratch)))
    finally:
        current.set(None)


def _crashed(message: str, attempts: int) -> dict[str, Any]:
    return {"error": message, "result": None, "files": {}, "cost": {"attempts": attempts}}


def _ended(report: AttemptReport, attempt: _Attempt, folder: Path) -> dict[str, Any]:
    store, key, number = attempt
    left = [] if report.error else [one for one in sorted(folder.iterdir()) if one.is_file() and one.name != LOG]
    files = {one.name: store.keep_file(one, key, number) for one in left if not one.name.startswith(".")}
    cost = {"cpu_s": report.cpu_s, "max_rss_mb": report.max_rss_mb, "attempts": number}
    return {"error": report.error, "result": report.result, "files": files, "cost": cost}


class _Attempt(NamedTuple):
    """Attempt `number` of a case, by its key in a store."""

    store: SharedStore
    key: str
    number: int


class _Current:
    """The attempt at hand, for whoever ends this worker."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._attempt: _Attempt | None = None

    def set(self, attempt: _Attempt | None) -> None:
        """It begins, or has ended."""
        with self._lock:
            self._attempt = attempt

    @property
    def busy(self) -> bool:
        """Whether there is one."""
        return self._attempt is not None

    def give_back(self) -> None:
        """It does not count: it is ended from outside, as by a batch system whose time is over."""
        with self._lock:
            if self._attempt is not None:
                store, key, number = self._attempt
                store.give_back(key, number)


class _Process:
    """The warm process of this worker, replaced when it dies; used by one thread alone."""

    def __init__(self) -> None:
        self._worker: WorkerProcess | None = None

    def run(self, runner: str, spec: dict[str, Any], folder: Path) -> AttemptReport:
        """What an attempt left. Raises WorkerDiedError, WorkerStartError."""
        worker = self._ready(runner)
        try:
            worker.send(runner, InsertionSpec.from_json(spec), folder)
            while not worker.wait(_TICK_S):
                pass
            report = worker.collect()
        except WorkerDiedError:
            self.end()
            raise
        if report.leftovers:
            self.end()
        return report

    def _ready(self, runner: str) -> WorkerProcess:
        for _ in range(_STARTS):
            if self._worker is None:
                lock = Path(tempfile.gettempdir()) / f"needlebench-warm-{os.getuid() if os.name != 'nt' else 0}.lock"
                self._worker = WorkerProcess(runner, lock)
                self._worker.start()
            try:
                while not self._worker.ready(_TICK_S):
                    pass
                return self._worker
            except WorkerDiedError as death:
                last = death
                self.end()
        raise WorkerStartError(f"{platform.node()}: a process for insertions could not be started: {last}")

    def end(self) -> None:
        """Kill it, if it is there."""
        if self._worker is not None:
            self._worker.kill()
            self._worker = None

    def warm(self, runner: str) -> None:
        """Have it ready. Raises WorkerStartError."""
        self._ready(runner)


current = _Current()
_process = _Process()


def warm_up(runner: str) -> None:
    """Have the process of this worker ready before the first case comes. Raises WorkerStartError."""
    _thread.submit(_process.warm, runner).result()


def end() -> None:
    """End the process of this worker, and begin no other attempt."""
    _over.set()
    _process.end()
