"""The JSON of campaigns, comparisons and trends."""

from __future__ import annotations

import math
from datetime import datetime
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, model_validator

from benchmarks.paper.comparison import as_json
from service.admission.pace import Pace
from service.api.root_path import rooted
from service.api.schemas.timestamps import utc
from service.campaigns.cases import CaseResult
from service.campaigns.comparison import CampaignComparison
from service.campaigns.overview import CampaignOverview
from service.campaigns.trends import SuiteTrend, TrendRun
from service.store.campaign import CampaignPlan

CampaignState = Literal["running", "done", "cancelled"]
ArmName = Annotated[str, StringConstraints(min_length=1, max_length=200)]


class CampaignLinks(BaseModel):
    """Addresses of everything else about a campaign."""

    self: str
    cancel: str
    jobs: str
    results: str
    report: str


class CampaignView(BaseModel):
    """A campaign. jobs: how many of its jobs are in which state; fraction: share of its steps that are done."""

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
    def of(cls, overview: CampaignOverview) -> Self:
        """The JSON of a campaign and its progress."""
        campaign = overview.campaign
        base = rooted(f"/api/v1/campaigns/{campaign.id}")
        return cls(
            id=campaign.id,
            name=campaign.name,
            suite=campaign.suite,
            suite_sha256=campaign.suite_sha256,
            state=campaign.state,
            cancelling=campaign.cancel_requested and not campaign.terminal,
            request=campaign.request,
            cases=campaign.cases,
            jobs=overview.tally.states,
            fraction=overview.fraction,
            eta_s=overview.eta_s,
            priority=campaign.priority,
            timeout_s=campaign.timeout_s,
            schedule=campaign.schedule_id,
            created_at=utc(campaign.created_at),
            finished_at=utc(campaign.finished_at),
            links=CampaignLinks(
                self=base,
                cancel=f"{base}/cancel",
                jobs=f"{base}/jobs",
                results=f"{base}/results",
                report=f"{base}/report",
            ),
        )


class CampaignPage(BaseModel):
    """Campaigns, newest first; next_cursor leads to the older ones, null at the end."""

    items: list[CampaignView]
    next_cursor: str | None


class CampaignDryRun(BaseModel):
    """What a campaign would run. seconds: wall time of all of it on the service's workers, nothing else running, with
    the band in which it lies by the pace of the last `measured_on` insertions."""

    name: str
    suite: str
    suite_sha256: str
    jobs: int
    steps: int
    seconds: float
    seconds_low: float
    seconds_high: float
    measured_on: int
    first: list[str] = Field(description="Ids of the first cases.")

    @classmethod
    def of(cls, plan: CampaignPlan, pace: Pace, *, workers: int) -> Self:
        """The JSON of a plan."""
        low, seconds, high = pace.seconds(plan.cost_s / workers)
        return cls(
            name=plan.name,
            suite=plan.suite,
            suite_sha256=plan.suite_sha256,
            jobs=len(plan.jobs),
            steps=sum(job.steps for job in plan.jobs),
            seconds=seconds,
            seconds_low=low,
            seconds_high=high,
            measured_on=pace.insertions,
            first=[job.case_id for job in plan.jobs[:10]],
        )


class CampaignCaseView(BaseModel):
    """One insertion of a campaign; job: null once it was deleted."""

    case: str
    labels: dict[str, Any]
    job: str | None
    state: str | None
    status: str | None
    success: bool | None
    outcome: str = Field(description="success, missed or the status; the error of a job that left no result.")
    rmse_commanded_mm: float | None
    beside: dict[str, float | None] = Field(description="What the error may have been paid with, by metric.")
    warnings: list[str]
    digest: str | None

    @classmethod
    def of(cls, row: CaseResult) -> Self:
        """The JSON of one insertion."""
        names = ("labels", "state", "status", "success", "outcome", "rmse_commanded_mm", "beside")
        return cls(
            case=row.case_id,
            job=row.job_id,
            warnings=row.warnings,
            digest=row.digest,
            **{name: getattr(row, name) for name in names},
        )


class CampaignCaseList(BaseModel):
    """The insertions of a campaign, in the order of their numbers; next_cursor leads on, null at the end."""

    items: list[CampaignCaseView]
    next_cursor: str | None


class SuiteView(BaseModel):
    """A named suite."""

    name: str
    title: str


class SuiteList(BaseModel):
    """The named suites."""

    items: list[SuiteView]


class ComparisonRequest(BaseModel):
    """Two campaigns; or one, with two of its arms or all of them."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={
            "examples": [
                {"campaigns": ["1f0c9d2b7a6e5d43", "9a8b7c6d5e4f3a21"]},
                {"campaigns": ["1f0c9d2b7a6e5d43"], "arms": ["ifem", "elm"]},
                {"campaigns": ["1f0c9d2b7a6e5d43"]},
            ]
        },
    )

    campaigns: Annotated[list[Annotated[str, StringConstraints(pattern="^[0-9a-z]{1,32}$")]], Field(max_length=2)]
    arms: Annotated[list[ArmName], Field(min_length=2, max_length=2)] | None = Field(
        None, description="Two arms of one campaign by name; null: all of its arms against each other."
    )

    @model_validator(mode="after")
    def _two_things(self) -> ComparisonRequest:
        if not self.campaigns or (self.arms is not None and len(self.campaigns) > 1):
            raise ValueError("must have two campaigns, or one campaign and two of its arms or none")
        return self


class ComparisonView(BaseModel):
    """Paired tests of the RMSE; differences are first minus second in mm: below zero the first is better. A test says
    what its unit is (`unit`), how many there are (`clusters`) and why (`notes`); `p_holm` is adjusted for all tests."""

    campaigns: list[str]
    arms: list[str] | None
    same_digests: int | None = Field(description="Cases with the same digest in both campaigns.")
    shared_cases: int | None
    comparisons: list[dict[str, Any]]

    @classmethod
    def of(cls, comparison: CampaignComparison) -> Self:
        """The JSON of a comparison."""
        names = ("campaigns", "arms", "same_digests", "shared_cases")
        return cls(**{name: getattr(comparison, name) for name in names}, comparisons=as_json(comparison.tests))


class TrendPoint(BaseModel):
    """One campaign of a suite and its marks against earlier ones."""

    campaign: str
    at: datetime
    commit: str | None
    machine: str
    cases: int
    successes: int
    median_rmse_mm: float | None
    beside: dict[str, float | None] = Field(description="Medians of what the error may have been paid with, by metric.")
    step_ms: float | None
    accuracy: str
    accuracy_why: str
    success: str
    success_why: str
    time: str
    time_why: str
    regression: bool

    @classmethod
    def of(cls, run: TrendRun) -> Self:
        """The JSON of one run."""
        point, mark = run.point, run.judgement
        marks = ("accuracy", "accuracy_why", "success", "success_why", "time", "time_why", "regression")
        return cls(
            campaign=run.campaign.id,
            at=utc(point.at),
            commit=point.commit,
            machine=point.machine,
            cases=len(point.rmse_commanded_mm),
            successes=point.successes,
            median_rmse_mm=point.median_rmse_mm if math.isfinite(point.median_rmse_mm) else None,
            beside=dict(point.beside),
            step_ms=point.step_ms,
            **{name: getattr(mark, name) for name in marks},
        )


class TrendLoss(BaseModel):
    """What got worse and has not recovered since. good_commit: of the run before it got worse."""

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

    @classmethod
    def of(cls, trend: SuiteTrend) -> Self:
        """The JSON of a suite's history."""
        losses = [
            TrendLoss(
                figure=loss.figure,
                campaign=trend.runs[loss.since].campaign.id,
                at=utc(trend.runs[loss.since].point.at),
                commit=trend.runs[loss.since].point.commit,
                good_commit=trend.runs[loss.since - 1].point.commit,
                why=loss.why,
            )
            for loss in trend.losses
        ]
        return cls(suite=trend.suite, points=[TrendPoint.of(run) for run in trend.runs], losses=losses)


class SuiteNames(BaseModel):
    """Suites that have a history."""

    items: list[str]
