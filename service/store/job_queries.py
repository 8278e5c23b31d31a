"""What can be asked of the store (jobs, their files, their history), and the statements that change jobs.

Statements are made once: making one costs more than running it.
"""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, Any

from sqlalchemy import (
    Connection,
    Row,
    Select,
    bindparam,
    exists,
    func,
    insert,
    literal,
    literal_column,
    select,
    update,
)

from service.store import schema
from service.store.campaign import RUNNING as CAMPAIGN_RUNNING
from service.store.job import (
    CRASHED,
    FINISHED,
    INSERTION,
    MISSED,
    QUEUED,
    RUNNING,
    SUCCESS,
    TERMINAL,
    Artefact,
    Event,
    Job,
    KeyReusedError,
    QueueFullError,
    UnknownJobError,
)
from service.store.schema import campaign, campaign_case
from service.store.transactions import Transactions
from service.store.turns import ahead_of

if TYPE_CHECKING:
    from service.settings import Limits

JOB = schema.job
FIELDS = [field.name for field in fields(Job)]
COLUMNS = [JOB.c[name] for name in FIELDS]
LISTED = [literal(None).label(c.name) if c.name in ("spec", "result") else c for c in COLUMNS]
WHOLE = select(*COLUMNS).where(JOB.c.id == bindparam("job_id"))
BRIEF = select(*LISTED).where(JOB.c.id == bindparam("job_id"))
NEW = insert(JOB).returning(*COLUMNS)
EVENT = insert(schema.event)
ARTEFACT = insert(schema.artefact)
FILE_FIELDS = [field.name for field in fields(Artefact)]
ALL_QUEUED = select(func.count()).select_from(JOB).where(JOB.c.state == QUEUED)
_IS_QUEUED = func.likely(JOB.c.state == literal_column(f"'{QUEUED}'"))  # in the text, for the index of queued jobs
HIGHEST = select(JOB.c.priority).where(_IS_QUEUED).order_by(JOB.c.priority.desc()).limit(1)
LANES = (  # those of a priority, each with its oldest job: read from the index alone
    select(JOB.c.lane, func.min(JOB.c.seq).label("oldest"), func.count().label("waiting"))
    .where(_IS_QUEUED, JOB.c.priority == bindparam("of_priority"))
    .group_by(JOB.c.lane)
)
CLAIM = (
    update(JOB)
    .where(JOB.c.seq == bindparam("of_seq"), JOB.c.state == QUEUED)
    .values(state=RUNNING, attempt=JOB.c.attempt + 1, progress=None, version=JOB.c.version + 1)
    .values(started_at=bindparam("now"), heartbeat_at=bindparam("now"))
    .returning(*COLUMNS)
)
OF_ATTEMPT = (
    update(JOB)
    .where(JOB.c.id == bindparam("of_id"), JOB.c.attempt == bindparam("of_attempt"))
    .where(JOB.c.state == bindparam("of_state"))
    .values(version=JOB.c.version + 1)
)
BEAT = (
    update(JOB)  # nobody waits for it: the version stays
    .where(JOB.c.id == bindparam("of_id"), JOB.c.attempt == bindparam("of_attempt"), JOB.c.state == RUNNING)
    .values(heartbeat_at=bindparam("now"))
)
MOVE = OF_ATTEMPT.returning(*COLUMNS)
_SHARED = ("version", "progress", "heartbeat_at", "cancel_requested", "pinned", "name", "tags", "note")
MEANWHILE = [JOB.c[name] for name in _SHARED]
END = OF_ATTEMPT.returning(*MEANWHILE)  # what others may have changed since the claim; the rest is known
_CANCELLED = select(JOB.c.cancel_requested).where(JOB.c.id == bindparam("job_id"))
_MOST_EVENTS = 1000


class JobQueries(Transactions):
    """The reading half of the store, one short transaction a question."""

    def get(self, job_id: str) -> Job:
        """The job with its spec and result. Raises UnknownJobError."""
        with self.reading() as connection:
            return read(connection, job_id)

    def get_summary(self, job_id: str) -> Job:
        """The job without its spec and result, which can be large. Raises UnknownJobError."""
        with self.reading() as connection:
            return read(connection, job_id, BRIEF)

    def find(self, job_id: str) -> list[Job]:
        """The job without its spec and result, if there is one."""
        with self.reading() as connection:
            return [to_job(row) for row in connection.execute(BRIEF, {"job_id": job_id})]

    def cancel_requested(self, job_id: str) -> bool:
        """Whether somebody wants the job to stop; also when it is gone."""
        with self.reading() as connection:
            return bool(connection.execute(_CANCELLED, {"job_id": job_id}).scalar_one_or_none() in (True, None))

    def running(self) -> list[Job]:
        """Every job that runs, or ran when the server died, in the order of arrival; without spec and result."""
        query = select(*LISTED).where(JOB.c.state == RUNNING).order_by(JOB.c.seq)
        with self.reading() as connection:
            return [to_job(row) for row in connection.execute(query)]

    def server_deaths(self, job: Job) -> int:
        """In how many attempts of `job` since it was queued the whole server died; its worker's crashes are apart."""
        event = schema.event.c
        queued = select(func.max(event.seq)).where(event.job_id == job.id, event.kind == QUEUED).scalar_subquery()
        query = select(func.count()).where(event.job_id == job.id, event.kind == CRASHED, event.seq > queued)
        with self.reading() as connection:
            return max(0, int(connection.execute(query).scalar_one()) - job.crashes)

    def ended(self) -> list[Job]:
        """Every job that has ended and whose campaign, if it has one, has too; without spec and result, the one that
        ended last first. The results of a campaign that runs are still in its jobs."""
        needed = exists().where(
            campaign_case.c.job_id == JOB.c.id,
            campaign.c.id == campaign_case.c.campaign_id,
            campaign.c.state == CAMPAIGN_RUNNING,
        )
        query = select(*LISTED).where(JOB.c.state.in_(sorted(TERMINAL)), ~needed)
        with self.reading() as connection:
            return [
                to_job(row) for row in connection.execute(query.order_by(JOB.c.finished_at.desc(), JOB.c.seq.desc()))
            ]

    def before(self, job: Job) -> int:
        """How many queued jobs will begin before this one, at most, if no more are queued."""
        higher = ALL_QUEUED.where(JOB.c.priority > job.priority)
        with self.reading() as connection:
            lane = connection.execute(select(JOB.c.lane).where(JOB.c.id == job.id)).scalar_one_or_none() or ""
            first = ALL_QUEUED.where(JOB.c.priority == job.priority, JOB.c.lane == lane, JOB.c.seq < job.seq)
            waiting = {row.lane: row.waiting for row in connection.execute(LANES, {"of_priority": job.priority})}
            earlier = int(connection.execute(first).scalar_one())
            ahead = ahead_of(lane, earlier, waiting) if lane in waiting else 0
            return ahead + int(connection.execute(higher).scalar_one())

    def oldest_queued_at(self) -> float | None:
        """When the job that has waited longest was submitted; None when nothing waits."""
        with self.reading() as connection:
            return connection.execute(select(func.min(JOB.c.created_at)).where(JOB.c.state == QUEUED)).scalar()

    def ids(self) -> set[str]:
        """The ids of all jobs."""
        with self.reading() as connection:
            return set(connection.execute(select(JOB.c.id)).scalars())

    def latest_finished(self, limit: int) -> list[tuple[str, float]]:
        """Id and wall time, s, of the latest insertions whose every planned step was taken, newest first."""
        query = (
            select(JOB.c.id, JOB.c.finished_at - JOB.c.started_at)
            .where(JOB.c.state == FINISHED, JOB.c.kind == INSERTION, JOB.c.outcome.in_((SUCCESS, MISSED)))
            .where(JOB.c.finished_at > JOB.c.started_at)
            .order_by(JOB.c.seq.desc())
            .limit(limit)
        )
        with self.reading() as connection:
            return [(job_id, float(wall_s)) for job_id, wall_s in connection.execute(query)]

    def artefacts(self, job_id: str) -> list[Artefact]:
        """What the job left behind, by name."""
        query = select(*(schema.artefact.c[field.name] for field in fields(Artefact)))
        query = query.where(schema.artefact.c.job_id == job_id).order_by(schema.artefact.c.name)
        with self.reading() as connection:
            return [Artefact(**row._mapping) for row in connection.execute(query)]

    def events(self, job_id: str | None = None, *, after: int = 0, limit: int = _MOST_EVENTS) -> list[Event]:
        """What happened to a job, or to all, after event number `after`; oldest first."""
        query = select(schema.event).where(schema.event.c.seq > after).order_by(schema.event.c.seq).limit(limit)
        if job_id is not None:
            query = query.where(schema.event.c.job_id == job_id)
        with self.reading() as connection:
            return [Event(**row._mapping) for row in connection.execute(query)]

    def last_event(self) -> int:
        """The number of the latest event of all; 0 when there is none."""
        with self.reading() as connection:
            return connection.execute(select(func.max(schema.event.c.seq))).scalar() or 0


def read(connection: Connection, job_id: str, query: Select[Any] = WHOLE) -> Job:
    """The job of this id, within a transaction; BRIEF leaves out spec and result. Raises UnknownJobError."""
    row = connection.execute(query, {"job_id": job_id}).one_or_none()
    if row is None:
        raise UnknownJobError(f"there is no job {job_id}")
    return to_job(row)


def to_job(row: Row[Any]) -> Job:
    """A row of the job table."""
    columns = {name: row._mapping[name] for name in FIELDS}
    return Job(**{**columns, "timeout_s": float(columns["timeout_s"])})  # SQLite returns 3.0 as 3


def check_room(connection: Connection, owner: str | None, limits: Limits, *, more: int = 1) -> None:
    """Whether the queue takes so many more jobs of this API key, those of campaigns included. Raises QueueFullError."""
    wanted = "" if more == 1 else f", and {more} more are wanted"
    queued = connection.execute(ALL_QUEUED).scalar_one()
    if queued + more > limits.queue:
        raise QueueFullError(f"{queued} jobs are queued{wanted}, at most {limits.queue} are taken")
    if owner is not None:
        queued = connection.execute(ALL_QUEUED.where(JOB.c.owner == owner)).scalar_one()
        if queued + more > (most := limits.queue_per_key):
            raise QueueFullError(f"{queued} jobs of this key are queued{wanted}, at most {most} of one key are taken")


def find_original(connection: Connection, key: str | None, request_hash: str) -> Job | None:
    """The job that was submitted with this idempotency key, if there is one. Raises KeyReusedError."""
    if key is None:
        return None
    seen = connection.execute(select(schema.idempotency).where(schema.idempotency.c.key == key)).one_or_none()
    if seen is None:
        return None
    if seen.request_hash != request_hash:
        raise KeyReusedError(f"this key was used for job {seen.job_id} with another request")
    return read(connection, seen.job_id)
