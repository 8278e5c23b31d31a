"""Files that were sent in: kept by their content, never under a name that the sender chose.

The id of an upload is the SHA-256 of its content and the suffix of its format, which is also the name of its file: a
worker finds it without the database, and the same content is kept once.
"""

from __future__ import annotations

import asyncio
import os
import threading
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, delete, func, insert, select

from service.access_tables import job_upload, upload
from service.jobs import QUEUED, RUNNING
from service.limits import Limits
from service.store import Store
from service.tables import job
from service.upload_names import UploadLookup
from simcore.errors import NeedlebenchError

_PART = ".part"


class UnknownUpload(NeedlebenchError, LookupError):
    """There is no upload of this id."""


class UploadInUse(NeedlebenchError):
    """A job that is queued or running will read it."""


class UploadsFull(NeedlebenchError):
    """All uploads together would be more than what is kept."""


@dataclass(frozen=True, kw_only=True)
class Upload:
    """One file. name: what its sender calls it. content: what was found in it. owner: the API key that sent it."""

    id: str
    kind: str
    name: str
    sha256: str
    bytes: int
    content: dict[str, Any]
    owner: str | None
    created_at: float


class Uploads:
    """The uploads of a data folder: files in `folder`, one row each in the database."""

    def __init__(self, folder: Path, store: Store, limits: Limits) -> None:
        self.folder = folder
        self._most_mb = limits.uploads_mb
        self._store = store
        self._turn = threading.Lock()  # a file and its row come and go together
        self._drafts = 0
        self.checking = asyncio.Semaphore(1)  # looking into files: one at a time
        for left in folder.glob(f"*{_PART}*"):  # by a server that died
            left.unlink(missing_ok=True)

    def lookup(self) -> UploadLookup:
        """What names mean in the scenario of one request."""
        return UploadLookup(self.folder)

    def draft(self, suffix: str) -> Path:
        """A new name in the folder, for a file that is still coming in."""
        self.folder.mkdir(parents=True, exist_ok=True)
        with self._turn:
            self._drafts += 1
            return self.folder / f"{os.getpid()}-{self._drafts}{_PART}{suffix}"

    def find(self, upload_id: str) -> Upload | None:
        """The upload of this id, if there is one."""
        with self._store.reading() as connection:
            return _read(connection, upload_id)

    def get(self, upload_id: str) -> Upload:
        """Raises UnknownUpload."""
        found = self.find(upload_id)
        if found is None:
            raise UnknownUpload(f"there is no upload {upload_id}")
        return found

    def newest(self, *, limit: int) -> list[Upload]:
        """Newest first."""
        query = select(upload).order_by(upload.c.created_at.desc(), upload.c.id).limit(limit)
        with self._store.reading() as connection:
            return [Upload(**row._mapping) for row in connection.execute(query)]

    def path(self, found: Upload) -> Path:
        return self.folder / found.id

    def keep(
        self, draft: Path, *, kind: str, name: str, sha256: str, content: dict[str, Any], owner: str | None
    ) -> tuple[Upload, bool]:
        """Make a complete, checked draft an upload; whether it is new. Raises UploadsFull."""
        new = Upload(
            id=f"{sha256}{draft.suffix}",
            kind=kind,
            name=name,
            sha256=sha256,
            bytes=draft.stat().st_size,
            content=content,
            owner=owner,
            created_at=self._store.now,
        )
        with self._turn:
            self._make_sure_of_room(new)
            draft.replace(self.path(new))
            _flush(self.folder)
            with self._store.writing() as connection:
                known = _read(connection, new.id)
                if known is None:
                    row = {item.name: getattr(new, item.name) for item in fields(Upload)}
                    connection.execute(insert(upload).values(row))
        return known or new, known is None

    def _make_sure_of_room(self, new: Upload) -> None:
        others = select(func.coalesce(func.sum(upload.c.bytes), 0)).where(upload.c.id != new.id)
        with self._store.reading() as connection:
            total_mb = (connection.execute(others).scalar_one() + new.bytes) / 1e6
        if total_mb > self._most_mb:
            message = f"all uploads would be {total_mb:.4g} MB, at most {self._most_mb:g} are kept: delete some"
            raise UploadsFull(message)

    def delete(self, upload_id: str) -> None:
        """Raises UnknownUpload, and UploadInUse while a queued or running job names it."""
        active = select(job.c.id).join(job_upload, job_upload.c.job_id == job.c.id)
        active = active.where(job_upload.c.upload_id == upload_id, job.c.state.in_((QUEUED, RUNNING))).limit(1)
        with self._turn:
            with self._store.writing() as connection:
                if _read(connection, upload_id) is None:
                    raise UnknownUpload(f"there is no upload {upload_id}")
                if (user := connection.execute(active).scalar_one_or_none()) is not None:
                    raise UploadInUse(f"job {user} has not ended and uses the upload {upload_id}")
                connection.execute(delete(upload).where(upload.c.id == upload_id))
            (self.folder / upload_id).unlink(missing_ok=True)


def _read(connection: Connection, upload_id: str) -> Upload | None:
    row = connection.execute(select(upload).where(upload.c.id == upload_id)).one_or_none()
    return None if row is None else Upload(**row._mapping)


def _flush(folder: Path) -> None:
    """The new name of a file reaches the disk with its folder (not on Windows, which has no such call)."""
    if os.name != "nt":
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
