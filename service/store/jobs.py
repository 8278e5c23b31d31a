"""Jobs in the database: the only door through which a job changes its state, one transaction each."""

from __future__ import annotations

import secrets
import time
from typing import TYPE_CHECKING, Any

from sqlalchemy import Engine, delete, insert

from service.settings import Limits
from service.store import schema
from service.store.job import (
    CANCELLED,
    CRASHED,
    FAILED,
    INSERTION,
    LOWEST_PRIORITY,
    MAXIMUM_CRASHES,
    MAXIMUM_DEATHS,
    QUEUED,
    REQUEUED,
    RUNNING,
    SUSPECT_DEATHS,
    IllegalTransitionError,
    InputGoneError,
    Job,
    JobPinnedError,
    Outcome,
)
from service.store.job_notes import JobNotes
from service.store.job_queries import (
    BEAT,
    BRIEF,
    EVENT,
    JOB,
    NEW,
    OF_ATTEMPT,
    check_room,
    find_original,
    read,
    to_job,
)
from service.store.transitions import attempt_key, end_data
from service.store.turns import lane_of
from service.store.upload_references import check_uploads, missing

if TYPE_CHECKING:
    from collections.abc import Callable, Collection


class Store(JobNotes):
    """Jobs, artefacts and events. `now` gives UTC seconds since 1970; `listen` says who hears of each changed job."""

    def __init__(
        self,
        engine: Engine,
        *,
        now: Callable[[], float] = time.time,
        limits: Limits | None = None,
    ) -> None:
        super().__init__(engine, now=now)
        self._limits = limits or Limits()

    @property
    def limits(self) -> Limits:
        """What is refused."""
        return self._limits

    # -- submitting

    def submit(  # noqa: PLR0913  (one row of the job table, by keyword)
        self,
        *,
        name: str,
        spec: dict[str, Any],
        spec_hash: str,
        steps: int,
        priority: int,
        timeout_s: float,
        key: str | None = None,
        request_hash: str = "",
        owner: str | None = None,
        uploads: Collection[str] = (),
        kind: str = INSERTION,
    ) -> Job:
        """A new queued job; the original job when the idempotency key was seen.

        owner: the API key that asked. uploads: ids of those that the job will read.
        Raises KeyReusedError, QueueFullError, UploadGoneError.
        """
        with self._write() as connection:
            known = find_original(connection, key, request_hash)
            if known is not None:
                return known
            check_room(connection, owner, self._limits)
            check_uploads(connection, uploads, spec)
            new = {
                "id": secrets.token_hex(8),
                "name": name,
                "spec": spec,
                "spec_hash": spec_hash,
                "steps": steps,
                "state": QUEUED,
                "priority": priority,
                "timeout_s": timeout_s,
                "attempt": 0,
                "crashes": 0,
                "cancel_requested": False,
                "pinned": False,
                "created_at": self._now(),
                "version": 1,
                "owner": owner,
                "kind": kind,
                "lane": lane_of(owner),
            }
            job = to_job(connection.execute(NEW, new).one())
            for upload_id in uploads:
                used = {"job_id": job.id, "upload_id": upload_id}
                connection.execute(insert(schema.job_upload).values(used))
            if key is not None:
                seen = {"key": key, "request_hash": request_hash, "job_id": job.id, "created_at": self._now()}
                connection.execute(insert(schema.idempotency).values(seen))
            self._log(connection, job, QUEUED, {"priority": priority, "timeout_s": timeout_s})
        self.notify(job.id)
        return job

    # -- the life of a job

    def claim(self) -> Job | None:
        """Take the next queued job, highest priority first, then by turns over keys and campaigns, then the oldest;
        None when there is none.

        A power cut may put it back into the queue, as if nobody had taken it.
        """
        with self._write(lazy=True) as connection:
            job = self._take(connection)
            if job is None:
                return None
            self._log(connection, job, "started")
        self.notify(job.id)
        return job

    def beat(self, job: Job, progress: dict[str, Any] | None = None) -> None:
        """The attempt is looked after, and its progress if there is news; nothing happens when it is not the current
        one. Without news nobody is told."""
        with self._write(lazy=True) as connection:
            if progress is None:
                connection.execute(BEAT, {"of_id": job.id, "of_attempt": job.attempt, "now": self._now()})
                return
            values = {"progress": progress, "heartbeat_at": self._now()}
            changed = connection.execute(OF_ATTEMPT, {**attempt_key(job), **values}).rowcount
        if changed:
            self.notify(job.id)

    def finish(self, job: Job, outcome: Outcome) -> Job:
        """End the running attempt `job`. Raises IllegalTransitionError when it is not the current one."""
        with self._write() as connection:
            done = self._end(connection, job, outcome)
            self._log(connection, done, outcome.state, end_data(done))
        self.notify(job.id)
        return done

    def exchange(self, job: Job, outcome: Outcome) -> tuple[Job, Job | None]:
        """`finish` and `claim` in one transaction: the job that ended, and the next or None.

        The worker can begin with the next one while the disk is still busy: only `publish` waits for it, and only then
        anybody is told.
        """
        with self._write(lazy=True) as connection:
            done = self._end(connection, job, outcome)
            taken = self._take(connection)
            rows = [self._entry(done, outcome.state, end_data(done))]
            if taken is not None:
                rows.append(self._entry(taken, "started"))
            connection.execute(EVENT, rows)
        return done, taken

    def publish(self, *job_ids: str) -> None:
        """Bring what was committed to the disk and tell who waits for these jobs. Raises OSError."""
        try:
            self._sync()
        finally:
            self.notify(*job_ids)

    def requeue(self, job: Job, *, reason: str, crashed: bool) -> Job:
        """Put the running attempt `job` back into the queue; after three crashes it has failed instead."""
        crashes = job.crashes + crashed
        give_up = crashes >= MAXIMUM_CRASHES
        return self._requeue_or_fail(
            job, reason, CRASHED if crashed else REQUEUED, {"crashes": crashes}, give_up=give_up
        )

    def recover(self) -> list[Job]:
        """At start: jobs that were running when the server died go back into the queue.

        The death of the server is no fault of theirs, unless it happens again and again: from the third time on such a
        job begins when nothing else is queued, after the tenth it has failed.
        """
        return [self._recover(job) for job in self.running()]

    def _recover(self, job: Job) -> Job:
        deaths = self.server_deaths(job) + 1
        suspect = deaths >= SUSPECT_DEATHS
        values: dict[str, Any] = {"priority": min(job.priority, LOWEST_PRIORITY)} if suspect else {}
        return self._requeue_or_fail(job, "the server died", CRASHED, values, give_up=deaths >= MAXIMUM_DEATHS)

    def _requeue_or_fail(self, job: Job, reason: str, kind: str, values: dict[str, Any], *, give_up: bool) -> Job:
        """Another attempt of the running `job`, unless it was cancelled; give_up: it has failed instead."""
        with self._write() as connection:
            if read(connection, job.id, BRIEF).cancel_requested:
                moved = self._move(connection, job, CANCELLED, {**values, "finished_at": self._now()})
                self._log(connection, moved, CANCELLED)
            elif give_up:
                message = f"gave up after {job.attempt} attempts; the last one ended so: {reason}"
                error = {"error_kind": "worker_died", "error": message}
                moved = self._move(connection, job, FAILED, {**values, **error, "finished_at": self._now()})
                self._log(connection, moved, FAILED, {**values, **error})
            else:
                moved = self._move(connection, job, QUEUED, {**values, "heartbeat_at": None, "progress": None})
                told = {"priority": moved.priority} if moved.priority != job.priority else {}
                self._log(connection, moved, kind, {"reason": reason, **told})
        self.notify(job.id)
        return moved

    def retry(self, job_id: str) -> Job:
        """Queue a job again that failed, was cancelled or ran out of time. Raises IllegalTransitionError.

        The attempts go on counting; what the last one left is no longer listed. Raises InputGoneError, too.
        """
        fresh: dict[str, Any] = dict.fromkeys(
            ("progress", "outcome", "metrics", "result", "error_kind", "error", "cpu_s", "max_rss_mb", "heartbeat_at")
        )
        fresh |= {"crashes": 0, "cancel_requested": False, "started_at": None, "finished_at": None}
        with self._write() as connection:
            job = read(connection, job_id)
            if not job.terminal:
                raise IllegalTransitionError(job_id, job.state, QUEUED)
            if problems := missing(connection, job.spec or {}):
                raise InputGoneError(job.id, problems)
            moved = self._move(connection, job, QUEUED, fresh)
            connection.execute(delete(schema.artefact).where(schema.artefact.c.job_id == job_id))
            self._log(connection, moved, QUEUED, {"retry_of": job.state, "error": job.error})
        self.notify(job_id)
        return moved

    def cancel(self, job_id: str) -> Job:
        """Cancel a queued job, ask a running one to stop. Idempotent. Raises IllegalTransitionError."""
        with self._write() as connection:
            job = read(connection, job_id)
            if job.state == CANCELLED or (job.state == RUNNING and job.cancel_requested):
                return job
            if job.state == QUEUED:
                changed = self._move(connection, job, CANCELLED, {"finished_at": self._now()})
                self._log(connection, changed, CANCELLED)
            elif job.state == RUNNING:
                connection.execute(OF_ATTEMPT, {**attempt_key(job), "cancel_requested": True})
                changed = read(connection, job_id)
                self._log(connection, changed, "cancel_requested")
            else:
                raise IllegalTransitionError(job_id, job.state, CANCELLED)
        self.notify(job_id)
        return changed

    def delete(self, job_id: str) -> None:
        """Forget an ended job and its artefacts' rows. Raises IllegalTransitionError while it is active or pinned.

        The row goes before the files: a kill in between leaves a folder without a job, which `retention` removes.
        """
        with self._write() as connection:
            job = read(connection, job_id, BRIEF)
            if not job.terminal:
                raise IllegalTransitionError(job_id, job.state, "deleted")
            if job.pinned:
                raise JobPinnedError(job_id)
            connection.execute(delete(JOB).where(JOB.c.id == job_id))
            self._log(connection, job, "deleted")
        self.notify(job_id)
