"""The pages of campaigns: the list with the form of a new one, one campaign with its cases, the comparison."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

from fastapi import APIRouter, Query, Request, Response
from pydantic import BaseModel, Field

from benchmarks.paper.table import BESIDE
from benchmarks.suites.catalogue import suite_names
from service.api.context import Service, ServiceOf
from service.api.parameters import CampaignId, Cursor
from service.api.schemas.campaigns import CampaignState, CampaignView, ComparisonView
from service.campaigns.cases import FIELDS, MEASURES, CaseResult, Column, sorted_cases
from service.campaigns.comparison import arms_of, compare_campaigns, compare_within
from service.campaigns.fronts import Front, fronts
from service.campaigns.overview import campaign_page, overview
from service.store.campaign import Campaign, UnknownCampaignError
from service.web.form import paths
from service.web.pictures.fronts import front_pictures
from service.web.pictures.heatmap import heatmap
from service.web.pictures.scatter import LISTED, scatter
from service.web.site import missing, page
from simcore.errors import ScenarioError
from simcore.scenario.presets import preset_names

if TYPE_CHECKING:
    from collections.abc import Sequence

router = APIRouter(include_in_schema=False)

ROWS = 30
CASES = 100

Name = Annotated[str, Field(max_length=200)]


class CampaignQuery(BaseModel):
    """What the page of a campaign shows. sort, down, first: of the list of cases. of: measure of the heatmap. x, y,
    color: of the points, a label of the cases or a measure."""

    sort: Column = "number"
    down: bool = False
    first: int = Field(0, ge=0, le=10**6)
    picture: Literal["heatmap", "scatter"] = "heatmap"
    of: Name = "rmse"
    x: Name = ""
    y: Name = ""
    color: Name = ""


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
    campaign_id: CampaignId, request: Request, service: ServiceOf, wanted: Annotated[CampaignQuery, Query()]
) -> Response:
    """One campaign: progress, scores by arm, warnings, pictures of its cases, and these sorted by a column."""
    try:
        campaign = service.campaigns.get(campaign_id)
    except UnknownCampaignError:
        return missing(request, f"campaign {campaign_id}")
    found = service.measured.of(campaign_id)
    return page(
        request,
        "campaign.html",
        campaign=CampaignView.of(overview(service.campaigns, campaign, now=service.store.now)),
        scores=found.scores,
        fronts=front_pictures(fronts(found.scores)),
        pictures=_pictures(campaign, found.results, wanted),
        columns_beside=[(name, BESIDE[field]) for name, field in FIELDS.items() if field in BESIDE],
        cases=sorted_cases(found.results, wanted.sort, descending=wanted.down)[wanted.first :][:CASES],
        first=wanted.first,
        size=CASES,
        sort=wanted.sort,
        down=wanted.down,
        arms=found.arms,
        ended=found.ended,
        cautions=found.cautions,
    )


def _pictures(campaign: Campaign, cases: Sequence[CaseResult], wanted: CampaignQuery) -> dict[str, Any]:
    """The cases as a heatmap where the grid has two axes and nothing else is wanted, else as points."""
    of = wanted.of if wanted.of in MEASURES else "rmse"
    shaded = heatmap(cases, campaign.request.get("grid") or {}, of)
    plain = shaded is not None and wanted.picture == "heatmap"
    points = None if plain else scatter(cases, x=wanted.x, y=wanted.y, color=wanted.color)
    return {
        "heatmap": None if points else shaded,
        "scatter": points,
        "of": of,
        "measures": MEASURES,
        "both": shaded is not None,
        "listed": LISTED,
    }


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
        fronts=front_pictures(_fronts(service, a)) if comparison and not b else [],
        problem=problem,
    )


def _fronts(service: Service, campaign_id: str) -> list[Front]:
    """All arms of a campaign by error and cost."""
    return fronts(service.measured.of(campaign_id).scores)


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
