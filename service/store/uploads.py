"""Files that were sent in: kept by their content, never under a name that the sender chose.

The id of an upload is the SHA-256 of its content and the suffix of its format, which is also the name of its file: a
worker finds it without the database, and the same content is kept once.
"""

from __future__ import annotations

import asyncio
import hashlib
import os
import shutil
import threading
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

from sqlalchemy import Connection, Integer, Row, delete, func, insert, literal_column, select, update

from service.files.upload_names import references
from service.store.job import QUEUED, RUNNING, Job
from service.store.paging import Page, read_page
from service.store.schema import campaign, job, job_upload, schedule, upload
from simcore.errors import NeedlebenchError

if TYPE_CHECKING:
    from collections.abc import Collection
    from pathlib import Path

    from service.settings import Limits
    from service.store.jobs import Store

_PART = ".part"
_ARRIVED = literal_column("upload.rowid", Integer)  # SQLite's own count of what was inserted


class UnknownUploadError(NeedlebenchError, LookupError):
    """There is no upload of this id."""


class UploadInUseError(NeedlebenchError):
    """It is pinned, or a job that is queued or running will read it."""


class UploadsFullError(NeedlebenchError):
    """All uploads together would be more than what is kept."""


@dataclass(frozen=True, kw_only=True)
class Upload:
    """One file. name: what its sender calls it. content: what was found in it. owner: the API key that sent it.

    job_id: of the job that made it, which may be deleted since; None for what was sent in.
    """

    id: str
    kind: str
    name: str
    sha256: str
    bytes: int
    content: dict[str, Any]
    owner: str | None
    created_at: float
    job_id: str | None = None
    pinned: bool = False


class Uploads:
    """The uploads of a data folder: files in `folder`, one row each in the database."""

    def __init__(self, folder: Path, store: Store, limits: Limits) -> None:
        self.folder = folder
        self._most_mb = limits.uploads_mb
        self._store = store
        self._turn = threading.Lock()  # a file and its row come and go together
        self._drafts = 0
        self._incoming: dict[Path, int] = {}  # bytes of each draft so far
        self.checking = asyncio.Semaphore(1)  # looking into files: one at a time
        for left in folder.glob(f"*{_PART}*"):  # by a server that died
            left.unlink(missing_ok=True)

    def draft(self, suffix: str) -> Path:
        """A new name in the folder, for a file that is still coming in."""
        self.folder.mkdir(parents=True, exist_ok=True)
        with self._turn:
            self._drafts += 1
            return self.folder / f"{os.getpid()}-{self._drafts}{_PART}{suffix}"

    def grow(self, draft: Path, more: int) -> None:
        """Count bytes of a draft before they are written: what is still coming in takes room too.

        Raises UploadsFullError.
        """
        with self._turn:
            with self._store.reading() as connection:
                kept = connection.execute(select(func.coalesce(func.sum(upload.c.bytes), 0))).scalar_one()
            total_mb = (kept + sum(self._incoming.values()) + more) / 1e6
            if total_mb > self._most_mb:
                coming = "all uploads, with those that are coming in,"
                message = f"{coming} would be {total_mb:.4g} MB, at most {self._most_mb:g} are kept: delete some"
                raise UploadsFullError(message)
            self._incoming[draft] = self._incoming.get(draft, 0) + more

    def drop(self, draft: Path) -> None:
        """Nothing of the draft is left, whether it was kept or not. Idempotent."""
        with self._turn:
            self._incoming.pop(draft, None)
        draft.unlink(missing_ok=True)

    def find(self, upload_id: str) -> Upload | None:
        """The upload of this id, if there is one."""
        with self._store.reading() as connection:
            return _read(connection, upload_id)

    def get(self, upload_id: str) -> Upload:
        """Raises UnknownUploadError."""
        found = self.find(upload_id)
        if found is None:
            raise UnknownUploadError(f"there is no upload {upload_id}")
        return found

    def newest(self, *, limit: int, kind: str | None = None) -> list[Upload]:
        """Newest first."""
        return self.page(size=limit, cursor=None, kind=kind).items

    def page(self, *, size: int, cursor: str | None, kind: str | None = None) -> Page[Upload]:
        """A page, newest first; cursor: of the page before."""
        columns = [upload.c[item.name] for item in fields(Upload)]
        query = select(_ARRIVED.label("seq"), *columns).order_by(_ARRIVED.desc())
        if kind is not None:
            query = query.where(upload.c.kind == kind)

        def newest(most: int, before: int | None) -> list[Row[Any]]:
            older = query if before is None else query.where(before > _ARRIVED)
            with self._store.reading() as connection:
                return list(connection.execute(older.limit(most)))

        page = read_page(newest, size=size, cursor=cursor)
        names = [item.name for item in fields(Upload)]
        items = [Upload(**{name: getattr(row, name) for name in names}) for row in page.items]
        return Page(items, page.next_cursor)

    def path(self, found: Upload) -> Path:
        """Where its file is."""
        return self.folder / found.id

    def keep(
        self,
        draft: Path,
        *,
        kind: str,
        name: str,
        sha256: str,
        content: dict[str, Any],
        owner: str | None,
        job_id: str | None = None,
    ) -> tuple[Upload, bool]:
        """Make a complete, checked draft an upload; whether it is new. Raises UploadsFullError.

        job_id: of the job that made it, which names it from now on.
        """
        new = Upload(
            id=f"{sha256}{draft.suffix}",
            kind=kind,
            name=name,
            sha256=sha256,
            bytes=draft.stat().st_size,
            content=content,
            owner=owner,
            created_at=self._store.now,
            job_id=job_id,
        )
        with self._turn:
            self._check_room(new)
            draft.replace(self.path(new))
            _flush(self.folder)
            with self._store.writing() as connection:
                known = _read(connection, new.id)
                if known is None:
                    row = {item.name: getattr(new, item.name) for item in fields(Upload)}
                    connection.execute(insert(upload).values(row))
                if job_id is not None:
                    _name(connection, job_id, new.id)
        return known or new, known is None

    def keep_made(self, made: Path, job: Job, described: dict[str, Any]) -> Upload:
        """Make the model that a job wrote and described in its result an upload, by a copy. Idempotent.

        Raises UploadsFullError, OSError.
        """
        name = f"{job.name}.json"
        content = {key: value for key, value in described.items() if key not in ("id", "bytes")}
        draft = self.draft(made.suffix)
        try:
            with made.open("rb") as source, draft.open("xb") as target:
                sha256 = hashlib.file_digest(source, "sha256").hexdigest()
                source.seek(0)
                shutil.copyfileobj(source, target)
                target.flush()
                os.fsync(target.fileno())
            kept, _ = self.keep(
                draft, kind="model", name=name, sha256=sha256, content=content, owner=job.owner, job_id=job.id
            )
            return kept
        finally:
            draft.unlink(missing_ok=True)

    def _check_room(self, new: Upload) -> None:
        others = select(func.coalesce(func.sum(upload.c.bytes), 0)).where(upload.c.id != new.id)
        with self._store.reading() as connection:
            total_mb = (connection.execute(others).scalar_one() + new.bytes) / 1e6
        if total_mb > self._most_mb:
            message = f"all uploads would be {total_mb:.4g} MB, at most {self._most_mb:g} are kept: delete some"
            raise UploadsFullError(message)

    def pin(self, upload_id: str, *, pinned: bool) -> Upload:
        """Keep it out of every retention, or no longer. Idempotent. Raises UnknownUploadError."""
        with self._store.writing() as connection:
            connection.execute(update(upload).where(upload.c.id == upload_id).values(pinned=pinned))
        return self.get(upload_id)

    def delete(self, upload_id: str) -> None:
        """Raises UnknownUploadError, and UploadInUseError while it is pinned or a queued or running job names it."""
        active = select(job.c.id).join(job_upload, job_upload.c.job_id == job.c.id)
        active = active.where(job_upload.c.upload_id == upload_id, job.c.state.in_((QUEUED, RUNNING))).limit(1)
        with self._turn:
            with self._store.writing() as connection:
                found = _read(connection, upload_id)
                if found is None:
                    raise UnknownUploadError(f"there is no upload {upload_id}")
                if found.pinned:
                    raise UploadInUseError(f"the upload {upload_id} is pinned")
                if (user := connection.execute(active).scalar_one_or_none()) is not None:
                    raise UploadInUseError(f"job {user} has not ended and uses the upload {upload_id}")
                connection.execute(delete(upload).where(upload.c.id == upload_id))
            (self.folder / upload_id).unlink(missing_ok=True)

    def clear(self, older_than_s: float | None, *, without: Collection[str], dry_run: bool) -> list[Upload]:
        """Delete uploads older than this that nothing names, jobs `without` aside; files without a row go too.

        Returns those that went, or would go. None = of no age.
        """
        with self._turn:
            with self._store.writing() as connection:
                going = []
                if older_than_s is not None:
                    before = select(upload).where(upload.c.created_at < self._store.now - older_than_s)
                    old = [Upload(**row._mapping) for row in connection.execute(before.order_by(upload.c.created_at))]
                    going = _unused(connection, [one for one in old if not one.pinned], without)
                if dry_run:
                    return going
                for one in going:
                    connection.execute(delete(upload).where(upload.c.id == one.id))
                known = set(connection.execute(select(upload.c.id)).scalars())
            for path in self.folder.glob("*"):
                if path.name not in known and _PART not in path.name:
                    path.unlink(missing_ok=True)
        return going


def _unused(connection: Connection, old: list[Upload], without: Collection[str]) -> list[Upload]:
    """Those of the old ones that no job, campaign or schedule names, and no model that stays was trained on."""
    if not old:
        return []
    pairs = connection.execute(select(job_upload.c.job_id, job_upload.c.upload_id))
    named = {upload_id for job_id, upload_id in pairs if job_id not in without}
    for table in (campaign, schedule):
        for request in connection.execute(select(table.c.request)).scalars():
            named |= {upload_id for _, upload_id in references(request)}
    free = {one.id for one in old if one.id not in named}
    models = connection.execute(select(upload.c.id, upload.c.content).where(upload.c.kind == "model"))
    learned = {(content.get("provenance") or {}).get("data_sha256") for model, content in models if model not in free}
    return [one for one in old if one.id in free and (one.kind != "dataset" or one.sha256 not in learned)]


def _read(connection: Connection, upload_id: str) -> Upload | None:
    row = connection.execute(select(upload).where(upload.c.id == upload_id)).one_or_none()
    return None if row is None else Upload(**row._mapping)


def _name(connection: Connection, job_id: str, upload_id: str) -> None:
    """Say that the job names the upload."""
    row = {"job_id": job_id, "upload_id": upload_id}
    known = select(job_upload).where(job_upload.c.job_id == job_id, job_upload.c.upload_id == upload_id)
    if connection.execute(known).one_or_none() is None:
        connection.execute(insert(job_upload).values(row))


def _flush(folder: Path) -> None:
    """The new name of a file reaches the disk with its folder (not on Windows, which has no such call)."""
    if os.name != "nt":
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
