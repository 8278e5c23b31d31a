"""Routes of campaigns: many insertions at once, their progress, results, comparison and trend."""

from __future__ import annotations

import shutil
from typing import Annotated

from fastapi import APIRouter, Query, Request, Response, status

from benchmarks.paper.table import insertions_csv, rows
from benchmarks.suites.catalogue import suite_names
from service.admission.campaign_planner import CampaignRequest
from service.api.context import Service, ServiceOf
from service.api.json_bodies import JsonBodyRoute
from service.api.openapi import documented
from service.api.parameters import CampaignId, Cursor, SuiteName
from service.api.root_path import rooted_page
from service.api.schemas.campaigns import (
    CampaignCaseList,
    CampaignCaseView,
    CampaignDryRun,
    CampaignPage,
    CampaignState,
    CampaignView,
    ComparisonRequest,
    ComparisonView,
    SuiteList,
    SuiteNames,
    SuiteView,
    Trend,
)
from service.campaigns import report
from service.campaigns.cases import CaseResult
from service.campaigns.comparison import compare_campaigns, compare_within
from service.campaigns.overview import campaign_page, overview
from service.campaigns.results import outcomes
from service.campaigns.trends import trend
from service.store.campaign import Campaign

router = APIRouter(prefix="/api/v1", tags=["campaigns"], route_class=JsonBodyRoute)

REPORT_HEADERS = {  # a page without scripts that loads nothing
    "Content-Security-Policy": "default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'self'",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}


@router.get("/suites", operation_id="list_suites", summary="List the named suites", responses=documented())
def list_suites() -> SuiteList:
    """What a campaign can run by name."""
    return SuiteList(items=[SuiteView(name=name, title=title) for name, title in suite_names().items()])


@router.post(
    "/campaigns",
    operation_id="create_campaign",
    summary="Run a suite or a parameter grid",
    status_code=status.HTTP_202_ACCEPTED,
    response_model=CampaignView | CampaignDryRun,
    responses={
        200: {"model": CampaignDryRun, "description": "The dry run."},
        202: {"model": CampaignView, "description": "Its jobs are queued."},
        **documented(400, 403, 413, 415, 503),
    },
)
def create_campaign(
    body: CampaignRequest,
    service: ServiceOf,
    request: Request,
    response: Response,
    dry_run: Annotated[bool, Query(description="Only say how many jobs and how much time it would take.")] = False,
) -> CampaignView | CampaignDryRun:
    """Queue every insertion of a suite or of a grid; all of them or none. They run when no single job waits."""
    service.refuse_when_closing()
    request.state.caller.require_priority(body.priority)
    plan = service.planner.plan(body)
    if dry_run:
        response.status_code = status.HTTP_200_OK
        return CampaignDryRun.of(plan, service.pace.pace(), workers=service.settings.workers)
    campaign = service.campaigns.create(plan, owner=request.state.caller.key_id)
    service.engine.wake()
    response.headers["Location"] = f"/api/v1/campaigns/{campaign.id}"
    return _view(service, campaign)


def _view(service: Service, campaign: Campaign) -> CampaignView:
    return CampaignView.of(overview(service.campaigns, campaign, now=service.store.now))


@router.get("/campaigns", operation_id="list_campaigns", summary="List campaigns, newest first", responses=documented())
def list_campaigns(
    service: ServiceOf,
    suite: Annotated[str | None, Query(max_length=100, description="Only of this suite.")] = None,
    state: Annotated[CampaignState | None, Query(description="Only in this state.")] = None,
    limit: Annotated[int, Query(ge=1, le=200, description="Most items of the page.")] = 50,
    cursor: Cursor = None,
) -> CampaignPage:
    """A page of campaigns with their progress."""
    page = campaign_page(service.campaigns, suite=suite, state=state, size=limit, cursor=cursor, now=service.store.now)
    return CampaignPage(items=[CampaignView.of(one) for one in page.items], next_cursor=page.next_cursor)


@router.get(
    "/campaigns/{campaign_id}", operation_id="get_campaign", summary="Read a campaign", responses=documented(404)
)
def get_campaign(campaign_id: CampaignId, service: ServiceOf) -> CampaignView:
    """The campaign now."""
    return _view(service, service.campaigns.get(campaign_id))


@router.post(
    "/campaigns/{campaign_id}/cancel",
    operation_id="cancel_campaign",
    summary="Cancel a campaign",
    status_code=status.HTTP_202_ACCEPTED,
    responses=documented(403, 404),
)
def cancel_campaign(campaign_id: CampaignId, service: ServiceOf) -> CampaignView:
    """Queued jobs are cancelled at once, running ones within a second; finished ones are kept."""
    return _view(service, service.campaigns.cancel(campaign_id))


@router.delete(
    "/campaigns/{campaign_id}",
    operation_id="delete_campaign",
    summary="Delete a campaign that has ended",
    status_code=status.HTTP_204_NO_CONTENT,
    responses=documented(403, 404, 409),
)
def delete_campaign(campaign_id: CampaignId, service: ServiceOf) -> None:
    """Forget the campaign with all of its jobs, results and files; not while one of them is pinned or has not ended."""
    for job_id in service.campaigns.delete(campaign_id):
        shutil.rmtree(service.settings.jobs / job_id, ignore_errors=True)


@router.get(
    "/campaigns/{campaign_id}/jobs",
    operation_id="list_campaign_jobs",
    summary="List the insertions of a campaign",
    responses=documented(404),
)
def list_campaign_jobs(
    campaign_id: CampaignId,
    service: ServiceOf,
    limit: Annotated[int, Query(ge=1, le=100_000, description="Most items of the page.")] = 10_000,
    cursor: Cursor = None,
) -> CampaignCaseList:
    """Cases with their jobs and their results so far."""
    first = int(cursor or 0)
    found = service.campaigns.cases(campaign_id, first=first, limit=limit + 1)
    following = str(found[limit].number) if len(found) > limit else None
    results = [CaseResult.of(case) for case in found[:limit]]
    return CampaignCaseList(items=[CampaignCaseView.of(row) for row in results], next_cursor=following)


@router.get(
    "/campaigns/{campaign_id}/results",
    operation_id="get_campaign_results",
    summary="Results of a campaign, the partial ones too",
    response_model=None,
    responses={
        200: {
            "description": "One row an insertion.",
            "content": {
                "text/csv": {"schema": {"type": "string"}},
                "application/json": {"schema": {"type": "object"}},
            },
        },
        **documented(404),
    },
)
def get_campaign_results(
    campaign_id: CampaignId,
    service: ServiceOf,
    format: Annotated[str, Query(pattern="^(json|csv)$", description="json or csv")] = "json",
) -> Response:
    """As JSON with the statistics by group and controller, or as CSV with a line for each insertion that has ended."""
    cases = service.campaigns.cases(campaign_id)
    if format == "csv":
        name = f"{campaign_id}.csv"
        headers = {"Content-Disposition": f'attachment; filename="{name}"'}
        return Response(insertions_csv(rows(outcomes(cases))), media_type="text/csv; charset=utf-8", headers=headers)
    campaign = service.campaigns.get(campaign_id)
    return Response(report.json_text(campaign, cases), media_type="application/json")


@router.get(
    "/campaigns/{campaign_id}/report",
    operation_id="get_campaign_report",
    summary="Report of a campaign, a page of its own",
    response_class=Response,
    responses={200: {"description": "HTML.", "content": {"text/html": {}}}, **documented(404)},
)
def get_campaign_report(campaign_id: CampaignId, service: ServiceOf) -> Response:
    """Tables, figures and tests over this campaign's insertions, of a grid point by point; also while it runs."""
    campaign = service.campaigns.get(campaign_id)
    page = report.page(campaign, service.campaigns.cases(campaign_id))
    return Response(rooted_page(page), media_type="text/html; charset=utf-8", headers=REPORT_HEADERS)


@router.post(
    "/comparisons",
    operation_id="compare_campaigns",
    summary="Compare two campaigns or the arms of one",
    responses=documented(400, 403, 404, 413, 415),
)
def create_comparison(body: ComparisonRequest, service: ServiceOf) -> ComparisonView:
    """Paired tests over the cases that differ in nothing else: failures count as the worst error."""
    if len(body.campaigns) == 1:
        return ComparisonView.of(compare_within(service.campaigns, body.campaigns[0], body.arms or ()))
    return ComparisonView.of(compare_campaigns(service.campaigns, *body.campaigns))


@router.get("/trends", operation_id="list_trends", summary="Suites that have a history", responses=documented())
def list_trends(service: ServiceOf) -> SuiteNames:
    """Suites of which at least one campaign has ended."""
    return SuiteNames(items=service.campaigns.suites())


@router.get(
    "/trends/{suite}", operation_id="get_trend", summary="A suite over commits and dates", responses=documented()
)
def get_trend(suite: SuiteName, service: ServiceOf) -> Trend:
    """The suite's campaigns, oldest first, with regressions marked, and what has not recovered since."""
    return Trend.of(trend(service.campaigns, suite))
