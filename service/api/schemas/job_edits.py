"""The JSON of what people say about jobs, and of one action over many of them."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, field_validator

from service.api.problem_codes import CODES
from service.store.job import MOST_TAGS, Label, Note, Tag

MOST_JOBS = 200  # of one action
Action = Literal["cancel", "retry", "pin", "unpin", "delete"]
JobIdText = Annotated[str, Field(min_length=1, max_length=32, pattern="^[0-9a-z]+$")]


class JobPatch(BaseModel):
    """What is said about a job; fields that are left out keep their values. Its scenario keeps its own name."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={
            "examples": [{"tags": ["liver", "paper-2"]}, {"name": "softer liver", "note": "Looks odd near the end."}]
        },
    )

    name: Label | None = None
    tags: Annotated[list[Tag], Field(max_length=MOST_TAGS)] | None = Field(
        None, description="All of its tags; each of at most 40 characters, without commas."
    )
    note: Note | None = Field(None, description="At most 4000 characters; an empty one removes it.")

    @field_validator("tags")
    @classmethod
    def _once(cls, tags: list[str] | None) -> list[str] | None:
        return None if tags is None else list(dict.fromkeys(tags))

    def values(self) -> dict[str, Any]:
        """Columns of the job table that change."""
        return self.model_dump(exclude_none=True)


class JobsAction(BaseModel):
    """One thing to do to many jobs."""

    model_config = ConfigDict(
        extra="forbid", json_schema_extra={"examples": [{"action": "cancel", "jobs": ["5f2b8c0d9e1a4b37"]}]}
    )

    action: Action
    jobs: Annotated[list[JobIdText], Field(min_length=1, max_length=MOST_JOBS, description="Ids of jobs, each once.")]

    @field_validator("jobs")
    @classmethod
    def _each_once(cls, jobs: list[str]) -> list[str]:
        return list(dict.fromkeys(jobs))


class JobActionOutcome(BaseModel):
    """What came of an action for one job. code, detail: of the problem, null where it was done."""

    job: str
    done: bool
    code: str | None = Field(None, description="Kind of the problem, as in the errors of a single job.")
    detail: str | None = None

    @classmethod
    def of(cls, job_id: str, code: str | None = None, detail: str | None = None) -> Self:
        """The JSON of it. Raises KeyError for a code that no problem has."""
        if code is not None:
            CODES[code]
        return cls(job=job_id, done=code is None, code=code, detail=detail)


class JobsActionResult(BaseModel):
    """What came of it, job by job, in the order of the request."""

    done: int
    items: list[JobActionOutcome]

    @classmethod
    def of(cls, items: list[JobActionOutcome]) -> Self:
        """The JSON of an action over many jobs."""
        return cls(done=sum(item.done for item in items), items=items)
