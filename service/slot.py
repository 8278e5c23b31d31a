"""One slot of the engine: takes a job, sees it through in its worker process, takes the next."""

from __future__ import annotations

import logging
import math
import shutil
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, wait
from dataclasses import dataclass
from typing import Any

from sqlalchemy.exc import SQLAlchemyError

from service import pool, progress, worker
from service.jobs import CANCELLED, FAILED, SUCCEEDED, TIMED_OUT, Artefact, IllegalTransition, Job, Outcome
from service.settings import Settings
from service.store import Store

_log = logging.getLogger("needlebench")
_TICK_S = 0.1
_IDLE_S = 0.5
_FIRST_PAUSE_S, _LONGEST_PAUSE_S = 1.0, 30.0


@dataclass(frozen=True)
class Signals:
    """What all slots of an engine listen to: end at once, begin nothing new, there is something to do."""

    stopping: threading.Event
    draining: threading.Event
    news: threading.Condition


class Slot(threading.Thread):
    """A thread with a worker process. `pid` is that of a warm worker, `problem` says why there is none; `job_id` is
    that of the job it sees through.

    The thread that starts a worker must outlive it: Linux tells a child of the death of its parent's thread.
    """

    def __init__(
        self,
        settings: Settings,
        store: Store,
        signals: Signals,
        number: int,
    ) -> None:
        super().__init__(name=f"slot-{number}", daemon=True)
        self._settings = settings
        self._store = store
        self._stopping = signals.stopping
        self._draining = signals.draining
        self._news = signals.news
        self._worker: pool.Worker | None = None
        self.pid: int | None = None
        self.job_id: str | None = None
        self.problem: str | None = None

    def run(self) -> None:
        pause = _FIRST_PAUSE_S
        while not self._stopping.is_set():
            try:
                self._round()
                pause = _FIRST_PAUSE_S
            except Exception as error:
                self.problem = f"{type(error).__name__}: {error}"
                _log.error("%s pauses for %g s: %s", self.name, pause, self.problem)
                self._drop_worker()
                self._stopping.wait(pause)
                pause = min(2 * pause, _LONGEST_PAUSE_S)
        self._drop_worker()

    def _round(self) -> None:
        """A warm worker; a job, if there is one; its end."""
        workman = self._warm_worker()
        if workman is None:
            return
        job = None if self._draining.is_set() else self._store.claim()
        if job is not None:
            self.job_id = job.id
            try:
                self._see_through(workman, job)
            finally:
                self.job_id = None
            return
        with self._news:
            self._news.wait(_IDLE_S)

    def _warm_worker(self) -> pool.Worker | None:
        """The worker, started and warmed if need be; None when the engine stops meanwhile."""
        if self._worker is not None and self._worker.alive:
            return self._worker
        self._drop_worker()
        self._worker = pool.Worker()
        warming = self._worker.call(pool.warm, self._settings.runner, str(self._settings.data / "warm.lock"))
        while not self._stopping.is_set():
            if wait([warming], timeout=_TICK_S).done:
                self.pid, self.problem = pool.answer(warming), None
                return self._worker
            if not self._worker.alive:
                raise pool.Lost("the worker died while it was starting")
        return None

    def _drop_worker(self) -> None:
        self.pid = None
        workman, self._worker = self._worker, None
        if workman is not None:
            workman.stop()

    def _see_through(self, workman: pool.Worker, job: Job) -> None:
        folder = self._settings.data / job.folder
        try:
            shutil.rmtree(folder, ignore_errors=True)
            spec = {**(job.spec or {}), "job_id": job.id}
            future = workman.call(worker.execute, self._settings.runner, spec, str(folder))
            outcome = self._watch(workman, job, future)
        except pool.Lost as loss:
            self._drop_worker()
            reason = str(loss)
            self._settle(lambda: self._store.requeue(job, reason=reason, crashed=True))
            return
        if outcome is None:
            self._drop_worker()
            self._settle(lambda: self._store.requeue(job, reason="the server was stopped", crashed=False))
        else:
            self._settle(lambda: self._store.finish(job, outcome))

    def _watch(self, workman: pool.Worker, job: Job, future: Future[Any]) -> Outcome | None:
        """Until the attempt ends; None when the engine stops first. Raises Lost when the process died."""
        folder = self._settings.data / job.folder
        deadline = time.monotonic() + job.timeout_s
        known: dict[str, Any] | None = None
        told = -math.inf
        while not self._stopping.is_set():
            done = bool(wait([future], timeout=_TICK_S).done)
            now = progress.read(folder)
            due = now != known and (done or time.monotonic() - told >= progress.INTERVAL_S)
            cancelled = self._cancelled(job, now if due else None)
            if done:
                return self._outcome(job, pool.answer(future))
            if not workman.alive:
                raise pool.Lost("its worker process died")
            if cancelled:
                return self._cut_short(job, CANCELLED, None)
            if time.monotonic() > deadline:
                return self._cut_short(job, TIMED_OUT, f"it did not end within timeout_s = {job.timeout_s:g}")
            if due:
                known, told = now, time.monotonic()
        return None

    def _cancelled(self, job: Job, news: dict[str, Any] | None) -> bool:
        """Hand the progress on, if there is any; whether somebody wants the job to stop."""
        try:
            if news is not None:
                self._store.beat(job, news)
            return self._store.glance(job.id).cancel_requested
        except SQLAlchemyError as error:  # a full disk, a locked database: the job goes on, the next tick tries again
            _log.warning("job %s: %s", job.id, error)
            return False

    def _outcome(self, job: Job, answer: dict[str, Any]) -> Outcome:
        left = {"cpu_s": answer["cpu_s"], "max_rss_mb": answer["max_rss_mb"]}
        files = self._files(job, answer["artefacts"])
        if answer["error"] is not None:
            kind, message = answer["error"]["kind"], answer["error"]["message"]
            return Outcome(state=FAILED, error_kind=kind, error=message, artefacts=files, **left)
        return Outcome(state=SUCCEEDED, result=answer["result"], artefacts=files, **left)

    def _cut_short(self, job: Job, state: str, message: str | None) -> Outcome:
        """End the process; what it had written so far is kept."""
        self._drop_worker()
        files = self._files(job, worker.describe(self._settings.data / job.folder))
        kind = "timed_out" if state == TIMED_OUT else None
        return Outcome(state=state, error_kind=kind, error=message, artefacts=files)

    def _files(self, job: Job, described: list[dict[str, Any]]) -> tuple[Artefact, ...]:
        return tuple(Artefact(**file, path=f"{job.folder}/{file['name']}") for file in described)

    def _settle(self, action: Callable[[], object]) -> None:
        """Bring the end of an attempt into the store, however long the disk is full."""
        pause = _FIRST_PAUSE_S
        while True:
            try:
                action()
                break
            except IllegalTransition as error:
                _log.warning("%s", error)
                break
            except SQLAlchemyError as error:
                _log.error("the end of a job cannot be stored, next try in %g s: %s", pause, error)
                if self._stopping.wait(pause):
                    return  # the next start finds it running and requeues it
                pause = min(2 * pause, _LONGEST_PAUSE_S)
        with self._news:
            self._news.notify_all()
