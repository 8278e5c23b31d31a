"""The pages of campaigns: the list with the form of a new one, one campaign with its cases, the comparison."""

from __future__ import annotations

import math
import statistics
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Request, Response
from pydantic import ValidationError

from benchmarks.paper.suites import suite_names
from benchmarks.paper.table import Row, arms, by_group, main_rows, only, rows
from service.api.context import Service, ServiceOf
from service.api.routes.campaigns import CampaignId, compare_campaigns
from service.api.schemas.campaigns import CampaignState, CampaignView, ComparisonRequest
from service.campaigns.results import outcomes
from service.store.campaign import CampaignCase, UnknownCampaignError
from service.web.form import paths
from service.web.site import missing, page
from simcore.errors import ScenarioError
from simcore.scenario.presets import preset_names

router = APIRouter(include_in_schema=False)

ROWS = 30
CASES = 100
Sort = Literal["number", "case", "state", "outcome", "rmse", "max", "final", "step"]


@router.get("/campaigns")
def get_campaigns(
    request: Request,
    service: ServiceOf,
    state: CampaignState | None = None,
    suite: Annotated[str | None, Query(max_length=100)] = None,
    cursor: Annotated[str | None, Query(pattern="^[0-9]{1,18}$")] = None,
) -> Response:
    """Campaigns, newest first, and the form of a new one."""
    before = int(cursor) if cursor else None
    found = service.campaigns.newest(suite=suite, state=state, limit=ROWS + 1, before=before)
    shown = found[:ROWS]
    tallies = service.campaigns.tally([one.id for one in shown])
    return page(
        request,
        "campaigns.html",
        campaigns=[CampaignView.of(one, tallies[one.id], service.store.now) for one in shown],
        older_than=shown[-1].seq if len(found) > ROWS else None,
        cursor=cursor,
        wanted=state,
        suite=suite,
        **request_form(),
    )


def request_form() -> dict[str, Any]:
    """What the form of a campaign offers."""
    return {"suites": suite_names(), "presets": preset_names(), "fields": paths()}


@router.get("/campaigns/{campaign_id}")
def get_campaign(
    campaign_id: CampaignId,
    request: Request,
    service: ServiceOf,
    sort: Sort = "number",
    down: bool = False,
    first: Annotated[int, Query(ge=0, le=10**6)] = 0,
) -> Response:
    """One campaign: progress, scores by controller, its cases in the order that was asked for."""
    try:
        campaign = service.campaigns.get(campaign_id)
    except UnknownCampaignError:
        return missing(request, f"campaign {campaign_id}")
    cases = service.campaigns.cases(campaign_id)
    tally = service.campaigns.tally([campaign_id])[campaign_id]
    table = rows(outcomes(cases))
    ordered = _ordered(cases, sort, down)
    return page(
        request,
        "campaign.html",
        campaign=CampaignView.of(campaign, tally, service.store.now),
        scores=_scores(table),
        cases=[_case(case) | {"values": _values(case, campaign.request)} for case in ordered[first : first + CASES]],
        first=first,
        size=CASES,
        sort=sort,
        down=down,
        arms=arms(main_rows(table)),
        ended=len(table),
    )


def _case(case: CampaignCase) -> dict[str, Any]:
    result = case.result or {}
    measured = result.get("metrics") or {}
    return {
        "number": case.number,
        "case": case.case_id,
        "job": case.job_id,
        "state": case.state,
        "outcome": _outcome(case),
        "message": case.error or result.get("message") or "",
        "rmse": measured.get("rmse_mm"),
        "max": measured.get("max_error_mm"),
        "final": measured.get("final_error_mm"),
        "step": ((result.get("timing") or {}).get("plant") or {}).get("median_ms"),
    }


def _values(case: CampaignCase, asked: dict[str, Any]) -> str:
    """What a case of a grid has of its own; the name of a suite's case says it."""
    axes = asked.get("grid") or {}
    return ", ".join(f"{name} {case.labels[name]}" for name in axes if name in case.labels)


def _outcome(case: CampaignCase) -> str:
    if case.result is None:
        return case.error_kind or ""
    if (case.result.get("metrics") or {}).get("success"):
        return "on target"
    return str(case.result.get("status", "")).replace("_", " ") + ", no success"


def _ordered(cases: list[CampaignCase], sort: Sort, down: bool) -> list[CampaignCase]:
    """Sorted by a column; what has no value there comes last, whichever way."""

    def value_of(case: CampaignCase) -> Any:
        return _case(case)[sort]

    known = [case for case in cases if value_of(case) is not None]
    return sorted(known, key=value_of, reverse=down) + [case for case in cases if value_of(case) is None]


def _scores(table: list[Row]) -> list[dict[str, Any]]:
    """By group and controller: how many, how many succeeded, the errors in the middle and at worst."""
    found = []
    for group, members in by_group(main_rows(table)).items():
        for arm in arms(members):
            mine = only(members, arm=arm)
            errors = sorted(row.rmse_mm for row in mine)
            found.append(
                {
                    "group": group,
                    "arm": arm,
                    "count": len(mine),
                    "stable": sum(row.stable for row in mine),
                    "success": sum(row.success for row in mine),
                    "median": _finite(statistics.median(errors)),
                    "worst": _finite(errors[-1]),
                }
            )
    return found


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


@router.get("/compare")
def get_compare(
    request: Request,
    service: ServiceOf,
    a: Annotated[str, Query(max_length=32)] = "",
    b: Annotated[str, Query(max_length=32)] = "",
    first: Annotated[str, Query(max_length=100)] = "",
    second: Annotated[str, Query(max_length=100)] = "",
) -> Response:
    """Two campaigns, or two controllers of one, with paired tests."""
    asked = bool(a and (b or (first and second)))
    body: dict[str, Any] = {"campaigns": [a]} if first and second else {"campaigns": [a, b]}
    if first and second:
        body["controllers"] = [first, second]
    made, problem = _compared(service, body) if asked else (None, "")
    return page(
        request,
        "compare.html",
        status=422 if problem else 200,
        campaigns=service.campaigns.newest(limit=200),
        arms=_arms(service, a),
        chosen={"a": a, "b": b, "first": first, "second": second},
        body=body,
        made=made,
        problem=problem,
        asked=asked,
    )


def _compared(service: Service, body: dict[str, Any]) -> tuple[dict[str, Any] | None, str]:
    """The comparison as JSON data, or why there is none."""
    try:
        found = compare_campaigns(ComparisonRequest.model_validate(body), service)
        return found.model_dump(mode="json"), ""
    except ValidationError as error:
        return None, "; ".join(item["msg"] for item in error.errors())
    except (ScenarioError, UnknownCampaignError) as error:
        return None, str(error)


def _arms(service: Service, campaign_id: str) -> list[str]:
    """The controllers of a campaign; none of one that there is not."""
    try:
        cases = service.campaigns.cases(campaign_id) if campaign_id else []
    except UnknownCampaignError:
        return []
    return arms(main_rows(rows(outcomes(cases))))
