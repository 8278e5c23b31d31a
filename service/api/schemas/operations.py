"""The JSON of the routes for operators."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Self

from pydantic import BaseModel, ConfigDict, Field

from service.engine.retention import Cleared


class ClearRequest(BaseModel):
    """Which ended jobs to remove. Without a rule, only folders without a job are removed."""

    model_config = ConfigDict(
        extra="forbid", json_schema_extra={"examples": [{"older_than_s": 2592000, "dry_run": True}]}
    )

    older_than_s: Annotated[
        float | None, Field(strict=True, ge=0, le=1e10, allow_inf_nan=False, description="Jobs that ended longer ago.")
    ] = None
    keep_last: Annotated[
        int | None, Field(strict=True, ge=0, le=10**9, description="Never the newest so many; alone: all but these.")
    ] = None
    max_bytes: Annotated[
        int | None, Field(strict=True, ge=0, le=2**62, description="Then the oldest, until the rest takes no more.")
    ] = None
    dry_run: Annotated[bool, Field(strict=True, description="Only report what would be removed.")] = False


class ClearedView(BaseModel):
    """What was removed, or would be by a dry run."""

    jobs: list[str]
    orphans: list[str] = Field(description="Folders of no job, or of an earlier attempt.")
    uploads: list[str] = Field(description="Uploads that nothing uses any more.")
    bytes: int
    kept: int = Field(description="Ended jobs that remain.")
    kept_bytes: int

    @classmethod
    def of(cls, cleared: Cleared) -> Self:
        """The JSON of what was removed."""
        return cls(**asdict(cleared))
