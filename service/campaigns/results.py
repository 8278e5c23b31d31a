"""What the jobs of a campaign amount to: outcomes for the analyses, a point of a trend, a comparison."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import Any

from benchmarks.cases import Case, Outcome
from benchmarks.paper.analysis import floored
from benchmarks.paper.comparison import Comparison, compare
from benchmarks.paper.table import Row, arms, grouped, main_rows, only, rows
from benchmarks.trend import Point
from service.store.campaign import Campaign, CampaignCase
from service.store.job import TERMINAL
from simcore.errors import Problem, ScenarioError

_PARTS = ("plant", "jacobian", "command")  # of a step; recording is left out, a campaign can do without


def outcomes(cases: Iterable[CampaignCase]) -> list[Outcome]:
    """The cases that have ended. A job that left no result is an insertion that failed, and says why."""
    return [Outcome(_case(case), case.result or _failed(case)) for case in cases if _ended(case)]


def _ended(case: CampaignCase) -> bool:
    return case.result is not None or case.state is None or case.state in TERMINAL


def _case(case: CampaignCase) -> Case:
    scenario = (case.result or {}).get("provenance", {}).get("scenario", {})
    return Case(case.case_id, scenario, case.labels)


def _failed(case: CampaignCase) -> dict[str, Any]:
    status = case.error_kind or case.state or "deleted"
    return {"status": status, "message": case.error or "", "metrics": {"stable": False, "success": False}}


def point(campaign: Campaign, found: Sequence[Outcome]) -> Point:
    """The campaign as one point of its suite's trend."""
    table = rows(found)
    origin: dict[str, Any] = next((o.result["provenance"] for o in found if "provenance" in o.result), {})
    steps = [step for step in (_step_ms(outcome) for outcome in found) if step is not None]
    return Point(
        at=campaign.created_at,
        commit=origin.get("commit"),
        machine=f"{origin.get('cpu', 'unknown')}, {origin.get('cpu_count', '?')} cores",
        rmse_mm={row.id: row.rmse_mm for row in table},
        digests={row.id: row.digest for row in table},
        successes=len([row for row in table if row.success]),
        step_ms=statistics.median(steps) if steps else None,
    )


def point_json(one: Point) -> dict[str, Any]:
    """A point as JSON data; an infinite error, that of a failure, is null."""
    errors = {name: value if math.isfinite(value) else None for name, value in one.rmse_mm.items()}
    return {**asdict(one), "rmse_mm": errors}


def point_of(data: dict[str, Any]) -> Point:
    """The point that `point_json` wrote."""
    errors = {name: math.inf if value is None else value for name, value in data["rmse_mm"].items()}
    return Point(**{**data, "rmse_mm": errors})


def _step_ms(outcome: Outcome) -> float | None:
    timing = outcome.result.get("timing") or {}
    parts: list[float] = [timing[name]["median_ms"] for name in _PARTS if (timing.get(name) or {}).get("median_ms")]
    return sum(parts) if parts else None


def between_campaigns(first: Sequence[Outcome], second: Sequence[Outcome]) -> list[Comparison]:
    """The same controller in two campaigns, group by group; positive differences: the first is worse."""
    one, other = rows(first), rows(second)
    names = [arm for arm in arms(one) if arm in arms(other)]
    return _compared([(arm, arm, only(one, arm=arm), only(other, arm=arm)) for arm in names], (" (A)", " (B)"))


def between_arms(found: Sequence[Outcome], first: str, second: str) -> list[Comparison]:
    """Two controllers in one campaign, group by group. Raises ScenarioError for a controller that is not in it."""
    table = main_rows(rows(found))
    for field, arm in (("first", first), ("second", second)):
        if arm not in arms(table):
            raise ScenarioError([Problem(field, arm, f"is not in the campaign: {', '.join(arms(table)) or 'none'}")])
    return _compared([(first, second, only(table, arm=first), only(table, arm=second))], ("", ""))


def _compared(couples: list[tuple[str, str, list[Row], list[Row]]], marks: tuple[str, str]) -> list[Comparison]:
    compared = []
    for one, other, first, second in couples:
        mine, theirs = grouped(first), grouped(second)
        for group in mine:
            if group in theirs:
                names = (one + marks[0], other + marks[1])
                floor = floored([*mine[group], *theirs[group]])
                compared.append(compare(mine[group], theirs[group], group=group, names=names, floor=floor))
    return [found for found in compared if found is not None]
