"""The JSON of uploaded files."""

from __future__ import annotations

from datetime import datetime
from typing import Any, Literal, Self

from pydantic import BaseModel, Field

from service.api.root_path import rooted
from service.api.schemas.timestamps import utc
from service.files.upload_names import SCHEME
from service.store.uploads import Upload

UploadKind = Literal["mesh", "model", "dataset", "poses"]


class UploadView(BaseModel):
    """An uploaded file. `reference` is how a scenario refers to it."""

    id: str
    reference: str
    kind: UploadKind
    name: str = Field(description="Its name, as uploaded.")
    bytes: int
    sha256: str
    content: dict[str, Any] = Field(description="What it contains: nodes, rows, settings, provenance.")
    pinned: bool = Field(description="Kept when old uploads are removed.")
    job: str | None = Field(description="Id of the job that made it; null if it was uploaded.")
    created_at: datetime
    url: str = Field(description="Address of its content.")

    @classmethod
    def of(cls, upload: Upload) -> Self:
        """The JSON of an upload."""
        names = ("id", "kind", "name", "bytes", "sha256", "content", "pinned")
        return cls(
            **{name: getattr(upload, name) for name in names},
            reference=f"{SCHEME}{upload.id}",
            job=upload.job_id,
            created_at=utc(upload.created_at),
            url=rooted(f"/api/v1/uploads/{upload.id}/content"),
        )


class UploadList(BaseModel):
    """Uploaded files, newest first; next_cursor leads to the older ones, null at the end."""

    items: list[UploadView]
    next_cursor: str | None
