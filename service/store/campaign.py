"""A campaign as the store knows it: a suite, or a grid, whose cases are jobs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from simcore.errors import NeedlebenchError

if TYPE_CHECKING:
    from benchmarks.cases import Label

RUNNING, DONE, CANCELLED = "running", "done", "cancelled"


class UnknownCampaignError(NeedlebenchError, LookupError):
    """There is no campaign of this id."""


class CampaignActiveError(NeedlebenchError):
    """The campaign, or a job of it that was tried again, still runs: it cannot be deleted."""


class CampaignPinnedError(NeedlebenchError):
    """A job of the campaign is pinned: the campaign cannot be deleted."""


@dataclass(frozen=True, kw_only=True)
class PlannedJob:
    """A case on its way to becoming a job."""

    case_id: str
    labels: dict[str, Label]
    name: str
    spec: dict[str, Any]
    spec_hash: str
    steps: int


@dataclass(frozen=True, kw_only=True)
class CampaignPlan:
    """All that a new campaign is made of."""

    name: str
    request: dict[str, Any]
    suite: str
    suite_sha256: str
    priority: int
    timeout_s: float
    cost_s: float  # estimated processor time of all jobs
    jobs: tuple[PlannedJob, ...]
    uploads: tuple[str, ...] = ()  # ids of those that the jobs read


@dataclass(frozen=True, kw_only=True)
class Campaign:
    """One row of the campaign table. Times are UTC seconds since 1970."""

    seq: int
    id: str
    name: str
    request: dict[str, Any]
    suite: str
    suite_sha256: str
    cases: int
    state: str
    cancel_requested: bool
    priority: int
    timeout_s: float
    schedule_id: str | None
    scheduled_for: float | None
    created_at: float
    finished_at: float | None
    version: int
    owner: str | None = None

    @property
    def terminal(self) -> bool:
        """Whether nothing will happen to it any more."""
        return self.state != RUNNING


@dataclass(frozen=True, kw_only=True)
class Tally:
    """How many jobs of a campaign are where, and how many steps are done of how many."""

    states: dict[str, int]
    steps: int
    steps_done: int


@dataclass(frozen=True, kw_only=True)
class CampaignCase:
    """One case: its job, None once that was deleted, and its result, None before the end. `state` is the job's."""

    number: int
    case_id: str
    labels: dict[str, Label]
    job_id: str | None
    state: str | None
    error_kind: str | None
    error: str | None
    result: dict[str, Any] | None
