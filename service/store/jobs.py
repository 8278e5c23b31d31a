"""All SQL: the only door through which a job changes its state, one transaction each."""

from __future__ import annotations

import secrets
import threading
import time
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from typing import Any

from sqlalchemy import Connection, Engine, delete, insert, select, update

from service.limits import Limits
from service.store import access_tables, tables
from service.store.database import sync
from service.store.job import (
    CANCELLED,
    CRASHED,
    FAILED,
    INSERTION,
    LEGAL,
    MAXIMUM_ATTEMPTS,
    MAXIMUM_CRASHES,
    QUEUED,
    REQUEUED,
    RUNNING,
    IllegalTransition,
    InputGone,
    Job,
    KeyReused,
    Outcome,
    QueueFull,
)
from service.store.job_queries import BRIEF, COLUMNS, Reads, read, to_job
from service.store.statements import (
    ALL_QUEUED,
    ARTEFACT,
    CLAIM,
    END,
    EVENT,
    FILE_FIELDS,
    MOVE,
    NEW,
    OF_ATTEMPT,
    QUEUED_ALONE,
)
from service.store.upload_references import check_uploads, missing

_job = tables.job


class Store(Reads):
    """Jobs, artefacts and events. `now` gives UTC seconds since 1970; `listen` says who hears of each changed job."""

    def __init__(
        self,
        engine: Engine,
        *,
        now: Callable[[], float] = time.time,
        limits: Limits | None = None,
    ) -> None:
        super().__init__(engine)
        self._writer = engine.execution_options(write=True)
        self._lazy_writer = engine.execution_options(write="lazy")
        self._turn = threading.Lock()  # writers of this process queue up here and not in SQLite's busy loop
        self._now = now
        self._limits = limits or Limits()
        self._hearers: tuple[Callable[[str], None], ...] = ()
        self._changed: list[str] = []  # within the transaction of whoever has the turn

    def listen(self, *hearers: Callable[[str], None]) -> None:
        """From now on these hear the id of each job that changed, one after the other, once the change can be read."""
        self._hearers = hearers

    def notify(self, *job_ids: str) -> None:
        """Tell who listens that these changed."""
        for job_id in job_ids:
            for hear in self._hearers:
                hear(job_id)

    def changed_within(self, job_ids: Iterable[str]) -> None:
        """Within a transaction that writes: these are told of once it is committed."""
        self._changed.extend(job_ids)

    @property
    def now(self) -> float:
        """UTC seconds since 1970, by the store's clock."""
        return self._now()

    def reading(self) -> AbstractContextManager[Connection]:
        """A transaction that reads, for the stores of other tables."""
        return self._engine.begin()

    def writing(self) -> AbstractContextManager[Connection]:
        """A transaction that writes, for the stores of other tables."""
        return self._write()

    @contextmanager
    def _write(self, *, lazy: bool = False) -> Iterator[Connection]:
        """lazy: do not wait for the disk, as nobody was promised anything yet."""
        with self._turn:
            self._changed = []
            with (self._lazy_writer if lazy else self._writer).begin() as connection:
                yield connection
            changed = self._changed
        self.notify(*changed)

    def close(self) -> None:
        """Give the connections back."""
        self._engine.dispose()

    # -- submitting

    def submit(
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
        """A new queued job; the job of before when the idempotency key was seen.

        owner: the API key that asked. uploads: ids of those that the job will read.
        Raises KeyReused, QueueFull, UploadGone.
        """
        with self._write() as connection:
            known = self._known(connection, key, request_hash)
            if known is not None:
                return known
            self._admit(connection, owner)
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
            }
            job = to_job(connection.execute(NEW, new).one())
            for upload_id in uploads:
                used = {"job_id": job.id, "upload_id": upload_id}
                connection.execute(insert(access_tables.job_upload).values(used))
            if key is not None:
                seen = {"key": key, "request_hash": request_hash, "job_id": job.id, "created_at": self._now()}
                connection.execute(insert(tables.idempotency).values(seen))
            self._log(connection, job, QUEUED, {"priority": priority, "timeout_s": timeout_s})
        self.notify(job.id)
        return job

    def _admit(self, connection: Connection, owner: str | None) -> None:
        """Whether there is room in the queue."""
        if connection.execute(ALL_QUEUED).scalar_one() >= self._limits.queue:  # else there is no need to look closer
            queued = connection.execute(QUEUED_ALONE).scalar_one()  # a campaign is one request, however large
            if queued >= self._limits.queue:
                raise QueueFull(f"{queued} jobs are queued, at most {self._limits.queue} are taken")
        if owner is not None:
            queued = connection.execute(QUEUED_ALONE.where(_job.c.owner == owner)).scalar_one()
            if queued >= (most := self._limits.queue_per_key):
                raise QueueFull(f"{queued} jobs of this key are queued, at most {most} of one key are taken")

    def _known(self, connection: Connection, key: str | None, request_hash: str) -> Job | None:
        if key is None:
            return None
        seen = connection.execute(select(tables.idempotency).where(tables.idempotency.c.key == key)).one_or_none()
        if seen is None:
            return None
        if seen.request_hash != request_hash:
            raise KeyReused(f"this key was used for job {seen.job_id} with another request")
        return read(connection, seen.job_id)

    # -- the life of a job

    def claim(self) -> Job | None:
        """Take the next queued job, highest priority first, then oldest; None when there is none.

        A power cut may put it back into the queue, as if nobody had taken it.
        """
        with self._write(lazy=True) as connection:
            job = self._take(connection)
            if job is None:
                return None
            self._log(connection, job, "started")
        self.notify(job.id)
        return job

    def _take(self, connection: Connection) -> Job | None:
        row = connection.execute(CLAIM, {"now": self._now()}).one_or_none()
        return None if row is None else to_job(row)

    def beat(self, job: Job, progress: dict[str, Any]) -> None:
        """Progress of a running attempt; nothing happens when the attempt is no longer the current one."""
        values = {"progress": progress, "heartbeat_at": self._now()}
        with self._write(lazy=True) as connection:
            changed = connection.execute(OF_ATTEMPT, {**_attempt(job), **values}).rowcount
        if changed:
            self.notify(job.id)

    def finish(self, job: Job, outcome: Outcome) -> Job:
        """End the running attempt `job`. Raises IllegalTransition when it is not the current one."""
        with self._write() as connection:
            done = self._end(connection, job, outcome)
            self._log(connection, done, outcome.state, _error(outcome))
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
            rows = [self._entry(done, outcome.state, _error(outcome))]
            if taken is not None:
                rows.append(self._entry(taken, "started"))
            connection.execute(EVENT, rows)
        return done, taken

    def publish(self, *job_ids: str) -> None:
        """Bring what was committed to the disk and tell who waits for these jobs. Raises OSError."""
        try:
            sync(self._engine)
        finally:
            self.notify(*job_ids)

    def _end(self, connection: Connection, job: Job, outcome: Outcome) -> Job:
        values: dict[str, Any] = {
            "state": outcome.state,
            "result": outcome.result,
            "metrics": None if outcome.result is None else outcome.result.get("metrics"),
            "error_kind": outcome.error_kind,
            "error": outcome.error,
            "cpu_s": outcome.cpu_s,
            "max_rss_mb": outcome.max_rss_mb,
            "finished_at": self._now(),
        }
        if outcome.progress is not None:
            values["progress"] = outcome.progress
        row = None
        if outcome.state in LEGAL[job.state]:
            row = connection.execute(END, {**_attempt(job), **values}).one_or_none()
        if row is None:
            raise IllegalTransition(job.id, read(connection, job.id, BRIEF).state, outcome.state)
        rows = [{"job_id": job.id, **{n: getattr(file, n) for n in FILE_FIELDS}} for file in outcome.artefacts]
        if rows:
            connection.execute(ARTEFACT, rows)
        return replace(job, **{**values, **row._mapping})

    def requeue(self, job: Job, *, reason: str, crashed: bool) -> Job:
        """Put the running attempt `job` back into the queue; after three crashes it has failed instead."""
        crashes = job.crashes + crashed
        return self._again(job, reason, CRASHED if crashed else REQUEUED, crashes, crashes >= MAXIMUM_CRASHES)

    def recover(self) -> list[Job]:
        """At start: jobs that were running when the server died go back into the queue.

        The death of the server is no fault of theirs, unless it happens in very many attempts.
        """
        with self._engine.begin() as connection:
            left = [to_job(row) for row in connection.execute(select(*COLUMNS).where(_job.c.state == RUNNING))]
        reason = "the server died"
        return [self._again(job, reason, CRASHED, job.crashes, job.attempt >= MAXIMUM_ATTEMPTS) for job in left]

    def _again(self, job: Job, reason: str, kind: str, crashes: int, hopeless: bool) -> Job:
        """Another attempt of the running `job`, unless somebody cancelled it or it is hopeless."""
        with self._write() as connection:
            values: dict[str, Any] = {"crashes": crashes}
            if read(connection, job.id, BRIEF).cancel_requested:
                moved = self._move(connection, job, CANCELLED, {**values, "finished_at": self._now()})
                self._log(connection, moved, CANCELLED)
            elif hopeless:
                message = f"gave up after {job.attempt} attempts; the last one ended so: {reason}"
                values = {**values, "error_kind": "worker_died", "error": message}
                moved = self._move(connection, job, FAILED, {**values, "finished_at": self._now()})
                self._log(connection, moved, FAILED, values)
            else:
                moved = self._move(connection, job, QUEUED, {**values, "heartbeat_at": None, "progress": None})
                self._log(connection, moved, kind, {"reason": reason})
        self.notify(job.id)
        return moved

    def retry(self, job_id: str) -> Job:
        """Queue a job again that failed, was cancelled or ran out of time. Raises IllegalTransition.

        The attempts go on counting; what the last one left is no longer listed. Raises InputGone, too.
        """
        fresh: dict[str, Any] = dict.fromkeys(
            ("progress", "metrics", "result", "error_kind", "error", "cpu_s", "max_rss_mb", "heartbeat_at")
        )
        fresh |= {"crashes": 0, "cancel_requested": False, "started_at": None, "finished_at": None}
        with self._write() as connection:
            job = read(connection, job_id)
            if not job.terminal:
                raise IllegalTransition(job_id, job.state, QUEUED)
            if problems := missing(connection, job.spec or {}):
                raise InputGone(job.id, problems)
            moved = self._move(connection, job, QUEUED, fresh)
            connection.execute(delete(tables.artefact).where(tables.artefact.c.job_id == job_id))
            self._log(connection, moved, QUEUED, {"retry_of": job.state, "error": job.error})
        self.notify(job_id)
        return moved

    def pin(self, job_id: str, *, pinned: bool) -> Job:
        """Keep a job whatever is cleared away, or no longer. Once more is no error."""
        with self._write() as connection:
            job = read(connection, job_id)
            if job.pinned == pinned:
                return job
            values = {"pinned": pinned, "version": _job.c.version + 1}
            connection.execute(update(_job).where(_job.c.id == job_id).values(**values))
            self._log(connection, job, "pinned" if pinned else "unpinned")
            job = read(connection, job_id)
        self.notify(job_id)
        return job

    def cancel(self, job_id: str) -> Job:
        """Cancel a queued job, ask a running one to stop. Once more is no error. Raises IllegalTransition."""
        with self._write() as connection:
            job = read(connection, job_id)
            if job.state == CANCELLED or (job.state == RUNNING and job.cancel_requested):
                return job
            if job.state == QUEUED:
                changed = self._move(connection, job, CANCELLED, {"finished_at": self._now()})
                self._log(connection, changed, CANCELLED)
            elif job.state == RUNNING:
                connection.execute(OF_ATTEMPT, {**_attempt(job), "cancel_requested": True})
                changed = read(connection, job_id)
                self._log(connection, changed, "cancel_requested")
            else:
                raise IllegalTransition(job_id, job.state, CANCELLED)
        self.notify(job_id)
        return changed

    def delete(self, job_id: str) -> None:
        """Forget a job that has ended, with its artefacts' rows. Raises IllegalTransition while it is active or pinned.

        The row goes before the files: a kill in between leaves a folder without a job, which `retention` clears away.
        """
        with self._write() as connection:
            job = read(connection, job_id, BRIEF)
            if not job.terminal or job.pinned:
                raise IllegalTransition(job_id, "pinned" if job.pinned else job.state, "deleted")
            connection.execute(delete(_job).where(_job.c.id == job_id))
            self._log(connection, job, "deleted")
        self.notify(job_id)

    def _move(self, connection: Connection, job: Job, state: str, values: dict[str, Any]) -> Job:
        """Change the state of `job` as it was read."""
        if state in LEGAL[job.state]:
            row = connection.execute(MOVE, {**_attempt(job), **values, "state": state}).one_or_none()
            if row is not None:
                return to_job(row)
        raise IllegalTransition(job.id, read(connection, job.id).state, state)

    def _log(self, connection: Connection, job: Job, kind: str, data: dict[str, Any] | None = None) -> None:
        connection.execute(EVENT, self._entry(job, kind, data))

    def _entry(self, job: Job, kind: str, data: dict[str, Any] | None = None) -> dict[str, Any]:
        return {"job_id": job.id, "at": self._now(), "kind": kind, "attempt": job.attempt, "data": data}


def _error(outcome: Outcome) -> dict[str, Any] | None:
    return {"error_kind": outcome.error_kind, "error": outcome.error} if outcome.error_kind else None


def _attempt(job: Job) -> dict[str, Any]:
    """What `OF_ATTEMPT` asks for: the job as it was read; the attempt is the fence against an owner of before."""
    return {"of_id": job.id, "of_attempt": job.attempt, "of_state": job.state}
