"""One slot of the engine: takes a job, runs its attempt in a worker process, stores its end, takes the next."""

from __future__ import annotations

import logging
import shutil
import threading
import time
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from service.engine.attempt_end import artefacts_of, last_report, named, outcome_of, spec_of
from service.engine.attempt_trace import AttemptTrace
from service.engine.attempt_watch import AttemptWatch, Ending, publish_progress
from service.engine.health_checks import disk_check
from service.files.disk import REFUSALS
from service.logs import ROOT
from service.store.errors import REFUSED_VALUES, DBAPIError, SQLAlchemyError
from service.store.job import FAILED, FINISHED, TRAINING, IllegalTransitionError, Job, Outcome
from service.store.uploads import Uploads, UploadsFullError
from service.worker import progress, training_job
from service.worker.attempt import describe
from service.worker.failures import described
from service.worker.process import WorkerDiedError, WorkerProcess

if TYPE_CHECKING:
    from collections.abc import Callable

    from service.engine.metrics import Monitor
    from service.settings import Settings
    from service.store.jobs import Store
    from service.worker.specs import AttemptReport

_log = logging.getLogger(ROOT)
_TICK_S = 0.2
_IDLE_S = 0.5
_ASK_EVERY = 25  # ticks: whether a job is to be cancelled is told by the store, and asked now and then
_FIRST_PAUSE_S, _LONGEST_PAUSE_S = 1.0, 30.0


@dataclass(frozen=True)
class Signals:
    """What all slots of an engine listen to: end at once, begin nothing new, there is something to do."""

    stopping: threading.Event
    draining: threading.Event
    news: threading.Condition


class Slot(threading.Thread):
    """A thread with a worker process. `problem` says why it takes no job, if it takes none; `job_id` is that of the job
    that it runs, `trace` the way of that so far. `beats` goes up as long as the thread gets on, whatever it does."""

    def __init__(
        self, settings: Settings, store: Store, signals: Signals, monitor: Monitor, uploads: Uploads, number: int
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
        self._abandoned = threading.Event()
        self._begun = 0.0
        self._heard = True  # somebody else changed the job since it was asked whether it is to be cancelled
        self._next: Job | None = None  # claimed together with the end of the one before
        self._unpublished: tuple[str, ...] = ()  # jobs whose last change may not be on the disk yet
        self._job: Job | None = None
        self.trace = AttemptTrace()
        self.beats = 0
        self.problem: str | None = None

    @property
    def pid(self) -> int | None:
        """Of the warm worker; None when there is none."""
        return self._worker.pid

    @property
    def job_id(self) -> str | None:
        """Of the job that it runs."""
        return None if (job := self._job) is None else job.id

    @property
    def attempts(self) -> set[tuple[str, int]]:
        """Those that it answers for, by job and number: the one that it runs, and the one that comes after it."""
        return {(job.id, job.attempt) for job in (self._job, self._next) if job is not None}

    @property
    def ended(self) -> bool:
        """Whether the thread is gone after it was started."""
        return self.ident is not None and not self.is_alive()

    def hear(self, job_id: str) -> None:
        """A job was changed; by somebody else, unless it is this thread that says so."""
        if job_id == self.job_id and threading.current_thread() is not self:
            self._heard = True

    def abandon(self) -> None:
        """Another slot takes its place: end its worker, and the thread itself should it get on again."""
        self._abandoned.set()
        threading.Thread(target=self._worker.kill, name=f"{self.name}-ending", daemon=True).start()

    def run(self) -> None:
        """Take one job after the other until the engine stops; pause longer and longer while that fails."""
        pause = _FIRST_PAUSE_S
        while not self._ends:
            self.beats += 1
            try:
                self._take_turn()
                pause = _FIRST_PAUSE_S
            except BaseException as error:  # noqa: BLE001  (whatever it is, the slot tries again)
                with suppress(BaseException):
                    self._recover_from(error, pause)
                self._stopping.wait(pause)
                pause = min(2 * pause, _LONGEST_PAUSE_S)
        self._worker.kill()

    def _recover_from(self, error: BaseException, pause: float) -> None:
        self.problem = described(error)
        _log.error("%s pauses for %g s: %s", self.name, pause, self.problem)
        if not isinstance(error, SQLAlchemyError):  # a database that refuses is no fault of the worker's
            self._worker.kill()

    @property
    def _ends(self) -> bool:
        return self._stopping.is_set() or self._abandoned.is_set()

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
                self._job, self._begun, self._heard = job, time.monotonic(), True
                self._monitor.started(job)
                _log.info("job %s: attempt %d begins", job.id, job.attempt, extra=named(job))
                self._run_attempt(job)
                job = self._job = self._next
                self._next = None
        finally:
            self._job = self._next = None

    @property
    def _takes_more(self) -> bool:
        return not (self._ends or self._draining.is_set() or self.problem)

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
        while not self._ends:
            self.beats += 1
            cold = self._worker.pid is None
            if self._worker.ready(_TICK_S):
                if cold:
                    self.problem = None
                return True
        return False

    def _run_attempt(self, job: Job) -> None:
        """One attempt of a claimed job, from an empty folder to its end in the store."""
        end = self._end_of_attempt(job)
        try:
            self._settle(job, end)
        except BaseException as error:  # noqa: BLE001  (what cannot be stored must not keep the job running)
            _log.error("job %s: its end cannot be stored: %s", job.id, described(error), extra=named(job))
            message = f"its end cannot be stored: {described(error)}"
            failed = Outcome(state=FAILED, error_kind="exception", error=message)
            self._settle(job, lambda: self._store.finish(job, failed))

    def _end_of_attempt(self, job: Job) -> Callable[[], Job]:
        """Run it; what brings its end into the store."""
        folder = self._settings.data / job.folder
        try:
            shutil.rmtree(folder, ignore_errors=True)
            runner = training_job.RUNNER if job.kind == TRAINING else self._settings.runner
            self._worker.send(runner, spec_of(job, self._settings.uploads), folder)
            self._publish()  # what came before, now that the worker is busy
            outcome = self._watch(job)
        except BaseException as loss:  # noqa: BLE001  (a claimed job must not stay behind without an owner)
            self._worker.kill()
            reason = str(loss) if isinstance(loss, WorkerDiedError) else described(loss)
            _log.warning("job %s, attempt %d: %s", job.id, job.attempt, reason, extra=named(job))
            return lambda: self._store.requeue(job, reason=reason, crashed=True)
        if outcome is None:
            if self._abandoned.is_set():
                self._worker.kill()
            return lambda: self._store.requeue(job, reason="the server was stopped", crashed=False)
        return lambda: self._finish(job, outcome)

    def _watch(self, job: Job) -> Outcome | None:
        """Until the attempt ends; None when the engine stops first. Raises WorkerDiedError."""
        folder = self._settings.data / job.folder
        watch = AttemptWatch(time.monotonic(), job.timeout_s, self._settings.limits.job_memory_mb)
        reported = progress.ProgressReader(folder)
        while not self._ends:
            self.beats += 1
            ended = self._worker.wait(_TICK_S)
            latest = reported.latest()
            if ended:
                return outcome_of(job, self._collect(job), latest)
            due, beats = watch.due(time.monotonic(), latest), watch.beats(time.monotonic())
            asks, self._heard = self._heard or self.beats % _ASK_EVERY == 0, False
            cancelled = publish_progress(self._store, self.trace, job, due, beats=beats, asks=asks)
            where, now_s = last_report(job, latest), time.monotonic()
            if ending := watch.ending(now_s, cancelled=cancelled, held_mb=self._worker.held_mb(), where=where):
                return self._cut_short(job, ending)
        return None

    def _collect(self, job: Job) -> AttemptReport:
        """What the attempt left; a process in which it left anything of its own ends."""
        report = self._worker.collect()
        if report.leftovers:
            _log.warning("job %s left %s", job.id, ", ".join(report.leftovers), extra=named(job))
            self._worker.kill()
        return report

    def _cut_short(self, job: Job, ending: Ending) -> Outcome:
        """End the process; what it had written so far is kept."""
        self._worker.kill()
        files = artefacts_of(job, describe(self._settings.data / job.folder))
        return Outcome(state=ending.state, error_kind=ending.error_kind, error=ending.error, artefacts=files)

    def _finish(self, job: Job, outcome: Outcome) -> Job:
        """The end of an attempt, and the next job if there is one and a worker for it.

        A model is kept before its job has finished: a kill between trains it again.
        """
        if job.kind == TRAINING and outcome.result is not None:
            made = self._settings.data / job.folder / training_job.MODEL
            try:
                self._uploads.keep_made(made, job, outcome.result["model"])
            except (UploadsFullError, OSError) as error:
                if getattr(error, "errno", None) in REFUSALS:
                    raise
                outcome = replace(outcome, state=FAILED, result=None, error_kind="disk", error=str(error))
        if outcome.state != FINISHED:
            self.trace.keep(job, self._settings.data / job.folder)
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

    def _settle(self, job: Job, action: Callable[[], Job]) -> None:
        """Bring the end of an attempt into the store, however long the disk is full.

        Raises what no waiting helps against.
        """
        pause = _FIRST_PAUSE_S
        while True:
            self.beats += 1
            try:
                now = action()
                self._monitor.ended(now.state, time.monotonic() - self._begun)
                _log.info("job %s is %s", job.id, now.state, extra={**named(job), "state": now.state})
                break
            except IllegalTransitionError as error:
                _log.warning("%s", error, extra=named(job))
                break
            except (DBAPIError, OSError) as error:
                if isinstance(error, REFUSED_VALUES):
                    raise
                _log.error("the end of a job cannot be stored, next try in %g s: %s", pause, error)
                if self._stopping.wait(pause) or self._abandoned.is_set():
                    return  # the next start finds it running and requeues it
                pause = min(2 * pause, _LONGEST_PAUSE_S)
        if self._next is None:
            self._publish()
        with self._news:
            self._news.notify_all()
