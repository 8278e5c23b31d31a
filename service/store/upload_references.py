"""The uploads that jobs read: whether they are there, in the transaction that relies on it, and who names them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sqlalchemy import Connection, func, select

from service.files.upload_names import SCHEME, references
from service.store.job import UploadGoneError
from service.store.job_queries import LISTED, to_job
from service.store.schema import job, job_upload, upload
from simcore.errors import Problem

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping

    from service.store.job import Job
    from service.store.transactions import Transactions

_GONE = "the upload was deleted: send it again with `needlebench upload`"


def missing(connection: Connection, spec: Mapping[str, Any]) -> list[Problem]:
    """A problem for each field of a job's specification that names an upload which is not there any more."""
    named = list(_named(spec))
    gone = _gone(connection, {upload_id for _, upload_id in named})
    return [Problem(field, f"{SCHEME}{upload_id}", _GONE) for field, upload_id in named if upload_id in gone]


def check_uploads(connection: Connection, uploads: Collection[str], spec: Mapping[str, Any]) -> None:
    """Raises UploadGoneError, with the fields of `spec` that name them, when any of these uploads was deleted."""
    if gone := _gone(connection, uploads):
        fields = {upload_id: field for field, upload_id in _named(spec)}
        raise UploadGoneError([Problem(fields.get(one, ""), f"{SCHEME}{one}", _GONE) for one in sorted(gone)])


def _named(spec: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """(field, id), as the sender of the scenario or training wrote the field."""
    for part in spec.values():
        yield from references(part)


def _gone(connection: Connection, uploads: Collection[str]) -> set[str]:
    if not uploads:
        return set()
    found = connection.execute(select(upload.c.id).where(upload.c.id.in_(sorted(uploads)))).scalars()
    return set(uploads) - set(found)


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
