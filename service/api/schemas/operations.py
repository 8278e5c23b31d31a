"""The JSON of the routes for those who run the service."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field

from service.engine.health_checks import Check
from service.engine.retention import Cleared


class Health(BaseModel):
    status: Literal["ok"] = "ok"


class CheckView(BaseModel):
    """One thing that was looked at."""

    name: str
    level: Literal["ok", "warn", "bad"]
    found: str
    advice: str = Field(description="What to do if it is not well.")

    @classmethod
    def of(cls, check: Check) -> Self:
        return cls(**asdict(check))


class Readiness(BaseModel):
    status: Literal["ready", "starting"]
    workers: int = Field(description="Slots for jobs.")
    workers_ready: int = Field(description="Slots with a warm worker process.")
    problem: str | None
    warnings: list[str] = Field(description="What an operator should know, such as a disk that runs short.")
    checks: list[CheckView]


class ClearRequest(BaseModel):
    """Which jobs that have ended may go. Without a rule only folders without a job go."""

    model_config = ConfigDict(
        extra="forbid", json_schema_extra={"examples": [{"older_than_s": 2592000, "dry_run": True}]}
    )

    older_than_s: Annotated[
        float | None, Field(strict=True, ge=0, le=1e10, allow_inf_nan=False, description="Ended longer ago.")
    ] = None
    keep_last: Annotated[
        int | None, Field(strict=True, ge=0, le=10**9, description="Never the newest so many; alone, all but these go.")
    ] = None
    max_bytes: Annotated[
        int | None, Field(strict=True, ge=0, le=2**62, description="Then the oldest, until the rest holds no more.")
    ] = None
    dry_run: Annotated[bool, Field(strict=True, description="Only tell what would go.")] = False


class ClearedView(BaseModel):
    """What went, or with a dry run would go."""

    jobs: list[str]
    orphans: list[str] = Field(description="Folders that belonged to no job, or to an earlier attempt.")
    uploads: list[str] = Field(description="Uploads that nothing names any more.")
    bytes: int
    kept: int = Field(description="Jobs that have ended and stay.")
    kept_bytes: int

    @classmethod
    def of(cls, cleared: Cleared) -> Self:
        return cls(**asdict(cleared))
