"""What can be asked of the store: jobs, their files and their history. Changes nothing."""

from __future__ import annotations

import statistics
from dataclasses import fields
from typing import Any

from sqlalchemy import Connection, Engine, Row, Select, and_, bindparam, exists, func, literal, or_, select

from service.store import tables
from service.store.campaign import RUNNING as CAMPAIGN_RUNNING
from service.store.campaign_tables import campaign, campaign_case
from service.store.job import INSERTION, QUEUED, SUCCEEDED, TERMINAL, Artefact, Event, Job, UnknownJob

JOB = tables.job
COLUMNS = [JOB.c[field.name] for field in fields(Job)]
LISTED = [literal(None).label(c.name) if c.name in ("spec", "result") else c for c in COLUMNS]
WHOLE = select(*COLUMNS).where(JOB.c.id == bindparam("job_id"))  # made once: making one costs more than running it
BRIEF = select(*LISTED).where(JOB.c.id == bindparam("job_id"))
_CANCELLED = select(JOB.c.cancel_requested).where(JOB.c.id == bindparam("job_id"))
_MOST_EVENTS = 1000


class Reads:
    """The reading half of the store, one short transaction a question."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine

    @property
    def engine(self) -> Engine:
        """The database."""
        return self._engine

    def get(self, job_id: str) -> Job:
        """The job with its spec and result. Raises UnknownJob."""
        with self._engine.begin() as connection:
            return read(connection, job_id)

    def glance(self, job_id: str) -> Job:
        """The job without its spec and result, which can be large. Raises UnknownJob."""
        with self._engine.begin() as connection:
            return read(connection, job_id, BRIEF)

    def having(self, job_id: str) -> list[Job]:
        """The job without its spec and result, if there is one."""
        with self._engine.begin() as connection:
            return [to_job(row) for row in connection.execute(BRIEF, {"job_id": job_id})]

    def cancel_requested(self, job_id: str) -> bool:
        """Whether somebody wants the job to stop; also when it is gone."""
        with self._engine.begin() as connection:
            return bool(connection.execute(_CANCELLED, {"job_id": job_id}).scalar_one_or_none() in (True, None))

    def newest(self, *, state: str | None = None, limit: int = 50, before: int | None = None) -> list[Job]:
        """Jobs without spec and result, newest first, those that arrived before sequence number `before`."""
        query = select(*LISTED).order_by(JOB.c.seq.desc()).limit(limit)
        if state is not None:
            query = query.where(JOB.c.state == state)
        if before is not None:
            query = query.where(JOB.c.seq < before)
        with self._engine.begin() as connection:
            return [to_job(row) for row in connection.execute(query)]

    def ended(self) -> list[Job]:
        """Every job that has ended and whose campaign, if it has one, has too; without spec and result, the one that
        ended last first. The results of a campaign that runs are still in its jobs."""
        needed = exists().where(
            campaign_case.c.job_id == JOB.c.id,
            campaign.c.id == campaign_case.c.campaign_id,
            campaign.c.state == CAMPAIGN_RUNNING,
        )
        query = select(*LISTED).where(JOB.c.state.in_(sorted(TERMINAL)), ~needed)
        with self._engine.begin() as connection:
            return [
                to_job(row) for row in connection.execute(query.order_by(JOB.c.finished_at.desc(), JOB.c.seq.desc()))
            ]

    def counts(self) -> dict[str, int]:
        """How many jobs there are in each state, those with none included."""
        query = select(JOB.c.state, func.count().label("jobs")).group_by(JOB.c.state)
        with self._engine.begin() as connection:
            found = {row.state: row.jobs for row in connection.execute(query)}
        return {state: found.get(state, 0) for state in tables.STATES}

    def before(self, job: Job) -> int:
        """How many queued jobs will begin before this one."""
        sooner = or_(JOB.c.priority > job.priority, and_(JOB.c.priority == job.priority, JOB.c.seq < job.seq))
        with self._engine.begin() as connection:
            query = select(func.count()).select_from(JOB).where(JOB.c.state == QUEUED, sooner)
            return int(connection.execute(query).scalar_one())

    def oldest_queued_at(self) -> float | None:
        """When the job that has waited longest was submitted; None when nothing waits."""
        with self._engine.begin() as connection:
            return connection.execute(select(func.min(JOB.c.created_at)).where(JOB.c.state == QUEUED)).scalar()

    def ids(self) -> set[str]:
        """The ids of all jobs."""
        with self._engine.begin() as connection:
            return set(connection.execute(select(JOB.c.id)).scalars())

    def step_s(self) -> float | None:
        """Time of a step by the last jobs that succeeded: median of their wall times; None before the first."""
        wall = (JOB.c.finished_at - JOB.c.started_at) / JOB.c.steps
        query = (
            select(wall)
            .where(JOB.c.state == SUCCEEDED, JOB.c.steps > 0, JOB.c.kind == INSERTION)
            .order_by(JOB.c.seq.desc())
            .limit(50)
        )
        with self._engine.begin() as connection:
            found = [float(value) for value in connection.execute(query).scalars() if value is not None]
        return statistics.median(found) if found else None

    def artefacts(self, job_id: str) -> list[Artefact]:
        """What the job left behind, by name."""
        query = select(*(tables.artefact.c[field.name] for field in fields(Artefact)))
        query = query.where(tables.artefact.c.job_id == job_id).order_by(tables.artefact.c.name)
        with self._engine.begin() as connection:
            return [Artefact(**row._mapping) for row in connection.execute(query)]

    def events(self, job_id: str | None = None, *, after: int = 0, limit: int = _MOST_EVENTS) -> list[Event]:
        """What happened to a job, or to all, after event number `after`; oldest first."""
        query = select(tables.event).where(tables.event.c.seq > after).order_by(tables.event.c.seq).limit(limit)
        if job_id is not None:
            query = query.where(tables.event.c.job_id == job_id)
        with self._engine.begin() as connection:
            return [Event(**row._mapping) for row in connection.execute(query)]

    def last_event(self) -> int:
        """The number of the latest event of all; 0 when there is none."""
        with self._engine.begin() as connection:
            return connection.execute(select(func.max(tables.event.c.seq))).scalar() or 0


def read(connection: Connection, job_id: str, query: Select[Any] = WHOLE) -> Job:
    """The job of this id, within a transaction; BRIEF leaves out spec and result. Raises UnknownJob."""
    row = connection.execute(query, {"job_id": job_id}).one_or_none()
    if row is None:
        raise UnknownJob(f"there is no job {job_id}")
    return to_job(row)


def to_job(row: Row[Any]) -> Job:
    """A row of the job table."""
    columns = dict(row._mapping)
    return Job(**{**columns, "timeout_s": float(columns["timeout_s"])})  # SQLite returns 3.0 as 3
