"""The client's calls about campaigns and schedules."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Self

from service.client.connection import Connection, part

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

_PAUSE_S = 1.0


@dataclass(frozen=True, kw_only=True)
class CampaignStatus:
    """A campaign as the service reported it; `raw` is its JSON. jobs: how many are in which state."""

    id: str
    name: str
    suite: str
    state: str
    cases: int
    jobs: Mapping[str, int]
    fraction: float
    eta_s: float | None
    created_at: str
    raw: Mapping[str, Any] = field(repr=False)

    @classmethod
    def of(cls, raw: Mapping[str, Any]) -> Self:
        """From the JSON of the service."""
        named = {name: raw[name] for name in cls.__dataclass_fields__ if name != "raw"}
        return cls(**named, raw=raw)

    @property
    def terminal(self) -> bool:
        """Whether it has ended."""
        return self.state != "running"

    @property
    def ended(self) -> int:
        """How many of its jobs have ended."""
        return sum(count for state, count in self.jobs.items() if state not in ("queued", "running"))


class CampaignCalls(Connection):
    """Campaigns, schedules, comparisons and trends."""

    def suites(self) -> dict[str, str]:
        """Named suites: name -> title."""
        return {item["name"]: item["title"] for item in self._json("GET", "/api/v1/suites")["items"]}

    def plan_campaign(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """What `start_campaign` would run: jobs, steps, seconds, suite, suite_sha256."""
        return dict(self._json("POST", "/api/v1/campaigns", params={"dry_run": 1}, json=dict(request)))

    def start_campaign(self, request: Mapping[str, Any]) -> CampaignStatus:
        """Run a suite, `{"suite": NAME}`, or a grid, `{"scenario": ..., "grid": {"dt_s": [0.01, 0.02]}}`."""
        return CampaignStatus.of(self._json("POST", "/api/v1/campaigns", json=dict(request)))

    def campaign(self, campaign_id: str) -> CampaignStatus:
        """The campaign as it is now."""
        return CampaignStatus.of(self._json("GET", f"/api/v1/campaigns/{part(campaign_id)}"))

    def campaigns(self, *, suite: str | None = None, limit: int = 20) -> Iterator[CampaignStatus]:
        """Campaigns, newest first, page by page."""
        left, cursor = limit, None
        while left > 0:
            params = {"suite": suite, "limit": min(100, left), "cursor": cursor}
            page = self._json("GET", "/api/v1/campaigns", params={k: v for k, v in params.items() if v is not None})
            yield from map(CampaignStatus.of, page["items"])
            left, cursor = left - len(page["items"]), page["next_cursor"]
            if cursor is None:
                return

    def wait_campaign(
        self, campaign_id: str, *, progress: Callable[[CampaignStatus], None] | None = None
    ) -> CampaignStatus:
        """Wait until the campaign has ended; `progress` is called with it about once a second."""
        while True:
            now = self.campaign(campaign_id)
            if progress is not None:
                progress(now)
            if now.terminal:
                return now
            time.sleep(_PAUSE_S)

    def cancel_campaign(self, campaign_id: str) -> CampaignStatus:
        """Cancel its queued and running jobs; finished ones are kept."""
        return CampaignStatus.of(self._json("POST", f"/api/v1/campaigns/{part(campaign_id)}/cancel"))

    def delete_campaign(self, campaign_id: str) -> None:
        """Delete a campaign that has ended, with its jobs and their files."""
        self._request("DELETE", f"/api/v1/campaigns/{part(campaign_id)}")

    def campaign_cases(self, campaign_id: str) -> Iterator[dict[str, Any]]:
        """Its insertions in the order of the suite, page by page: case, labels, job (None once deleted), outcome."""
        cursor = None
        while True:
            params: dict[str, str] = {} if cursor is None else {"cursor": cursor}
            page = self._json("GET", f"/api/v1/campaigns/{part(campaign_id)}/jobs", params=params)
            yield from page["items"]
            cursor = page["next_cursor"]
            if cursor is None:
                return

    def campaign_results(self, campaign_id: str) -> dict[str, Any]:
        """Scores and tests over the insertions that have ended."""
        return dict(self._json("GET", f"/api/v1/campaigns/{part(campaign_id)}/results"))

    def campaign_csv(self, campaign_id: str, path: Path) -> Path:
        """Download a table with one line per insertion that has ended. Returns `path`."""
        return self._download(f"/api/v1/campaigns/{part(campaign_id)}/results?format=csv", path)

    def campaign_report(self, campaign_id: str, path: Path) -> Path:
        """Download the report page. Returns `path`."""
        return self._download(f"/api/v1/campaigns/{part(campaign_id)}/report", path)

    def compare(self, campaigns: Sequence[str], arms: Sequence[str] | None = None) -> dict[str, Any]:
        """Paired tests between two campaigns, or between two arms of one (None: all of its arms)."""
        body = {"campaigns": list(campaigns), "arms": None if arms is None else list(arms)}
        return dict(self._json("POST", "/api/v1/comparisons", json=body))

    def trend(self, suite: str) -> list[dict[str, Any]]:
        """The suite's campaigns, oldest first, each with its marks against earlier ones."""
        return list(self._json("GET", f"/api/v1/trends/{part(suite)}")["points"])

    # -- schedules

    def schedules(self) -> list[dict[str, Any]]:
        """All schedules, by name."""
        return list(self._json("GET", "/api/v1/schedules")["items"])

    def add_schedule(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """A new one: `{"name": ..., "cron": "0 2 * * *", "timezone": "Europe/Paris", "campaign": {"suite": ...}}`."""
        return dict(self._json("POST", "/api/v1/schedules", json=dict(request)))

    def change_schedule(self, schedule_id: str, changes: Mapping[str, Any]) -> dict[str, Any]:
        """Change some of its fields. Returns the schedule."""
        return dict(self._json("PATCH", f"/api/v1/schedules/{part(schedule_id)}", json=dict(changes)))

    def trigger_schedule(self, schedule_id: str) -> dict[str, Any]:
        """Run its campaign now. Returns the outcome."""
        return dict(self._json("POST", f"/api/v1/schedules/{part(schedule_id)}/trigger"))

    def schedule_runs(self, schedule_id: str, *, limit: int = 20) -> list[dict[str, Any]]:
        """Its runs, newest first."""
        return list(self._json("GET", f"/api/v1/schedules/{part(schedule_id)}/runs", params={"limit": limit})["items"])

    def delete_schedule(self, schedule_id: str) -> None:
        """Delete a schedule and its history; the campaigns that it started are kept."""
        self._request("DELETE", f"/api/v1/schedules/{part(schedule_id)}")
