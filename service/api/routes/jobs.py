"""Routes of jobs: submit, list, wait, cancel, retry."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from typing import Annotated

from fastapi import APIRouter, Header, Query, Request, Response, status
from fastapi.responses import JSONResponse

from service.admission.admission import admit
from service.admission.cost import time_limit_s
from service.api.context import Service, ServiceOf, etag_matches
from service.api.idempotency import IdempotencyKey, own_key
from service.api.job_view_cache import EncodedJob
from service.api.json_bodies import JsonBodyRoute
from service.api.openapi import documented
from service.api.parameters import JobCursor, JobId
from service.api.schemas.jobs import JobDryRun, JobPage, JobRequest, JobSummary, JobView, Outcome, State
from service.store.job import content_hash
from service.store.job_lists import JobFilter, JobOrder, Sort

router = APIRouter(prefix="/api/v1/jobs", tags=["jobs"], route_class=JsonBodyRoute)

LONGEST_WAIT_S = 60.0
_CHECK_S = 20.0  # how often a long poll checks that its client is still there
LOCATION = {"Location": {"description": "Address of the job.", "schema": {"type": "string"}}}


@router.post(
    "",
    operation_id="submit_job",
    summary="Submit a job",
    status_code=status.HTTP_202_ACCEPTED,
    response_model=JobView | JobDryRun,
    responses={
        200: {"model": JobDryRun, "description": "The dry run."},
        202: {"model": JobView, "description": "Queued.", "headers": LOCATION},
        **documented(400, 403, 413, 415, 503),
    },
)
def submit_job(
    body: JobRequest,
    service: ServiceOf,
    request: Request,
    idempotency_key: IdempotencyKey = None,
    dry_run: Annotated[bool, Query(description="Only check the scenario and say what it would take.")] = False,
) -> Response:
    """Queue one insertion. The scenario is checked first, and each wrong field is named."""
    service.refuse_when_closing()
    request.state.caller.require_priority(body.priority)
    admitted = admit(body.scenario, service.settings.uploads, service.settings.limits)
    if dry_run:
        return JSONResponse(JobDryRun.of(admitted, service.pace.pace()).model_dump(mode="json"))
    resolved = admitted.resolved
    owner = request.state.caller.key_id
    job = service.store.submit(
        name=admitted.name,
        spec={"scenario": resolved},
        spec_hash=content_hash(resolved),
        steps=admitted.steps,
        priority=body.priority,
        timeout_s=time_limit_s(body.timeout_s, admitted.cost),
        key=own_key(idempotency_key, owner),
        request_hash=content_hash([resolved, body.priority, body.timeout_s]),
        owner=owner,
        uploads=admitted.uploads,
    )
    service.engine.wake()
    headers = {"Location": f"/api/v1/jobs/{job.id}"}
    return Response(EncodedJob.of(job).body, status.HTTP_202_ACCEPTED, headers, media_type="application/json")


@router.get(
    "",
    operation_id="list_jobs",
    summary="List jobs, newest first",
    responses=documented(),
)
def list_jobs(  # noqa: PLR0913  (the parameters of the query)
    service: ServiceOf,
    state: Annotated[State | None, Query(description="Only jobs in this state.")] = None,
    name: Annotated[str | None, Query(max_length=100, description="Only jobs of this name.")] = None,
    tag: Annotated[str | None, Query(max_length=40, description="Only jobs with this tag.")] = None,
    campaign: Annotated[str | None, Query(max_length=32, description="Only insertions of this campaign.")] = None,
    outcome: Annotated[Outcome | None, Query(description="Only jobs that finished with this outcome.")] = None,
    search: Annotated[
        str, Query(alias="q", max_length=100, description="A part of the name or of a tag, or the beginning of the id.")
    ] = "",
    sort: Annotated[
        Sort, Query(description="What they are sorted by; jobs without such a value come last.")
    ] = "submitted",
    down: Annotated[bool, Query(description="The largest, or latest, first.")] = True,
    limit: Annotated[int, Query(ge=1, le=200, description="Most items of the page.")] = 50,
    cursor: JobCursor = None,
) -> JobPage:
    """A page of jobs, without their scenarios and results."""
    wanted = JobFilter(state=state, outcome=outcome, name=name, tag=tag, campaign=campaign, containing=search.strip())
    page = service.store.page(wanted, JobOrder(sort=sort, down=down), size=limit, cursor=cursor)
    return JobPage(items=[JobSummary.of(job) for job in page.items], next_cursor=page.next_cursor)


@router.get(
    "/{job_id}",
    operation_id="get_job",
    summary="Read a job, or wait for it",
    response_model=JobView,
    responses={304: {"description": "Unchanged since the version in If-None-Match."}, **documented(404)},
)
async def get_job(
    job_id: JobId,
    service: ServiceOf,
    request: Request,
    wait: Annotated[
        float,
        Query(ge=0, le=LONGEST_WAIT_S, allow_inf_nan=False, description="Seconds to wait for the end of the job."),
    ] = 0,
    if_none_match: Annotated[str | None, Header(description="ETag of an earlier response.")] = None,
) -> Response:
    """The job now. With `wait`, once it has ended or the time is up; with If-None-Match too, as soon as it differs
    from that version."""
    now = await (_wait_for(service, request, job_id, wait, if_none_match) if wait else service.job_views.of(job_id))
    headers = {"ETag": now.tag, "Cache-Control": "no-cache"}
    if etag_matches(if_none_match, now.tag):
        return Response(status_code=status.HTTP_304_NOT_MODIFIED, headers=headers)
    return Response(now.body, status.HTTP_200_OK, headers, media_type="application/json")


async def _wait_for(service: Service, request: Request, job_id: str, wait_s: float, known: str | None) -> EncodedJob:
    """The job once it has ended, differs from the known version, or the time is up."""
    clock = asyncio.get_running_loop().time
    end = clock() + wait_s
    with service.changes.watch(job_id) as changed:
        while True:
            changed.clear()  # before reading: a change after it is not missed
            now = await service.job_views.of(job_id)
            news = known is not None and not etag_matches(known, now.tag)
            if now.terminal or news or service.changes.closed:
                return now
            while not changed.is_set():
                left = end - clock()
                if left <= 0 or await request.is_disconnected():
                    return now
                with suppress(TimeoutError):
                    await asyncio.wait_for(changed.wait(), min(left, _CHECK_S))


@router.post(
    "/{job_id}/cancel",
    operation_id="cancel_job",
    summary="Cancel a job",
    status_code=status.HTTP_202_ACCEPTED,
    responses=documented(404, 409),
)
def cancel_job(job_id: JobId, service: ServiceOf) -> JobView:
    """A queued job is cancelled at once, a running one within a second. Idempotent."""
    return JobView.of(service.store.cancel(job_id))


@router.post(
    "/{job_id}/retry",
    operation_id="retry_job",
    summary="Run a job again",
    status_code=status.HTTP_202_ACCEPTED,
    responses=documented(403, 404, 409, 503),
)
def retry_job(job_id: JobId, service: ServiceOf) -> JobView:
    """Queue a job again that failed, was cancelled or timed out; its log and the count of its attempts continue."""
    service.refuse_when_closing()
    job = service.store.retry(job_id)
    service.engine.wake()
    return JobView.of(job)
