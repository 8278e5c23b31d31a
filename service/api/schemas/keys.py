"""The JSON of API keys."""

from __future__ import annotations

from datetime import datetime
from typing import Literal, Self

from pydantic import BaseModel, ConfigDict, Field, field_validator

from service.api.schemas.timestamps import utc
from service.store.keys import ApiKey

Scope = Literal["read", "submit", "admin"]


class KeyRequest(BaseModel):
    """An API key to be created."""

    model_config = ConfigDict(extra="forbid", json_schema_extra={"examples": [{"scope": "submit", "note": "nightly"}]})

    scope: Scope = Field(description="Steps: admin includes submit, submit includes read.")
    note: str = Field("", max_length=200, description="Who or what it is for; printable characters.")

    @field_validator("note")
    @classmethod
    def _printable(cls, value: str) -> str:
        if not value.isprintable():
            raise ValueError("must be printable characters")
        return value


class KeyView(BaseModel):
    """An API key without its secret. used_at is to the minute."""

    id: str
    scope: Scope
    note: str
    created_at: datetime
    used_at: datetime | None
    revoked_at: datetime | None

    @classmethod
    def of(cls, key: ApiKey) -> Self:
        """The JSON of a key."""
        return cls(
            id=key.id,
            scope=key.scope,
            note=key.note,
            created_at=utc(key.created_at),
            used_at=utc(key.used_at),
            revoked_at=utc(key.revoked_at),
        )


class CreatedKey(KeyView):
    """A new API key."""

    key: str = Field(description="The key to send as Authorization: Bearer KEY; it is not shown again.")


class KeyList(BaseModel):
    """API keys, oldest first."""

    items: list[KeyView]
