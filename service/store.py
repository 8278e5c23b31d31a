"""All SQL: the only door through which a job changes its state, one transaction each."""

from __future__ import annotations

import secrets
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields
from typing import Any

from sqlalchemy import Connection, Engine, Row, Update, delete, insert, literal, select, text, update

from service import tables
from service.jobs import (
    CANCELLED,
    FAILED,
    LEGAL,
    MAXIMUM_CRASHES,
    QUEUED,
    RUNNING,
    Artefact,
    Event,
    IllegalTransition,
    Job,
    KeyReused,
    Outcome,
    UnknownJob,
)

_job = tables.job
_COLUMNS = [_job.c[field.name] for field in fields(Job)]
_LISTED = [literal(None).label(c.name) if c.name in ("spec", "result") else c for c in _COLUMNS]


class Store:
    """Jobs, artefacts and events. `now` gives UTC seconds since 1970; `notify` hears the id of each changed job."""

    def __init__(
        self,
        engine: Engine,
        *,
        now: Callable[[], float] = time.time,
        notify: Callable[[str], None] = lambda _: None,
    ) -> None:
        self._engine = engine
        self._writer = engine.execution_options(write=True)
        self._turn = threading.Lock()  # writers of this process queue up here and not in SQLite's busy loop
        self.now = now
        self.notify = notify

    @contextmanager
    def writing(self) -> Iterator[Connection]:
        """A transaction that may write: one at a time."""
        with self._turn, self._writer.begin() as connection:
            yield connection

    @contextmanager
    def reading(self) -> Iterator[Connection]:
        """A transaction that sees one state of the database and changes nothing."""
        with self._engine.begin() as connection:
            yield connection

    def close(self) -> None:
        """Give the connections back."""
        self._engine.dispose()

    def ping(self) -> None:
        """Raises when the database cannot be read."""
        with self.reading() as connection:
            connection.execute(text("SELECT 1"))

    # -- submitting and reading

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
    ) -> Job:
        """A new queued job; the job of before when the idempotency key was seen. Raises KeyReused."""
        with self.writing() as connection:
            known = self._known(connection, key, request_hash)
            if known is not None:
                return known
            row = connection.execute(
                insert(_job)
                .values(
                    id=secrets.token_hex(8),
                    name=name,
                    spec=spec,
                    spec_hash=spec_hash,
                    steps=steps,
                    state=QUEUED,
                    priority=priority,
                    timeout_s=timeout_s,
                    attempt=0,
                    crashes=0,
                    cancel_requested=False,
                    created_at=self.now(),
                    version=1,
                )
                .returning(*_COLUMNS)
            ).one()
            job = _to_job(row)
            if key is not None:
                seen = {"key": key, "request_hash": request_hash, "job_id": job.id, "created_at": self.now()}
                connection.execute(insert(tables.idempotency).values(seen))
            self._log(connection, job, "submitted", {"priority": priority, "timeout_s": timeout_s})
        return job

    def _known(self, connection: Connection, key: str | None, request_hash: str) -> Job | None:
        if key is None:
            return None
        seen = connection.execute(select(tables.idempotency).where(tables.idempotency.c.key == key)).one_or_none()
        if seen is None:
            return None
        if seen.request_hash != request_hash:
            raise KeyReused(f"this key was used for job {seen.job_id} with another request")
        return self._read(connection, seen.job_id)

    def get(self, job_id: str) -> Job:
        """The job with its spec and result. Raises UnknownJob."""
        with self.reading() as connection:
            return self._read(connection, job_id)

    def glance(self, job_id: str) -> Job:
        """The job without its spec and result, which can be large. Raises UnknownJob."""
        with self.reading() as connection:
            return self._read(connection, job_id, _LISTED)

    def _read(self, connection: Connection, job_id: str, columns: list[Any] = _COLUMNS) -> Job:
        row = connection.execute(select(*columns).where(_job.c.id == job_id)).one_or_none()
        if row is None:
            raise UnknownJob(f"there is no job {job_id}")
        return _to_job(row)

    def newest(self, *, state: str | None = None, limit: int = 50, before: int | None = None) -> list[Job]:
        """Jobs without spec and result, newest first, those that arrived before sequence number `before`."""
        query = select(*_LISTED).order_by(_job.c.seq.desc()).limit(limit)
        if state is not None:
            query = query.where(_job.c.state == state)
        if before is not None:
            query = query.where(_job.c.seq < before)
        with self.reading() as connection:
            return [_to_job(row) for row in connection.execute(query)]

    def artefacts(self, job_id: str) -> list[Artefact]:
        """What the job left behind, by name."""
        query = select(*(tables.artefact.c[field.name] for field in fields(Artefact)))
        query = query.where(tables.artefact.c.job_id == job_id).order_by(tables.artefact.c.name)
        with self.reading() as connection:
            return [Artefact(**row._mapping) for row in connection.execute(query)]

    def events(self, job_id: str) -> list[Event]:
        """What happened to the job, oldest first."""
        query = select(tables.event).where(tables.event.c.job_id == job_id).order_by(tables.event.c.seq)
        with self.reading() as connection:
            return [Event(**row._mapping) for row in connection.execute(query)]

    # -- the life of a job

    def claim(self) -> Job | None:
        """Take the next queued job, highest priority first, then oldest; None when there is none."""
        best = (
            select(_job.c.seq)
            .where(_job.c.state == QUEUED)
            .order_by(_job.c.priority.desc(), _job.c.seq)
            .limit(1)
            .with_for_update(skip_locked=True)
            .scalar_subquery()
        )
        statement = update(_job).where(_job.c.seq == best, _job.c.state == QUEUED)
        now = self.now()
        values = {"state": RUNNING, "attempt": _job.c.attempt + 1, "started_at": now, "heartbeat_at": now}
        with self.writing() as connection:
            row = connection.execute(
                statement.values(**values, progress=None, version=_job.c.version + 1).returning(*_COLUMNS)
            ).one_or_none()
            if row is None:
                return None
            job = _to_job(row)
            self._log(connection, job, "started")
        self.notify(job.id)
        return job

    def beat(self, job: Job, progress: dict[str, Any]) -> None:
        """Progress of a running attempt; nothing happens when the attempt is no longer the current one."""
        values = {"progress": progress, "heartbeat_at": self.now(), "version": _job.c.version + 1}
        with self.writing() as connection:
            changed = connection.execute(_of_attempt(job).values(**values)).rowcount
        if changed:
            self.notify(job.id)

    def finish(self, job: Job, outcome: Outcome) -> Job:
        """End the running attempt `job`. Raises IllegalTransition when it is not the current one."""
        values: dict[str, Any] = {
            "result": outcome.result,
            "metrics": None if outcome.result is None else outcome.result.get("metrics"),
            "error_kind": outcome.error_kind,
            "error": outcome.error,
            "cpu_s": outcome.cpu_s,
            "max_rss_mb": outcome.max_rss_mb,
            "finished_at": self.now(),
        }
        with self.writing() as connection:
            done = self._move(connection, job, outcome.state, values)
            for artefact in outcome.artefacts:
                row = {field.name: getattr(artefact, field.name) for field in fields(Artefact)}
                connection.execute(insert(tables.artefact).values(**row, job_id=job.id))
            data = {"error_kind": outcome.error_kind, "error": outcome.error} if outcome.error_kind else None
            self._log(connection, done, outcome.state, data)
        self.notify(job.id)
        return done

    def requeue(self, job: Job, *, reason: str, crashed: bool) -> Job:
        """Put the running attempt `job` back into the queue; after three crashes it has failed instead."""
        with self.writing() as connection:
            now = self._read(connection, job.id)
            crashes = now.crashes + crashed
            if now.cancel_requested:
                moved = self._move(connection, job, CANCELLED, {"crashes": crashes, "finished_at": self.now()})
                self._log(connection, moved, CANCELLED)
            elif crashed and crashes >= MAXIMUM_CRASHES:
                message = f"gave up after {crashes} attempts; the last one ended so: {reason}"
                values: dict[str, Any] = {"crashes": crashes, "error_kind": "worker_died", "error": message}
                moved = self._move(connection, job, FAILED, {**values, "finished_at": self.now()})
                self._log(connection, moved, FAILED, values)
            else:
                moved = self._move(
                    connection, job, QUEUED, {"crashes": crashes, "heartbeat_at": None, "progress": None}
                )
                self._log(connection, moved, "requeued", {"reason": reason})
        self.notify(job.id)
        return moved

    def recover(self) -> list[Job]:
        """At start: jobs that were running when the server died go back into the queue."""
        with self.reading() as connection:
            left = [_to_job(row) for row in connection.execute(select(*_COLUMNS).where(_job.c.state == RUNNING))]
        return [self.requeue(job, reason="the server died", crashed=True) for job in left]

    def cancel(self, job_id: str) -> Job:
        """Cancel a queued job, ask a running one to stop. Once more is no error. Raises IllegalTransition."""
        with self.writing() as connection:
            job = self._read(connection, job_id)
            if job.state == CANCELLED or (job.state == RUNNING and job.cancel_requested):
                return job
            if job.state == QUEUED:
                changed = self._move(connection, job, CANCELLED, {"finished_at": self.now()})
                self._log(connection, changed, CANCELLED)
            elif job.state == RUNNING:
                values = {"cancel_requested": True, "version": _job.c.version + 1}
                connection.execute(_of_attempt(job).values(**values))
                changed = self._read(connection, job_id)
                self._log(connection, changed, "cancel_requested")
            else:
                raise IllegalTransition(job_id, job.state, CANCELLED)
        self.notify(job_id)
        return changed

    def delete(self, job_id: str) -> None:
        """Forget a job that has ended, with its artefacts' rows. Raises IllegalTransition while it is active."""
        with self.writing() as connection:
            job = self._read(connection, job_id, _LISTED)
            if not job.terminal:
                raise IllegalTransition(job_id, job.state, "deleted")
            connection.execute(delete(_job).where(_job.c.id == job_id))
            self._log(connection, job, "deleted")
        self.notify(job_id)

    def _move(self, connection: Connection, job: Job, state: str, values: dict[str, Any]) -> Job:
        """Change the state of `job` as it was read; the attempt is the fence against an owner of before."""
        if state in LEGAL[job.state]:
            statement = _of_attempt(job).values(**values, state=state, version=_job.c.version + 1)
            row = connection.execute(statement.returning(*_COLUMNS)).one_or_none()
            if row is not None:
                return _to_job(row)
        raise IllegalTransition(job.id, self._read(connection, job.id).state, state)

    def _log(self, connection: Connection, job: Job, kind: str, data: dict[str, Any] | None = None) -> None:
        row = {"job_id": job.id, "at": self.now(), "kind": kind, "attempt": job.attempt, "data": data}
        connection.execute(insert(tables.event).values(row))


def _of_attempt(job: Job) -> Update:
    return update(_job).where(_job.c.id == job.id, _job.c.attempt == job.attempt, _job.c.state == job.state)


def _to_job(row: Row[Any]) -> Job:
    columns = dict(row._mapping)
    return Job(**{**columns, "timeout_s": float(columns["timeout_s"])})  # SQLite returns 3.0 as 3
