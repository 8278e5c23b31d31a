"""The history of a suite: a point for each campaign, judged against earlier ones."""

from __future__ import annotations

import math
import statistics
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from benchmarks.paper.table import beside, rows
from benchmarks.trend import Judgement, Loss, Point, judge_all, lasting_losses
from service.campaigns.results import origin, outcomes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from benchmarks.cases import Outcome
    from service.store.campaign import Campaign
    from service.store.campaigns import CampaignStore
    from simcore.arms import Arm

MOST_POINTS = 200
_PARTS = ("plant", "jacobian", "command")  # of a step; recording is left out, a campaign can do without


@dataclass(frozen=True)
class TrendRun:
    """One campaign of a suite, its point and the marks it got against earlier runs."""

    campaign: Campaign
    point: Point
    judgement: Judgement


@dataclass(frozen=True)
class SuiteTrend:
    """The last runs of a suite, oldest first, and what got worse and has not recovered."""

    suite: str
    runs: list[TrendRun]
    losses: list[Loss]  # `since` counts the runs


def trend(campaigns: CampaignStore, suite: str) -> SuiteTrend:
    """The history of a suite; without runs if none of its campaigns has ended. Missing points are computed."""
    ended = [
        (campaign, kept_point(campaigns, campaign) if kept is None else point_of(kept))
        for campaign, kept in campaigns.points(suite, limit=MOST_POINTS)
    ]
    points = [point for _, point in ended]
    runs = [TrendRun(*one, mark) for one, mark in zip(ended, judge_all(points), strict=True)]
    return SuiteTrend(suite, runs, lasting_losses(points))


def kept_point(campaigns: CampaignStore, campaign: Campaign) -> Point:
    """The point of a campaign that has ended, which is stored too."""
    computed = point(campaign, outcomes(campaigns.cases(campaign.id, whole=False)))
    campaigns.keep_point(campaign.id, point_json(computed))
    return computed


def point(campaign: Campaign, results: Sequence[Outcome]) -> Point:
    """The campaign as one point of its suite's trend."""
    table, source = rows(results), origin(results)
    steps = [step for step in map(_step_ms, results) if step is not None]
    return Point(
        at=campaign.created_at,
        commit=source.get("commit"),
        machine=f"{source.get('cpu') or 'unknown'}, {source.get('cpu_count') or '?'} cores",
        rmse_commanded_mm={row.id: row.rmse_commanded_mm for row in table},
        digests={row.id: row.digest for row in table},
        successes=len([row for row in table if row.success]),
        step_ms=statistics.median(steps) if steps else None,
        arms={row.arm: _ran(row.steered_by) for row in table if row.steered_by is not None},
        beside={metric: value if math.isfinite(value) else None for metric, value in beside(table).items()},
    )


def _ran(arm: Arm) -> str:
    return f"{arm.id[:8]} ({arm.edition})" if arm.edition else arm.id[:8]


def point_json(one: Point) -> dict[str, Any]:
    """A point as JSON data; an infinite error, that of a failure, is null."""
    errors = {name: value if math.isfinite(value) else None for name, value in one.rmse_commanded_mm.items()}
    return {**asdict(one), "rmse_commanded_mm": errors}


def point_of(data: dict[str, Any]) -> Point:
    """The point that `point_json` wrote."""
    errors = {name: math.inf if value is None else value for name, value in data["rmse_commanded_mm"].items()}
    return Point(**{**data, "rmse_commanded_mm": errors})


def _step_ms(outcome: Outcome) -> float | None:
    timing = outcome.result.get("timing") or {}
    parts: list[float] = [timing[name]["median_ms"] for name in _PARTS if (timing.get(name) or {}).get("median_ms")]
    return sum(parts) if parts else None
