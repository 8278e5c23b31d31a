"""Executes what the store has queued: one thread and one worker process a slot, one job at a time in each."""

from __future__ import annotations

import logging
import threading

from service.engine.attempt_trace import Point
from service.engine.metrics import Monitor
from service.engine.slot import Signals, Slot
from service.settings import Settings
from service.store.job import Job
from service.store.jobs import Store
from service.store.uploads import Uploads

_log = logging.getLogger("needlebench")


class Engine:
    """The slots of one data folder. `start` and `stop` once; `wake` when there is something new to do."""

    def __init__(self, settings: Settings, store: Store, monitor: Monitor, uploads: Uploads) -> None:
        self._store = store
        self._stopping = threading.Event()
        self._draining = threading.Event()
        self._news = threading.Condition()
        self._slots = [
            Slot(settings, store, Signals(self._stopping, self._draining, self._news), monitor, uploads, number)
            for number in range(settings.workers)
        ]

    def start(self) -> None:
        """Requeue what a dead server left running, then begin."""
        for job in self._store.recover():
            _log.warning("job %s was running when the server died: it is %s now", job.id, job.state)
        for slot in self._slots:
            slot.start()

    def drain(self) -> None:
        """Start nothing new; running jobs may end."""
        self._draining.set()
        self.wake()

    @property
    def draining(self) -> bool:
        """Whether it begins nothing new any more."""
        return self._draining.is_set()

    @property
    def busy(self) -> int:
        """How many slots run a job."""
        return sum(slot.job_id is not None for slot in self._slots)

    def trace(self, job: Job) -> tuple[Point, ...]:
        """The way of a running attempt so far; empty for any other."""
        return next((points for slot in self._slots if (points := slot.trace.points_of(job))), ())

    def stop(self) -> None:
        """End the workers; running jobs go back into the queue, without a crash counted against them."""
        self._stopping.set()
        self.wake()
        for slot in self._slots:
            slot.join()

    def wake(self) -> None:
        """Wake idle slots."""
        with self._news:
            self._news.notify_all()

    @property
    def slots(self) -> int:
        """How many there are."""
        return len(self._slots)

    @property
    def ready(self) -> int:
        """How many slots have a warm worker."""
        return sum(slot.pid is not None for slot in self._slots)

    @property
    def problem(self) -> str | None:
        """Why a slot takes no jobs, if one does not."""
        return next((slot.problem for slot in self._slots if slot.problem), None)
