"""Which jobs name which uploads, for those who look before they delete."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sqlalchemy import func, select

from service.store.job_queries import LISTED, to_job
from service.store.schema import job, job_upload

if TYPE_CHECKING:
    from collections.abc import Collection

    from service.store.job import Job
    from service.store.transactions import Transactions


def jobs_with(store: Transactions, upload_id: str, *, limit: int) -> list[Job]:
    """Jobs that name an upload, newest first, without spec and result."""
    query = select(*LISTED).join(job_upload, job_upload.c.job_id == job.c.id).where(job_upload.c.upload_id == upload_id)
    with store.reading() as connection:
        return [to_job(row) for row in connection.execute(query.order_by(job.c.seq.desc()).limit(limit))]


def users_of(store: Transactions, upload_ids: Collection[str]) -> dict[str, int]:
    """How many jobs name each of these uploads."""
    query = (
        select(job_upload.c.upload_id, func.count())
        .where(job_upload.c.upload_id.in_(sorted(upload_ids)))
        .group_by(job_upload.c.upload_id)
    )
    with store.reading() as connection:
        counts: dict[str, int] = {row[0]: row[1] for row in connection.execute(query)}
    return {upload_id: counts.get(upload_id, 0) for upload_id in upload_ids}
