"""The pages of campaigns: the list with the form of a new one, one campaign with its cases, the comparison."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response

from benchmarks.cautions import cautions
from benchmarks.paper.table import BESIDE, arms, main_rows, rows
from benchmarks.suites.catalogue import suite_names
from service.api.context import Service, ServiceOf
from service.api.parameters import CampaignId, Cursor
from service.api.schemas.campaigns import CampaignState, CampaignView, ComparisonView
from service.campaigns.cases import FIELDS, Column, scores, sorted_cases
from service.campaigns.comparison import arms_of, compare_campaigns, compare_within
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
    """One campaign: progress, scores by arm, warnings, its cases sorted by a column."""
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
        cases=shown,
        first=first,
        size=CASES,
        sort=sort,
        down=down,
        arms=arms(main_rows(table)),
        ended=len(table),
        cautions=cautions((row.id, row.warnings) for row in table),
    )


@router.get("/compare")
def get_compare(
    request: Request,
    service: ServiceOf,
    a: Annotated[str, Query(max_length=32)] = "",
    b: Annotated[str, Query(max_length=32)] = "",
    first: Annotated[str, Query(max_length=200)] = "",
    second: Annotated[str, Query(max_length=200)] = "",
    every: bool = False,
) -> Response:
    """Two campaigns, or the arms of one, with paired tests."""
    body: dict[str, Any] = {"campaigns": [a, b] if b else [a]}
    if first and second:
        body = {"campaigns": [a], "arms": [first, second]}
    known = arms_of(service.campaigns, a) if a else []
    complete = bool(a and (b or (first and second) or (every and len(known) > 1)))
    comparison, problem = _comparison(service, body) if complete else (None, "")
    return page(
        request,
        "compare.html",
        status=422 if problem else 200,
        campaigns=service.campaigns.newest(limit=200),
        arms=known,
        chosen={"a": a, "b": b, "first": first, "second": second},
        body=body,
        comparison=comparison,
        problem=problem,
    )


def _comparison(service: Service, body: dict[str, Any]) -> tuple[dict[str, Any] | None, str]:
    """The comparison as JSON data, or why there is none."""
    names, store = body["campaigns"], service.campaigns
    try:
        if len(names) == 1:
            compared = compare_within(store, names[0], body.get("arms", ()))
        else:
            compared = compare_campaigns(store, *names)
    except (ScenarioError, UnknownCampaignError) as error:
        return None, str(error)
    return ComparisonView.of(compared).model_dump(mode="json"), ""
