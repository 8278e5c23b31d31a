"""The JSON of schedules."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

from service.admission.campaign_planner import CampaignRequest
from service.api.schemas.timestamps import utc
from service.store.job import Label
from service.store.schedule import Catchup, Overlap, Schedule, ScheduleRun, check, in_words, next_ticks


class ScheduleRequest(BaseModel):
    """A campaign that runs at set times."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={
            "examples": [
                {
                    "name": "nightly",
                    "cron": "0 2 * * *",
                    "timezone": "Europe/Paris",
                    "campaign": {"suite": "lin100-v2-quick"},
                }
            ]
        },
    )

    name: Label
    cron: Annotated[str, StringConstraints(min_length=1, max_length=200)] = Field(
        description="minute hour day month weekday, as in 0 2 * * * (every night at two)"
    )
    timezone: Annotated[str, StringConstraints(min_length=1, max_length=64)] = Field(
        "UTC", description="IANA time zone in which the cron line is read."
    )
    catchup: Catchup = Field(
        "latest", description="Ticks missed while the service was down: skip them, run the latest one, or all."
    )
    overlap: Overlap = Field(
        "forbid",
        description="If the previous campaign still runs: forbid skips the tick, allow runs both, replace cancels it.",
    )
    enabled: bool = True
    campaign: CampaignRequest

    def values(self) -> dict[str, Any]:
        """Columns of the schedule table."""
        data = self.model_dump(exclude={"campaign"})
        return {**data, "request": self.campaign.model_dump(mode="json", exclude_defaults=True)}


class SchedulePatch(BaseModel):
    """Changes to a schedule; fields that are left out keep their values."""

    model_config = ConfigDict(
        extra="forbid", json_schema_extra={"examples": [{"enabled": False}, {"cron": "0 3 * * *", "timezone": "UTC"}]}
    )

    name: Label | None = None
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
    words: str = Field(description="The cron line as a sentence.")
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
        """The JSON of a schedule."""
        names = ("id", "name", "cron", "timezone", "catchup", "overlap", "enabled", "version")
        next_run_at = utc(one.next_run_at) if one.enabled else None
        return cls(
            **{name: getattr(one, name) for name in names},
            words=in_words(one.cron, one.timezone),
            campaign=one.request,
            next_run_at=next_run_at,
            created_at=utc(one.created_at),
        )


class ScheduleList(BaseModel):
    """Schedules, by name."""

    items: list[ScheduleView]


class ScheduleRunView(BaseModel):
    """One tick of a schedule and its outcome. campaign: the one that it started."""

    scheduled_for: datetime
    fired_at: datetime
    outcome: Literal["started", "missed", "overlap", "failed"]
    campaign: str | None
    message: str | None

    @classmethod
    def of(cls, run: ScheduleRun) -> Self:
        """The JSON of a run."""
        return cls(
            scheduled_for=utc(run.scheduled_for),
            fired_at=utc(run.fired_at),
            outcome=run.outcome,
            campaign=run.campaign_id,
            message=run.message,
        )


class ScheduleRunList(BaseModel):
    """Runs of a schedule, newest first."""

    items: list[ScheduleRunView]


class CronPreview(BaseModel):
    """What a cron line means."""

    words: str
    next: list[datetime] = Field(description="Its next three moments, fewer where there are no more.")

    @classmethod
    def of(cls, cron: str, timezone: str, now: float) -> Self:
        """The JSON of a cron line. Raises ScenarioError."""
        check(cron, timezone)
        return cls(words=in_words(cron, timezone), next=[utc(one) for one in next_ticks(cron, timezone, now, 3)])
