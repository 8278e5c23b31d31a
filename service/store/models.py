"""The models that a service knows: the bundled ones, those that were sent in, those that its jobs have trained."""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, Literal

from sqlalchemy import select

from service.files.model_content import model_content
from service.files.upload_names import SCHEME, UPLOAD_ID
from service.store.job_queries import LISTED, to_job
from service.store.paging import Page
from service.store.schema import job, job_upload
from simcore.errors import NeedlebenchError

if TYPE_CHECKING:
    from pathlib import Path

    from service.store.job import Job
    from service.store.jobs import Store
    from service.store.uploads import Upload, Uploads

KIND = "[a-z]{1,16}"
MODEL_ID = rf"({KIND}|{UPLOAD_ID})"
LOOKED_THROUGH = 2000  # of the latest jobs, for those that used a bundled model
Source = Literal["packaged", "uploaded", "trained"]


class UnknownModelError(NeedlebenchError, LookupError):
    """There is no model of this id."""


@dataclass(frozen=True, kw_only=True)
class Model:
    """One model. id: its kind for a bundled one, else that of its upload. reference: what `controller.model`
    says to steer by it, with `controller.kind` = kind. job_id: of the training. content: of `learned_content`."""

    id: str
    reference: str
    source: Source
    kind: str
    name: str
    sha256: str
    bytes: int
    settings: dict[str, Any]
    provenance: dict[str, Any]
    path: Path
    created_at: float | None = None
    job_id: str | None = None
    owner: str | None = None
    pinned: bool = False


class Models:
    """The models of a data folder and of this installation."""

    def __init__(self, uploads: Uploads, store: Store) -> None:
        self._uploads = uploads
        self._store = store

    def all(self, *, limit: int) -> list[Model]:
        """Those of this service, newest first, then the bundled ones."""
        return self._own(self._uploads.newest(limit=limit, kind="model")) + packaged()

    def page(self, *, size: int, cursor: str | None) -> Page[Model]:
        """A page of the same list; the bundled ones are on the last."""
        found = self._uploads.page(size=size, cursor=cursor, kind="model")
        bundled = packaged() if found.next_cursor is None else []
        return Page(self._own(found.items) + bundled, found.next_cursor)

    def _own(self, found: list[Upload]) -> list[Model]:
        return [self._of(upload) for upload in found if "kind" in upload.content]

    def get(self, model_id: str) -> Model:
        """Raises UnknownModelError."""
        for model in packaged() if re.fullmatch(KIND, model_id) else ():
            if model.id == model_id:
                return model
        upload = self._uploads.find(model_id)
        if upload is None or upload.kind != "model" or "kind" not in upload.content:
            raise UnknownModelError(f"there is no model {model_id}")
        return self._of(upload)

    def _of(self, upload: Upload) -> Model:
        return Model(
            id=upload.id,
            reference=f"{SCHEME}{upload.id}",
            source="uploaded" if upload.job_id is None else "trained",
            kind=upload.content["kind"],
            name=upload.name,
            sha256=upload.sha256,
            bytes=upload.bytes,
            settings=upload.content["settings"],
            provenance=upload.content["provenance"],
            path=self._uploads.path(upload),
            created_at=upload.created_at,
            job_id=upload.job_id,
            owner=upload.owner,
            pinned=upload.pinned,
        )

    def used_by(self, model: Model, *, limit: int) -> list[Job]:
        """Jobs that steer by it, newest first, without spec and result; of a bundled model, those among the
        latest 2000 jobs."""
        says = job.c.spec["scenario"]["controller"]["model_sha256"].as_string() == model.sha256
        query = select(*LISTED).where(says).order_by(job.c.seq.desc()).limit(limit)
        if model.source == "packaged":
            oldest = select(job.c.seq).order_by(job.c.seq.desc()).limit(1).offset(LOOKED_THROUGH - 1).scalar_subquery()
            query = query.where((job.c.seq >= oldest) | oldest.is_(None))
        else:
            query = query.join(job_upload, job_upload.c.job_id == job.c.id).where(job_upload.c.upload_id == model.id)
        with self._store.reading() as connection:
            return [to_job(row) for row in connection.execute(query)]


@cache
def packaged() -> list[Model]:
    """The bundled models, by kind."""
    from simcore.learning.trained import PACKAGED

    return [_packaged(path) for path in sorted(PACKAGED.glob("*.json"))]


def _packaged(path: Path) -> Model:
    from simcore.learning.trained import DEFAULT

    content = model_content(path)
    data = path.read_bytes()
    return Model(
        id=content["kind"],
        reference=DEFAULT,
        source="packaged",
        kind=content["kind"],
        name=path.name,
        sha256=hashlib.sha256(data).hexdigest(),
        bytes=len(data),
        settings=content["settings"],
        provenance=content["provenance"],
        path=path,
    )
