"""The pages of campaigns: the list with the form of a new one, one campaign with its cases, the comparison."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response

from benchmarks.paper.suites import suite_names
from benchmarks.paper.table import BESIDE, arms, main_rows, rows
from service.api.context import Service, ServiceOf
from service.api.parameters import CampaignId, Cursor
from service.api.schemas.campaigns import CampaignState, CampaignView, ComparisonView
from service.campaigns.cases import FIELDS, CaseResult, Column, scores, sorted_cases
from service.campaigns.comparison import compare_campaigns, compare_controllers, controllers_of
from service.campaigns.overview import campaign_page, overview
from service.campaigns.results import outcomes
from service.store.campaign import UnknownCampaignError
from service.web.form import paths
from service.web.site import missing, page
from simcore.errors import ScenarioError
from simcore.scenario.presets import preset_names

router = APIRouter(include_in_schema=False)

ROWS = 30
CASES = 100


@router.get("/campaigns")
def get_campaigns(
    request: Request,
    service: ServiceOf,
    state: CampaignState | None = None,
    suite: Annotated[str | None, Query(max_length=100)] = None,
    cursor: Cursor = None,
) -> Response:
    """Campaigns, newest first, and the form of a new one."""
    listed = campaign_page(service.campaigns, suite=suite, state=state, size=ROWS, cursor=cursor, now=service.store.now)
    return page(
        request,
        "campaigns.html",
        campaigns=[CampaignView.of(one) for one in listed.items],
        older_than=listed.next_cursor,
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
    sort: Column = "number",
    down: bool = False,
    first: Annotated[int, Query(ge=0, le=10**6)] = 0,
) -> Response:
    """One campaign: progress, scores by controller, its cases sorted by a column."""
    try:
        campaign = service.campaigns.get(campaign_id)
    except UnknownCampaignError:
        return missing(request, f"campaign {campaign_id}")
    cases = service.campaigns.cases(campaign_id)
    table = rows(outcomes(cases))
    shown = sorted_cases(cases, sort, descending=down)[first : first + CASES]
    return page(
        request,
        "campaign.html",
        campaign=CampaignView.of(overview(service.campaigns, campaign, now=service.store.now)),
        scores=scores(table),
        columns_beside=[(name, BESIDE[field]) for name, field in FIELDS.items() if field in BESIDE],
        cases=[(row, _grid_values(row, campaign.request)) for row in shown],
        first=first,
        size=CASES,
        sort=sort,
        down=down,
        arms=arms(main_rows(table)),
        ended=len(table),
    )


def _grid_values(row: CaseResult, request: dict[str, Any]) -> str:
    """The values that set a case of a grid apart; the name of a suite's case says it."""
    axes = request.get("grid") or {}
    return ", ".join(f"{name} {row.labels[name]}" for name in axes if name in row.labels)


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
    body: dict[str, Any] = {"campaigns": [a], "controllers": [first, second]}
    if not (first and second):
        body = {"campaigns": [a, b]}
    complete = bool(a and (b or (first and second)))
    comparison, problem = _comparison(service, body) if complete else (None, "")
    return page(
        request,
        "compare.html",
        status=422 if problem else 200,
        campaigns=service.campaigns.newest(limit=200),
        arms=controllers_of(service.campaigns, a) if a else [],
        chosen={"a": a, "b": b, "first": first, "second": second},
        body=body,
        comparison=comparison,
        problem=problem,
    )


def _comparison(service: Service, body: dict[str, Any]) -> tuple[dict[str, Any] | None, str]:
    """The comparison as JSON data, or why there is none."""
    names, store = body["campaigns"], service.campaigns
    try:
        if "controllers" in body:
            compared = compare_controllers(store, names[0], *body["controllers"])
        else:
            compared = compare_campaigns(store, *names)
    except (ScenarioError, UnknownCampaignError) as error:
        return None, str(error)
    return ComparisonView.of(compared).model_dump(mode="json"), ""
