"""Statements of the store, made once: making one costs more than running it."""

from __future__ import annotations

from dataclasses import fields

from sqlalchemy import bindparam, exists, func, insert, literal_column, select, update

from service.store import tables
from service.store.campaign_tables import campaign_case
from service.store.job import QUEUED, RUNNING, Artefact
from service.store.job_queries import COLUMNS

_job = tables.job

NEW = insert(_job).returning(*COLUMNS)
EVENT = insert(tables.event)
ARTEFACT = insert(tables.artefact)
FILE_FIELDS = [field.name for field in fields(Artefact)]
ALL_QUEUED = select(func.count()).select_from(_job).where(_job.c.state == QUEUED)
QUEUED_ALONE = ALL_QUEUED.where(~exists().where(campaign_case.c.job_id == _job.c.id))
NEXT = (
    select(_job.c.seq)
    # SQLite's hint, with the state in the text: else it sorts all queued jobs each time, as if they were few
    .where(func.likely(_job.c.state == literal_column(f"'{QUEUED}'")))
    .order_by(_job.c.priority.desc(), _job.c.seq)
    .limit(1)
    .with_for_update(skip_locked=True)
    .scalar_subquery()
)
CLAIM = (
    update(_job)
    .where(_job.c.seq == NEXT, _job.c.state == QUEUED)
    .values(state=RUNNING, attempt=_job.c.attempt + 1, progress=None, version=_job.c.version + 1)
    .values(started_at=bindparam("now"), heartbeat_at=bindparam("now"))
    .returning(*COLUMNS)
)
OF_ATTEMPT = (
    update(_job)
    .where(_job.c.id == bindparam("of_id"), _job.c.attempt == bindparam("of_attempt"))
    .where(_job.c.state == bindparam("of_state"))
    .values(version=_job.c.version + 1)
)
MOVE = OF_ATTEMPT.returning(*COLUMNS)
MEANWHILE = [_job.c[name] for name in ("version", "progress", "heartbeat_at", "cancel_requested", "pinned")]
END = OF_ATTEMPT.returning(*MEANWHILE)  # what others may have changed since the claim; the rest is known
