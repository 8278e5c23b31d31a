"""Executes what the store has queued: one thread and one worker process a slot, one job at a time in each."""

from __future__ import annotations

import logging
import threading
from dataclasses import dataclass
from typing import TYPE_CHECKING

from service.engine.attempt_trace import kept_course
from service.engine.slot import Signals, Slot
from service.engine.watchdog import Watchdog

if TYPE_CHECKING:
    from service.engine.attempt_trace import Point
    from service.engine.metrics import Monitor
    from service.settings import Settings
    from service.store.job import Job
    from service.store.jobs import Store
    from service.store.uploads import Uploads

_log = logging.getLogger("needlebench")


@dataclass(frozen=True)
class SlotState:
    """One slot. job_id: that it runs. pid: of its warm worker. problem: why it takes no job."""

    name: str
    job_id: str | None
    pid: int | None
    problem: str | None


class Engine:
    """The slots of one data folder. `start` and `stop` once; `wake` when there is something new to do."""

    def __init__(self, settings: Settings, store: Store, monitor: Monitor, uploads: Uploads) -> None:
        self._store, self._data = store, settings.data
        self._stopping = threading.Event()
        self._draining = threading.Event()
        self._news = threading.Condition()
        signals = Signals(self._stopping, self._draining, self._news)

        def new_slot(number: int) -> Slot:
            return Slot(settings, store, signals, monitor, uploads, number)

        self._slots = [
            new_slot(number) for number in range(settings.workers)
        ]  # the watchdog replaces those that are lost
        self._watchdog = Watchdog(store, self._slots, new_slot, self._stopping, self.wake)

    def start(self) -> None:
        """Requeue what a dead server left running, then begin."""
        beats = {job.id: job.heartbeat_at for job in self._store.running()}
        for job in self._store.recover():
            silent_s = self._store.now - (beats.get(job.id) or self._store.now)
            told = "job %s was running when the server died, last heard of %.0f s ago: it is %s now"
            _log.warning(told, job.id, silent_s, job.state)
        for slot in self._slots:
            slot.start()
        self._watchdog.start()

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
        """The way of a running attempt so far, or of one that ended early; empty where nothing is known of it."""
        running = next((points for slot in self._slots if (points := slot.trace.points_of(job))), ())
        return running if running or not job.terminal else kept_course(self._data / job.folder)

    def begin_to_stop(self) -> None:
        """Running jobs go back into the queue, without a crash counted against them, and the workers end; all slots at
        once, and nobody is waited for."""
        self._stopping.set()
        self.wake()

    def stop(self) -> None:
        """As `begin_to_stop`; on return all of that is done."""
        self.begin_to_stop()
        if self._watchdog.is_alive():
            self._watchdog.join()
        for slot in self._slots:
            slot.join()

    def wake(self) -> None:
        """Wake idle slots."""
        with self._news:
            self._news.notify_all()

    def hear(self, job_id: str) -> None:
        """A job was changed: a slot that runs it asks whether it is to be cancelled. From any thread."""
        for slot in list(self._slots):
            slot.hear(job_id)

    @property
    def slot_states(self) -> list[SlotState]:
        """Every slot as it is now."""
        return [SlotState(slot.name, slot.job_id, slot.pid, slot.problem) for slot in list(self._slots)]

    @property
    def slots(self) -> int:
        """How many there are."""
        return len(self._slots)

    @property
    def ready(self) -> int:
        """How many slots have a warm worker and a thread that lives."""
        return sum(slot.pid is not None and slot.is_alive() for slot in self._slots)

    @property
    def alive(self) -> int:
        """How many slots have a thread that lives."""
        return sum(slot.is_alive() for slot in self._slots)

    @property
    def ended_threads(self) -> list[str]:
        """The threads that were started and live no more, by name: none, unless something is wrong."""
        watchdog = [self._watchdog.name] if self._watchdog.ident and not self._watchdog.is_alive() else []
        return [slot.name for slot in self._slots if slot.ended] + watchdog

    @property
    def silent_slots(self) -> list[str]:
        """The slots that have not got on for a minute, by name: none, unless something is wrong."""
        return self._watchdog.silent

    @property
    def problem(self) -> str | None:
        """Why a slot takes no jobs, if one does not."""
        return next((slot.problem for slot in self._slots if slot.problem), None)
