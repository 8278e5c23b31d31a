"""The JSON of campaigns, schedules, comparisons and trends."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, model_validator

from service.admission.campaign_planner import CampaignRequest
from service.api.schemas.jobs import moment
from service.store.campaign import Campaign, Tally
from service.store.schedule import Catchup, Overlap, Schedule, ScheduleRun

CampaignState = Literal["running", "done", "cancelled"]
Name = Annotated[str, StringConstraints(min_length=1, max_length=100)]


class CampaignLinks(BaseModel):
    """Where the rest of a campaign is."""

    self: str
    cancel: str
    jobs: str
    results: str
    report: str


class CampaignView(BaseModel):
    """A campaign. jobs: how many of its jobs are in which state; fraction: of its steps, done."""

    id: str
    name: str
    suite: str
    suite_sha256: str
    state: CampaignState
    cancelling: bool
    request: dict[str, Any]
    cases: int
    jobs: dict[str, int]
    fraction: float
    eta_s: float | None = Field(description="Seconds to its end, from the pace so far; null when nothing is known.")
    priority: int
    timeout_s: float
    schedule: str | None
    created_at: datetime
    finished_at: datetime | None
    links: CampaignLinks

    @classmethod
    def of(cls, campaign: Campaign, tally: Tally, now: float) -> Self:
        base = f"/api/v1/campaigns/{campaign.id}"
        fraction = 1.0 if campaign.terminal else tally.steps_done / max(tally.steps, 1)
        return cls(
            id=campaign.id,
            name=campaign.name,
            suite=campaign.suite,
            suite_sha256=campaign.suite_sha256,
            state=campaign.state,
            cancelling=campaign.cancel_requested and not campaign.terminal,
            request=campaign.request,
            cases=campaign.cases,
            jobs=tally.states,
            fraction=fraction,
            eta_s=_eta_s(campaign, fraction, now),
            priority=campaign.priority,
            timeout_s=campaign.timeout_s,
            schedule=campaign.schedule_id,
            created_at=moment(campaign.created_at),
            finished_at=moment(campaign.finished_at),
            links=CampaignLinks(
                self=base,
                cancel=f"{base}/cancel",
                jobs=f"{base}/jobs",
                results=f"{base}/results",
                report=f"{base}/report",
            ),
        )


def _eta_s(campaign: Campaign, fraction: float, now: float) -> float | None:
    if campaign.terminal:
        return 0.0
    return (now - campaign.created_at) * (1.0 - fraction) / fraction if fraction > 0.0 else None


class CampaignPage(BaseModel):
    """Campaigns, newest first; next_cursor leads to the older ones, null at the end."""

    items: list[CampaignView]
    next_cursor: str | None


class CampaignDryRun(BaseModel):
    """What a campaign would run. seconds: estimate for all of it on the service's workers, nothing else running."""

    name: str
    suite: str
    suite_sha256: str
    jobs: int
    steps: int
    seconds: float
    first: list[str] = Field(description="Ids of the first cases.")


class CampaignCaseView(BaseModel):
    """One insertion of a campaign; job: null once it was deleted."""

    case: str
    labels: dict[str, Any]
    job: str | None
    state: str | None
    status: str | None
    success: bool | None
    rmse_mm: float | None
    digest: str | None


class CampaignCaseList(BaseModel):
    items: list[CampaignCaseView]


class SuiteView(BaseModel):
    """A named suite."""

    name: str
    title: str


class SuiteList(BaseModel):
    items: list[SuiteView]


class ScheduleRequest(BaseModel):
    """A campaign that is run again and again."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={
            "examples": [
                {
                    "name": "nightly",
                    "cron": "0 2 * * *",
                    "timezone": "Europe/Paris",
                    "campaign": {"suite": "lin100-v1-quick"},
                }
            ]
        },
    )

    name: Name
    cron: Annotated[str, StringConstraints(min_length=1, max_length=200)] = Field(
        description="minute hour day month weekday, as in 0 2 * * * (every night at two)"
    )
    timezone: Annotated[str, StringConstraints(min_length=1, max_length=64)] = Field(
        "UTC", description="Name of an IANA time zone, in which the line is read."
    )
    catchup: Catchup = Field(
        "latest", description="Ticks missed while the service was down: skip them, run the latest one, or all."
    )
    overlap: Overlap = Field(
        "forbid", description="A tick while the campaign before still runs: forbid skips it, replace cancels that one."
    )
    enabled: bool = True
    campaign: CampaignRequest

    def values(self) -> dict[str, Any]:
        """Columns of the schedule table."""
        data = self.model_dump(exclude={"campaign"})
        return {**data, "request": self.campaign.model_dump(mode="json", exclude_defaults=True)}


class SchedulePatch(BaseModel):
    """What is to be changed of a schedule; what is left out stays."""

    model_config = ConfigDict(
        extra="forbid", json_schema_extra={"examples": [{"enabled": False}, {"cron": "0 3 * * *", "timezone": "UTC"}]}
    )

    name: Name | None = None
    cron: Annotated[str, StringConstraints(min_length=1, max_length=200)] | None = None
    timezone: Annotated[str, StringConstraints(min_length=1, max_length=64)] | None = None
    catchup: Catchup | None = None
    overlap: Overlap | None = None
    enabled: bool | None = None
    campaign: CampaignRequest | None = None

    def values(self) -> dict[str, Any]:
        """Columns of the schedule table that change."""
        data = self.model_dump(exclude={"campaign"}, exclude_none=True)
        if self.campaign is not None:
            data["request"] = self.campaign.model_dump(mode="json", exclude_defaults=True)
        return data


class ScheduleView(BaseModel):
    """A schedule; next_run_at: null while it is disabled."""

    id: str
    name: str
    cron: str
    timezone: str
    catchup: Catchup
    overlap: Overlap
    enabled: bool
    campaign: dict[str, Any]
    next_run_at: datetime | None
    created_at: datetime
    version: int

    @classmethod
    def of(cls, one: Schedule) -> Self:
        names = ("id", "name", "cron", "timezone", "catchup", "overlap", "enabled", "version")
        next_run_at = moment(one.next_run_at) if one.enabled else None
        return cls(
            **{name: getattr(one, name) for name in names},
            campaign=one.request,
            next_run_at=next_run_at,
            created_at=moment(one.created_at),
        )


class ScheduleList(BaseModel):
    items: list[ScheduleView]


class ScheduleRunView(BaseModel):
    """What became of one tick. campaign: the one that it started."""

    scheduled_for: datetime
    fired_at: datetime
    outcome: Literal["started", "missed", "overlap", "failed"]
    campaign: str | None
    message: str | None

    @classmethod
    def of(cls, run: ScheduleRun) -> Self:
        return cls(
            scheduled_for=moment(run.scheduled_for),
            fired_at=moment(run.fired_at),
            outcome=run.outcome,
            campaign=run.campaign_id,
            message=run.message,
        )


class ScheduleRunList(BaseModel):
    items: list[ScheduleRunView]


class ComparisonRequest(BaseModel):
    """Two campaigns, or two controllers of one."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={
            "examples": [
                {"campaigns": ["1f0c9d2b7a6e5d43", "9a8b7c6d5e4f3a21"]},
                {"campaigns": ["1f0c9d2b7a6e5d43"], "controllers": ["ifem", "elm"]},
            ]
        },
    )

    campaigns: Annotated[list[Annotated[str, StringConstraints(pattern="^[0-9a-z]{1,32}$")]], Field(max_length=2)]
    controllers: Annotated[list[Name], Field(min_length=2, max_length=2)] | None = None

    @model_validator(mode="after")
    def _two_things(self) -> ComparisonRequest:
        if len(self.campaigns) != (2 if self.controllers is None else 1):
            raise ValueError("must have two campaigns, or one campaign and two controllers")
        return self


class ComparisonView(BaseModel):
    """Paired tests of the RMSE; differences are first minus second in mm: below zero the first is better."""

    campaigns: list[str]
    controllers: list[str] | None
    same_digests: int | None = Field(description="Cases with the same digest in both campaigns.")
    shared_cases: int | None
    comparisons: list[dict[str, Any]]


class TrendPoint(BaseModel):
    """One campaign of a suite and what became of it against those before."""

    campaign: str
    at: datetime
    commit: str | None
    machine: str
    cases: int
    successes: int
    median_rmse_mm: float | None
    step_ms: float | None
    accuracy: str
    accuracy_why: str
    success: str
    success_why: str
    time: str
    time_why: str
    regression: bool


class TrendLoss(BaseModel):
    """What got worse and has not been mended since. good_commit: of the run before it got worse."""

    figure: str = Field(description="accuracy or success")
    campaign: str
    at: datetime
    commit: str | None
    good_commit: str | None
    why: str = Field(description="The last run against the one before it got worse.")


class Trend(BaseModel):
    """The history of a suite, oldest first."""

    suite: str
    points: list[TrendPoint]
    losses: list[TrendLoss]


class SuiteNames(BaseModel):
    """Suites that have a history."""

    items: list[str]
