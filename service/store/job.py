"""A job as the store knows it, its states and the legal steps between them."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import AfterValidator, Field

from simcore.errors import NeedlebenchError, Problem, Status

if TYPE_CHECKING:
    from collections.abc import Sequence

QUEUED, RUNNING, FINISHED = "queued", "running", "finished"
FAILED, CANCELLED, TIMED_OUT = "failed", "cancelled", "timed_out"

INSERTION, TRAINING = KINDS = ("insertion", "training")  # one simulated insertion; one model learned from a data set

SUCCESS, MISSED = "success", "missed"  # outcomes of a job that finished; else a named status of its run
OUTCOMES = (SUCCESS, MISSED, *(str(status) for status in Status if status is not Status.COMPLETED))


def _printable(text: str) -> str:
    """Line ends, control characters and marks of direction forge lists, logs and headers."""
    if not text.isprintable():
        raise ValueError("must be printable characters, without line ends and marks of direction")
    return text


def _tag(text: str) -> str:
    """Tags are written side by side, with commas between them."""
    if _printable(text) != text.strip() or "," in text:
        raise ValueError("must have no comma, and no blank at its beginning or end")
    return text


def _note(text: str) -> str:
    """Lines of printable characters."""
    text = text.replace("\r\n", "\n").strip()
    if not all(line.isprintable() for line in text.replace("\t", " ").split("\n")):
        raise ValueError("must be lines of printable characters, without marks of direction")
    return text


Label = Annotated[str, Field(min_length=1, max_length=100), AfterValidator(_printable)]  # what people call a thing
Tag = Annotated[str, Field(min_length=1, max_length=40), AfterValidator(_tag)]
Note = Annotated[str, Field(max_length=4000), AfterValidator(_note)]
MOST_TAGS = 20  # of one job
TimeLimit = Annotated[float, Field(strict=True, ge=1, le=86400, allow_inf_nan=False)]  # of a job, s
TIME_LIMIT = "Most wall time of an attempt; null = an hour, or four times the estimate if that is longer."

LEGAL: dict[str, frozenset[str]] = {
    QUEUED: frozenset({RUNNING, CANCELLED}),
    RUNNING: frozenset({FINISHED, FAILED, CANCELLED, TIMED_OUT, QUEUED}),
    FINISHED: frozenset(),
    FAILED: frozenset({QUEUED}),
    CANCELLED: frozenset({QUEUED}),
    TIMED_OUT: frozenset({QUEUED}),
}
TERMINAL = frozenset({FINISHED, FAILED, CANCELLED, TIMED_OUT})  # nothing happens to it unless somebody asks for a retry
MAXIMUM_CRASHES = 3  # deaths of its worker that a job is forgiven, less one
SUSPECT_DEATHS = 3  # of the whole server while a job ran, from which on it waits until nothing else is queued
MAXIMUM_DEATHS = 10  # of the whole server while a job ran, after which they are laid to the job
LOWEST_PRIORITY = -100
ASIDE = frozenset({"pinned", "unpinned", "edited"})  # events that leave the state as it is
CRASHED, REQUEUED = "crashed", "requeued"  # events: back in the queue, after a death or after an orderly stop


class UnknownJobError(NeedlebenchError, LookupError):
    """There is no job of this id."""


class IllegalTransitionError(NeedlebenchError):
    """The job is not in a state from which it may go where it was sent; says in which it is."""

    def __init__(self, job_id: str, state: str, wanted: str) -> None:
        self.job_id, self.state, self.wanted = job_id, state, wanted
        super().__init__(f"job {job_id} is {state}: it cannot become {wanted}")


class JobChangedError(NeedlebenchError):
    """Somebody else changed the job meanwhile."""


class JobPinnedError(IllegalTransitionError):
    """The job is pinned: it is kept until somebody unpins it."""

    def __init__(self, job_id: str) -> None:
        super().__init__(job_id, "pinned", "deleted")


class KeyReusedError(NeedlebenchError):
    """An idempotency key came again with another request."""


class QueueFullError(NeedlebenchError):
    """No more jobs are taken now."""


class UploadGoneError(NeedlebenchError, LookupError):
    """A job names uploads that were deleted meanwhile; `problems` names the fields."""

    def __init__(self, problems: list[Problem]) -> None:
        self.problems = problems
        super().__init__("; ".join(f"{p.field}: {p.message}" for p in problems))


class InputGoneError(NeedlebenchError):
    """A job cannot run again: an upload that it names was deleted since; `problems` names the fields."""

    def __init__(self, job_id: str, problems: list[Problem]) -> None:
        self.problems = problems
        super().__init__(f"job {job_id} cannot run again: " + "; ".join(f"{p.field}: {p.message}" for p in problems))


@dataclass(frozen=True, kw_only=True)
class Artefact:
    """A file that a job left behind. path: relative to the data folder, with forward slashes."""

    kind: str
    name: str
    path: str
    sha256: str
    bytes: int


@dataclass(frozen=True, kw_only=True)
class Event:
    """One entry of the append-only log of a job. at: UTC seconds since 1970."""

    seq: int
    job_id: str
    at: float
    kind: str
    attempt: int
    data: dict[str, Any] | None


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """How an attempt ended: a terminal state and what goes with it. progress: None = as last stored."""

    state: str
    progress: dict[str, Any] | None = None
    result: dict[str, Any] | None = None
    error_kind: str | None = None
    error: str | None = None
    artefacts: tuple[Artefact, ...] = ()
    cpu_s: float | None = None
    max_rss_mb: float | None = None


@dataclass(frozen=True, kw_only=True)
class Job:
    """One row of the job table. Times are UTC seconds since 1970. `spec` and `result` are None in listings.

    outcome: one of OUTCOMES once it has finished, see `outcome_of`.
    """

    seq: int
    id: str
    name: str
    spec: dict[str, Any] | None
    steps: int
    state: str
    priority: int
    timeout_s: float
    attempt: int
    crashes: int
    cancel_requested: bool
    pinned: bool
    heartbeat_at: float | None
    progress: dict[str, Any] | None
    metrics: dict[str, Any] | None
    result: dict[str, Any] | None
    error_kind: str | None
    error: str | None
    cpu_s: float | None
    max_rss_mb: float | None
    created_at: float
    started_at: float | None
    finished_at: float | None
    version: int
    owner: str | None = None
    kind: str = INSERTION
    outcome: str | None = None
    tags: Sequence[str] = ()
    note: str = ""

    @property
    def terminal(self) -> bool:
        """Whether nothing will happen to it any more, unless somebody asks for a retry."""
        return self.state in TERMINAL

    @property
    def folder(self) -> str:
        """Folder of the current attempt, relative to the data folder. An attempt never writes into another's."""
        return f"jobs/{self.id}/{self.attempt}"


def outcome_of(kind: str, result: dict[str, Any] | None) -> str | None:
    """What a job of this kind that left `result` came to; None without a result. A training that left a model is a
    success; an insertion is one, or missed, where it completed, and has the name of its failure where it did not."""
    if result is None:
        return None
    if kind == TRAINING or (result.get("metrics") or {}).get("success"):
        return SUCCESS
    status = str(result.get("status", Status.COMPLETED))
    return status if status in OUTCOMES else MISSED


def content_hash(value: Any) -> str:
    """SHA-256 of JSON data, whatever the order of its fields."""
    return hashlib.sha256(json.dumps(value, sort_keys=True, separators=(",", ":")).encode()).hexdigest()
