"""One slot of the engine: takes a job, sees it through in its worker process, takes the next."""

from __future__ import annotations

import logging
import shutil
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, wait
from dataclasses import dataclass, replace
from typing import Any

from sqlalchemy.exc import DBAPIError, SQLAlchemyError

from service.engine.attempt_trace import Course
from service.engine.health_checks import disk_check
from service.engine.metrics import Monitor
from service.files.disk import REFUSALS
from service.logs import ROOT
from service.settings import Settings
from service.store.job import (
    CANCELLED,
    FAILED,
    SUCCEEDED,
    TIMED_OUT,
    TRAINING,
    Artefact,
    IllegalTransition,
    Job,
    Outcome,
)
from service.store.jobs import Store
from service.store.uploads import Uploads, UploadsFull
from service.worker import attempt as worker
from service.worker import process as pool
from service.worker import progress
from service.worker import training_job as train_job
from service.worker.memory import resident_mb

_log = logging.getLogger(ROOT)
_TICK_S = 0.2
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
        monitor: Monitor,
        uploads: Uploads,
        number: int,
    ) -> None:
        super().__init__(name=f"slot-{number}", daemon=True)
        self._settings = settings
        self._store = store
        self._uploads = uploads
        self._stopping = signals.stopping
        self._draining = signals.draining
        self._monitor = monitor
        self._news = signals.news
        self._worker: pool.Worker | None = None
        self._begun = 0.0
        self._next: Job | None = None  # claimed together with the end of the one before
        self._untold: tuple[str, ...] = ()  # jobs whose last change may not be on the disk yet
        self._started_before = False
        self.course = Course()
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
                if not isinstance(error, SQLAlchemyError):  # a database that refuses is no fault of the worker's
                    self._drop_worker()
                self._stopping.wait(pause)
                pause = min(2 * pause, _LONGEST_PAUSE_S)
        self._drop_worker()

    def _round(self) -> None:
        """A warm worker; a job, if there is one; its end."""
        workman = self._warm_worker()
        if workman is None:
            return
        self._look_at_disk()
        job = self._store.claim() if self._takes_more else None
        if job is None:
            with self._news:
                self._news.wait(_IDLE_S)
        try:
            while job is not None:
                self.job_id, self._begun = job.id, time.monotonic()
                self._monitor.started(job)
                _log.info("job %s: attempt %d begins", job.id, job.attempt, extra=_named(job))
                self._see_through(workman, job)
                job, self._next = self._next, None
        finally:
            self.job_id = None

    @property
    def _takes_more(self) -> bool:
        return not (self._stopping.is_set() or self._draining.is_set() or self.problem)

    def _look_at_disk(self) -> None:
        """Have a problem while there is no room: each job that is begun would fail for want of it."""
        check = disk_check(self._settings.data, self._settings.minimum_free_bytes)
        problem = f"{check.found}; {check.advice}" if check.level == "bad" else None
        if (problem is None) != (self.problem is None):
            _log.warning("%s: %s", self.name, problem or "there is room on the disk again")
        self.problem = problem

    def _warm_worker(self) -> pool.Worker | None:
        """The worker, started and warmed if need be; None when the engine stops meanwhile."""
        if self._worker is not None and self._worker.alive:
            return self._worker
        self._drop_worker()
        if self._started_before:
            self._monitor.restarted()
        self._started_before = True
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
            spec = {**(job.spec or {}), "job_id": job.id, "uploads": str(self._settings.uploads)}
            runner = train_job.RUNNER if job.kind == TRAINING else self._settings.runner
            future = workman.call(worker.execute, runner, spec, str(folder))
            self._publish()  # what came before, now that the worker is busy
            outcome = self._watch(workman, job, future)
        except Exception as loss:  # whatever it is, a claimed job must not stay behind without an owner
            self._drop_worker()
            reason = str(loss) if isinstance(loss, pool.Lost) else f"{type(loss).__name__}: {loss}"
            _log.warning("job %s, attempt %d: %s", job.id, job.attempt, reason, extra=_named(job))
            self._settle(job, lambda: self._store.requeue(job, reason=reason, crashed=True))
            return
        if outcome is None:
            self._drop_worker()
            self._settle(job, lambda: self._store.requeue(job, reason="the server was stopped", crashed=False))
        else:
            self._settle(job, lambda: self._finish(job, outcome))

    def _watch(self, workman: pool.Worker, job: Job, future: Future[Any]) -> Outcome | None:
        """Until the attempt ends; None when the engine stops first. Raises Lost when the process died."""
        folder = self._settings.data / job.folder
        deadline = time.monotonic() + job.timeout_s
        known: dict[str, Any] | None = None
        told = time.monotonic()  # who looks within the first half second finds it running, which is enough
        while not self._stopping.is_set():
            done = bool(wait([future], timeout=_TICK_S).done)
            now = progress.read(folder)
            if done:
                return self._outcome(job, pool.answer(future), now)
            due = now != known and time.monotonic() - told >= progress.INTERVAL_S
            cancelled = self._cancelled(job, now if due else None)
            if not workman.alive:
                raise pool.Lost("its worker process died")
            if cancelled:
                return self._cut_short(job, CANCELLED)
            if time.monotonic() > deadline:
                message = f"it did not end within timeout_s = {job.timeout_s:g}"
                return self._cut_short(job, TIMED_OUT, kind="timed_out", message=message)
            if (greed := self._greed()) is not None:
                return self._cut_short(job, FAILED, kind="out_of_memory", message=greed)
            if due:
                known, told = now, time.monotonic()
        return None

    def _greed(self) -> str | None:
        """What to say when the worker holds more memory than a job may."""
        held, most = resident_mb(self.pid or 0), self._settings.limits.job_memory_mb
        return f"it held {held:.0f} MB, at most {most} are allowed" if held is not None and held > most else None

    def _cancelled(self, job: Job, news: dict[str, Any] | None) -> bool:
        """Hand the progress on, if there is any; whether somebody wants the job to stop."""
        try:
            if news is not None:
                self.course.add(job, news)
                self._store.beat(job, news)
            return self._store.cancel_requested(job.id)
        except SQLAlchemyError as error:  # a full disk, a locked database: the job goes on, the next tick tries again
            _log.warning("job %s: %s", job.id, error)
            return False

    def _outcome(self, job: Job, answer: dict[str, Any], last: dict[str, Any] | None) -> Outcome:
        left = {"cpu_s": answer["cpu_s"], "max_rss_mb": answer["max_rss_mb"], "progress": last}
        files = self._files(job, answer["artefacts"])
        if answer["error"] is not None:
            kind, message = answer["error"]["kind"], answer["error"]["message"]
            return Outcome(state=FAILED, error_kind=kind, error=message, artefacts=files, **left)
        return Outcome(state=SUCCEEDED, result=answer["result"], artefacts=files, **left)

    def _cut_short(self, job: Job, state: str, *, kind: str | None = None, message: str | None = None) -> Outcome:
        """End the process; what it had written so far is kept."""
        self._drop_worker()
        files = self._files(job, worker.describe(self._settings.data / job.folder))
        return Outcome(state=state, error_kind=kind, error=message, artefacts=files)

    def _finish(self, job: Job, outcome: Outcome) -> Job:
        """The end of an attempt, and the next job if there is one and a worker for it.

        A model is kept before its job has succeeded: a kill between trains it again.
        """
        if job.kind == TRAINING and outcome.result is not None:
            made = self._settings.data / job.folder / train_job.MODEL
            try:
                self._uploads.keep_made(made, job, outcome.result["model"])
            except (UploadsFull, OSError) as error:
                if getattr(error, "errno", None) in REFUSALS:
                    raise
                outcome = replace(outcome, state=FAILED, result=None, error_kind="disk", error=str(error))
        self._look_at_disk()
        if not (self._takes_more and self._worker is not None and self._worker.alive):
            return self._store.finish(job, outcome)
        done, self._next = self._store.exchange(job, outcome)
        self._untold = (done.id,) if self._next is None else (done.id, self._next.id)
        return done

    def _publish(self) -> None:
        """Tell of the end of the job before and the beginning of this one, once both are on the disk."""
        if self._untold:
            told, self._untold = self._untold, ()
            try:
                self._store.publish(*told)
            except OSError as error:  # the next commit tries again
                _log.error("the end of a job is not on the disk yet: %s", error)

    def _files(self, job: Job, described: list[dict[str, Any]]) -> tuple[Artefact, ...]:
        return tuple(Artefact(**file, path=f"{job.folder}/{file['name']}") for file in described)

    def _settle(self, job: Job, action: Callable[[], Job]) -> None:
        """Bring the end of an attempt into the store, however long the disk is full."""
        pause = _FIRST_PAUSE_S
        while True:
            try:
                now = action()
                self._monitor.ended(now.state, time.monotonic() - self._begun)
                _log.info("job %s is %s", job.id, now.state, extra={**_named(job), "state": now.state})
                break
            except IllegalTransition as error:
                _log.warning("%s", error, extra=_named(job))
                break
            except (DBAPIError, OSError) as error:
                _log.error("the end of a job cannot be stored, next try in %g s: %s", pause, error)
                if self._stopping.wait(pause):
                    return  # the next start finds it running and requeues it
                pause = min(2 * pause, _LONGEST_PAUSE_S)
        if self._next is None:
            self._publish()
        with self._news:
            self._news.notify_all()


def _named(job: Job) -> dict[str, Any]:
    """The fields of a log line that say which job it is about."""
    return {"job": job.id, "attempt": job.attempt}
