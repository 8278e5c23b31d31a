"""Routes of campaigns: many insertions asked for at once, their progress, results, comparison and trend."""

from __future__ import annotations

import math
import shutil
from typing import Annotated

from fastapi import APIRouter, Path, Query, Response, status

from benchmarks.paper.comparison import as_json
from benchmarks.paper.suites import suite_names
from benchmarks.paper.table import insertions_csv, rows
from benchmarks.trend import lasting_losses
from service.admission.campaign_planner import CampaignRequest
from service.api.context import Service, ServiceOf, documented
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
    TrendLoss,
    TrendPoint,
)
from service.api.schemas.jobs import moment
from service.campaigns import report as campaign_report
from service.campaigns import trends
from service.campaigns.results import between_arms, between_campaigns, outcomes
from service.store.campaign import Campaign, CampaignCase

router = APIRouter(prefix="/api/v1", tags=["campaigns"])

CampaignId = Annotated[str, Path(description="Id of a campaign.", min_length=1, max_length=32, pattern="^[0-9a-z]+$")]
SuiteName = Annotated[str, Path(description="Name of a suite.", min_length=1, max_length=100)]
STEP_S = 3e-3  # of a step, where no job has been measured yet


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
    response: Response,
    dry_run: Annotated[bool, Query(description="Only say how many jobs and how much time it would take.")] = False,
) -> CampaignView | CampaignDryRun:
    """Queue every insertion of a suite or of a grid; all of them or none. They run when no single job waits."""
    service.refuse_when_closing()
    planned = service.planner.plan(body)
    if dry_run:
        response.status_code = status.HTTP_200_OK
        steps = sum(job.steps for job in planned.jobs)
        return CampaignDryRun(
            name=planned.name,
            suite=planned.suite,
            suite_sha256=planned.suite_sha256,
            jobs=len(planned.jobs),
            steps=steps,
            seconds=steps * (service.store.step_s() or STEP_S) / service.settings.workers,
            first=[job.case_id for job in planned.jobs[:10]],
        )
    campaign = service.campaigns.create(planned)
    service.engine.wake()
    response.headers["Location"] = f"/api/v1/campaigns/{campaign.id}"
    return _view(service, campaign)


def _view(service: Service, campaign: Campaign) -> CampaignView:
    return CampaignView.of(campaign, service.campaigns.tally([campaign.id])[campaign.id], service.store.now)


@router.get("/campaigns", operation_id="list_campaigns", summary="List campaigns, newest first", responses=documented())
def list_campaigns(
    service: ServiceOf,
    suite: Annotated[str | None, Query(max_length=100, description="Only of this suite.")] = None,
    state: Annotated[CampaignState | None, Query(description="Only in this state.")] = None,
    limit: Annotated[int, Query(ge=1, le=200, description="At most so many.")] = 50,
    cursor: Annotated[str | None, Query(pattern="^[0-9]{1,18}$", description="next_cursor of the page before.")] = None,
) -> CampaignPage:
    """A page of campaigns with their progress."""
    before = int(cursor) if cursor else None
    found = service.campaigns.newest(suite=suite, state=state, limit=limit + 1, before=before)
    items, more = found[:limit], len(found) > limit
    tallies, now = service.campaigns.tally([one.id for one in items]), service.store.now
    return CampaignPage(
        items=[CampaignView.of(one, tallies[one.id], now) for one in items],
        next_cursor=str(items[-1].seq) if more else None,
    )


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
    """Queued jobs are cancelled at once, running ones within a second; what is finished stays."""
    return _view(service, service.campaigns.cancel(campaign_id))


@router.delete(
    "/campaigns/{campaign_id}",
    operation_id="delete_campaign",
    summary="Delete a campaign that has ended",
    status_code=status.HTTP_204_NO_CONTENT,
    responses=documented(403, 404, 409),
)
def delete_campaign(campaign_id: CampaignId, service: ServiceOf) -> None:
    """Forget the campaign with all of its jobs, results and files."""
    for job_id in service.campaigns.delete(campaign_id):
        shutil.rmtree(service.settings.jobs / job_id, ignore_errors=True)


@router.get(
    "/campaigns/{campaign_id}/jobs",
    operation_id="list_campaign_jobs",
    summary="List the insertions of a campaign",
    responses=documented(404),
)
def list_campaign_jobs(campaign_id: CampaignId, service: ServiceOf) -> CampaignCaseList:
    """Every case with its job and what came of it so far."""
    return CampaignCaseList(items=[_case(case) for case in service.campaigns.cases(campaign_id)])


def _case(case: CampaignCase) -> CampaignCaseView:
    result = case.result or {}
    measured = result.get("metrics") or {}
    return CampaignCaseView(
        case=case.case_id,
        labels=case.labels,
        job=case.job_id,
        state=case.state,
        status=result.get("status"),
        success=measured.get("success"),
        rmse_mm=measured.get("rmse_mm"),
        digest=result.get("digest"),
    )


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
    return Response(campaign_report.json_text(campaign, cases), media_type="application/json")


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
    page = campaign_report.page(campaign, service.campaigns.cases(campaign_id))
    return Response(page, media_type="text/html; charset=utf-8", headers=campaign_report.HEADERS)


@router.post(
    "/comparisons",
    operation_id="compare_campaigns",
    summary="Compare two campaigns or two controllers",
    responses=documented(400, 403, 404, 413, 415),
)
def compare_campaigns(body: ComparisonRequest, service: ServiceOf) -> ComparisonView:
    """Paired tests over the paths that both have: failures count as the worst error."""
    found = [outcomes(service.campaigns.cases(name)) for name in body.campaigns]
    same = shared = None
    if body.controllers is not None:
        compared = between_arms(found[0], *body.controllers)
    else:
        compared = between_campaigns(found[0], found[1])
        digests = [{o.case.id: o.result.get("digest") for o in one} for one in found]
        shared = len(digests[0].keys() & digests[1].keys())
        same = len([k for k, v in digests[0].items() if v and digests[1].get(k) == v])
    return ComparisonView(
        campaigns=body.campaigns,
        controllers=body.controllers,
        same_digests=same,
        shared_cases=shared,
        comparisons=as_json(compared),
    )


@router.get("/trends", operation_id="list_trends", summary="Suites that have a history", responses=documented())
def list_trends(service: ServiceOf) -> SuiteNames:
    """Suites of which at least one campaign has ended."""
    return SuiteNames(items=service.campaigns.suites())


@router.get(
    "/trends/{suite}", operation_id="get_trend", summary="A suite over commits and dates", responses=documented()
)
def get_trend(suite: SuiteName, service: ServiceOf) -> Trend:
    """The suite's campaigns, oldest first, with regressions marked, and what has not been mended since."""
    found = trends.history(service.campaigns, suite)
    runs = [one for _, one, _ in found]
    return Trend(
        suite=suite,
        points=[
            TrendPoint(
                campaign=campaign.id,
                at=moment(one.at),
                commit=one.commit,
                machine=one.machine,
                cases=len(one.rmse_mm),
                successes=one.successes,
                median_rmse_mm=one.median_rmse_mm if math.isfinite(one.median_rmse_mm) else None,
                step_ms=one.step_ms,
                accuracy=mark.accuracy,
                accuracy_why=mark.accuracy_why,
                success=mark.success,
                success_why=mark.success_why,
                time=mark.time,
                time_why=mark.time_why,
                regression=mark.regression,
            )
            for campaign, one, mark in found
        ],
        losses=[
            TrendLoss(
                figure=loss.figure,
                campaign=found[loss.since][0].id,
                at=moment(runs[loss.since].at),
                commit=runs[loss.since].commit,
                good_commit=runs[loss.since - 1].commit,
                why=loss.why,
            )
            for loss in lasting_losses(runs)
        ],
    )
