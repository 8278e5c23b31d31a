"""The uploads that jobs read, within the transaction that relies on their being there."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import Any

from sqlalchemy import Connection, select

from service.files.upload_names import SCHEME, references
from service.store.job import UploadGoneError
from service.store.schema import upload
from simcore.errors import Problem

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
