"""One slot of the engine: takes a job, runs its attempt in a worker process, stores its end, takes the next."""

from __future__ import annotations

import logging
import shutil
import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

from service.engine.attempt_trace import AttemptTrace
from service.engine.attempt_watch import AttemptWatch, Ending, publish_progress
from service.engine.health_checks import disk_check
from service.engine.metrics import Monitor
from service.files.disk import REFUSALS
from service.logs import ROOT
from service.settings import Settings
from service.store.errors import DBAPIError, SQLAlchemyError
from service.store.job import FAILED, SUCCEEDED, TRAINING, Artefact, IllegalTransitionError, Job, Outcome
from service.store.jobs import Store
from service.store.uploads import Uploads, UploadsFullError
from service.worker import progress, training_job
from service.worker.attempt import describe
from service.worker.memory import resident_mb
from service.worker.process import WorkerDiedError, WorkerProcess
from service.worker.specs import AttemptReport, InsertionSpec, TrainingSpec

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
    """A thread with a worker process. `problem` says why it takes no job, if it takes none; `job_id` is that of the job
    that it runs, `trace` the way of that so far."""

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
        self._worker = WorkerProcess(settings.runner, settings.data / "warm.lock")
        self._begun = 0.0
        self._next: Job | None = None  # claimed together with the end of the one before
        self._unpublished: tuple[str, ...] = ()  # jobs whose last change may not be on the disk yet
        self.trace = AttemptTrace()
        self.job_id: str | None = None
        self.problem: str | None = None

    @property
    def pid(self) -> int | None:
        """Of the warm worker; None when there is none."""
        return self._worker.pid

    def run(self) -> None:
        """Take one job after the other until the engine stops; pause longer and longer while that fails."""
        pause = _FIRST_PAUSE_S
        while not self._stopping.is_set():
            try:
                self._take_turn()
                pause = _FIRST_PAUSE_S
            except Exception as error:
                self.problem = f"{type(error).__name__}: {error}"
                _log.error("%s pauses for %g s: %s", self.name, pause, self.problem)
                if not isinstance(error, SQLAlchemyError):  # a database that refuses is no fault of the worker's
                    self._worker.kill()
                self._stopping.wait(pause)
                pause = min(2 * pause, _LONGEST_PAUSE_S)
        self._worker.kill()

    def _take_turn(self) -> None:
        """A warm worker; a job, if there is one; its end."""
        if not self._worker_ready():
            return
        self._check_disk()
        job = self._store.claim() if self._takes_more else None
        if job is None:
            with self._news:
                self._news.wait(_IDLE_S)
        try:
            while job is not None:
                self.job_id, self._begun = job.id, time.monotonic()
                self._monitor.started(job)
                _log.info("job %s: attempt %d begins", job.id, job.attempt, extra=_named(job))
                self._run_attempt(job)
                job, self._next = self._next, None
        finally:
            self.job_id = None

    @property
    def _takes_more(self) -> bool:
        return not (self._stopping.is_set() or self._draining.is_set() or self.problem)

    def _check_disk(self) -> None:
        """Have a problem while there is no room: each job that is begun would fail for want of it."""
        check = disk_check(self._settings.data, self._settings.minimum_free_bytes)
        problem = f"{check.found}; {check.advice}" if check.level == "bad" else None
        if (problem is None) != (self.problem is None):
            _log.warning("%s: %s", self.name, problem or "there is room on the disk again")
        self.problem = problem

    def _worker_ready(self) -> bool:
        """Whether the worker is warm, started first if need be; False when the engine stops meanwhile."""
        if not self._worker.alive:
            if self._worker.starts:
                self._monitor.restarted()
            self._worker.start()
        while not self._stopping.is_set():
            cold = self._worker.pid is None
            if self._worker.ready(_TICK_S):
                if cold:
                    self.problem = None
                return True
        return False

    def _run_attempt(self, job: Job) -> None:
        """One attempt of a claimed job, from an empty folder to its end in the store."""
        folder = self._settings.data / job.folder
        try:
            shutil.rmtree(folder, ignore_errors=True)
            runner = training_job.RUNNER if job.kind == TRAINING else self._settings.runner
            self._worker.send(runner, self._spec(job), folder)
            self._publish()  # what came before, now that the worker is busy
            outcome = self._watch(job)
        except Exception as loss:
            self._worker.kill()
            reason = str(loss) if isinstance(loss, WorkerDiedError) else f"{type(loss).__name__}: {loss}"
            _log.warning("job %s, attempt %d: %s", job.id, job.attempt, reason, extra=_named(job))
            self._settle(job, lambda: self._store.requeue(job, reason=reason, crashed=True))
            return
        if outcome is None:
            self._worker.kill()
            self._settle(job, lambda: self._store.requeue(job, reason="the server was stopped", crashed=False))
        else:
            self._settle(job, lambda: self._finish(job, outcome))

    def _spec(self, job: Job) -> InsertionSpec | TrainingSpec:
        given, files = job.spec or {}, self._settings.uploads
        if job.kind == TRAINING:
            return TrainingSpec(job_id=job.id, training=given["training"], files=files)
        return InsertionSpec(job_id=job.id, scenario=given["scenario"], files=files)

    def _watch(self, job: Job) -> Outcome | None:
        """Until the attempt ends; None when the engine stops first. Raises WorkerDiedError."""
        folder = self._settings.data / job.folder
        watch = AttemptWatch(time.monotonic(), job.timeout_s, self._settings.limits.job_memory_mb)
        while not self._stopping.is_set():
            ended = self._worker.wait(_TICK_S)
            latest = progress.read(folder)
            if ended:
                return self._outcome(job, self._worker.collect(), latest)
            due = watch.due(time.monotonic(), latest)
            cancelled = publish_progress(self._store, self.trace, job, due)
            held_mb = resident_mb(self.pid or 0)
            if (ending := watch.ending(time.monotonic(), cancelled=cancelled, held_mb=held_mb)) is not None:
                return self._cut_short(job, ending)
        return None

    def _outcome(self, job: Job, report: AttemptReport, last: dict[str, Any] | None) -> Outcome:
        failed = report.error is not None
        return Outcome(
            state=FAILED if failed else SUCCEEDED,
            result=None if failed else report.result,
            error_kind=report.error_kind,
            error=report.error,
            artefacts=self._files(job, report.artefacts),
            cpu_s=report.cpu_s,
            max_rss_mb=report.max_rss_mb,
            progress=last,
        )

    def _cut_short(self, job: Job, ending: Ending) -> Outcome:
        """End the process; what it had written so far is kept."""
        self._worker.kill()
        files = self._files(job, describe(self._settings.data / job.folder))
        return Outcome(state=ending.state, error_kind=ending.error_kind, error=ending.error, artefacts=files)

    def _finish(self, job: Job, outcome: Outcome) -> Job:
        """The end of an attempt, and the next job if there is one and a worker for it.

        A model is kept before its job has succeeded: a kill between trains it again.
        """
        if job.kind == TRAINING and outcome.result is not None:
            made = self._settings.data / job.folder / training_job.MODEL
            try:
                self._uploads.keep_made(made, job, outcome.result["model"])
            except (UploadsFullError, OSError) as error:
                if getattr(error, "errno", None) in REFUSALS:
                    raise
                outcome = replace(outcome, state=FAILED, result=None, error_kind="disk", error=str(error))
        self._check_disk()
        if not (self._takes_more and self._worker.alive):
            return self._store.finish(job, outcome)
        done, self._next = self._store.exchange(job, outcome)
        self._unpublished = (done.id,) if self._next is None else (done.id, self._next.id)
        return done

    def _publish(self) -> None:
        """Announce the end of the previous job and the beginning of this one, once both are on the disk."""
        if self._unpublished:
            job_ids, self._unpublished = self._unpublished, ()
            try:
                self._store.publish(*job_ids)
            except OSError as error:  # the next commit tries again
                _log.error("the end of a job is not on the disk yet: %s", error)

    def _files(self, job: Job, described: Iterable[dict[str, Any]]) -> tuple[Artefact, ...]:
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
            except IllegalTransitionError as error:
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
