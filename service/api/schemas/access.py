"""The JSON of uploads and API keys."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, field_validator

from service.api.schemas.jobs import moment
from service.files.upload_names import SCHEME
from service.store.keys import ApiKey
from service.store.uploads import Upload


class UploadView(BaseModel):
    """A file that was sent in. `reference` is what a scenario writes to name it."""

    id: str
    reference: str
    kind: Literal["mesh", "model", "dataset"]
    name: str = Field(description="What its sender calls it.")
    bytes: int
    sha256: str
    content: dict[str, Any] = Field(description="What was found in it: nodes, rows, settings, provenance.")
    pinned: bool = Field(description="Kept whatever is cleared away.")
    job: str | None = Field(description="Id of the job that made it; null for what was sent in.")
    created_at: datetime
    url: str = Field(description="Where its content is.")

    @classmethod
    def of(cls, upload: Upload) -> Self:
        names = ("id", "kind", "name", "bytes", "sha256", "content", "pinned")
        return cls(
            **{name: getattr(upload, name) for name in names},
            reference=f"{SCHEME}{upload.id}",
            job=upload.job_id,
            created_at=datetime.fromtimestamp(upload.created_at, UTC),
            url=f"/api/v1/uploads/{upload.id}/content",
        )


class UploadList(BaseModel):
    items: list[UploadView]


Scope = Literal["read", "submit", "admin"]


class KeyRequest(BaseModel):
    """An API key to be made."""

    model_config = ConfigDict(extra="forbid", json_schema_extra={"examples": [{"scope": "submit", "note": "nightly"}]})

    scope: Scope = Field(description="Steps: admin includes submit, submit includes read.")
    note: str = Field("", max_length=200, description="Whose it is or what for; printable characters.")

    @field_validator("note")
    @classmethod
    def _printable(cls, value: str) -> str:
        if not value.isprintable():
            raise ValueError("must be printable characters")
        return value


class KeyView(BaseModel):
    """An API key without its secret. used_at is kept to the minute."""

    id: str
    scope: Scope
    note: str
    created_at: datetime
    used_at: datetime | None
    revoked_at: datetime | None

    @classmethod
    def of(cls, key: ApiKey) -> Self:
        return cls(
            id=key.id,
            scope=key.scope,
            note=key.note,
            created_at=datetime.fromtimestamp(key.created_at, UTC),
            used_at=moment(key.used_at),
            revoked_at=moment(key.revoked_at),
        )


class KeyMade(KeyView):
    """An API key that was made just now."""

    key: str = Field(description="What to send as Authorization: Bearer KEY; it is not shown again.")


class KeyList(BaseModel):
    items: list[KeyView]
