"""Routes of jobs: submit, list, follow, cancel, delete."""

from __future__ import annotations

import asyncio
import shutil
from contextlib import suppress
from typing import Annotated, Any

from fastapi import APIRouter, Header, Query, Request, Response, status

from service.admission.cost import Cost, check_cost, time_limit_s
from service.api.context import JobId, Service, ServiceOf, documented, matches
from service.api.idempotency import IdempotencyKey, own_key
from service.api.job_view_cache import Status
from service.api.schemas.jobs import JobPage, JobRequest, JobSummary, JobView, State
from service.store.job import content_hash
from simcore.file_names import names_mean
from simcore.scenario.presets import preset
from simcore.scenario.scenario import Scenario

router = APIRouter(prefix="/api/v1/jobs", tags=["jobs"])

LONGEST_WAIT_S = 60.0
_LOOK_S = 20.0  # how often a long poll looks whether somebody still waits for it
LOCATION = {"Location": {"description": "Where the job is.", "schema": {"type": "string"}}}


@router.post(
    "",
    operation_id="submit_job",
    summary="Submit a job",
    status_code=status.HTTP_202_ACCEPTED,
    response_model=JobView,
    responses={202: {"description": "Queued.", "headers": LOCATION}, **documented(400, 413, 415, 503)},
)
def submit_job(
    body: JobRequest,
    service: ServiceOf,
    request: Request,
    idempotency_key: IdempotencyKey = None,
) -> Response:
    """Queue one insertion. The scenario is checked first: what is wrong with it is named field by field."""
    service.refuse_when_closing()
    scenario, cost, uploads = _scenario(body.scenario, service)
    resolved = scenario.resolved()
    owner = request.state.caller.key_id
    job = service.store.submit(
        name=scenario.name,
        spec={"scenario": resolved},
        spec_hash=content_hash(resolved),
        steps=scenario.steps,
        priority=body.priority,
        timeout_s=time_limit_s(body.timeout_s, cost),
        key=own_key(idempotency_key, owner),
        request_hash=content_hash([resolved, body.priority, body.timeout_s]),
        owner=owner,
        uploads=sorted(uploads),
    )
    service.engine.wake()
    headers = {"Location": f"/api/v1/jobs/{job.id}"}
    return Response(Status.of(job).body, status.HTTP_202_ACCEPTED, headers, media_type="application/json")


def _scenario(value: Any, service: Service) -> tuple[Scenario, Cost, set[str]]:
    """The scenario, what it costs, the ids of uploads that it names. Raises ScenarioError, also if that is too much."""
    with names_mean(lookup := service.uploads.lookup()):
        scenario = preset(value) if isinstance(value, str) else Scenario.load(value)
        cost = check_cost(scenario, service.settings.limits)
    return scenario, cost, lookup.used


@router.get(
    "",
    operation_id="list_jobs",
    summary="List jobs, newest first",
    responses=documented(),
)
def list_jobs(
    service: ServiceOf,
    state: Annotated[State | None, Query(description="Only jobs in this state.")] = None,
    limit: Annotated[int, Query(ge=1, le=200, description="At most so many.")] = 50,
    cursor: Annotated[str | None, Query(pattern="^[0-9]{1,18}$", description="next_cursor of the page before.")] = None,
) -> JobPage:
    """A page of jobs, without their scenarios and results."""
    found = service.store.newest(state=state, limit=limit + 1, before=int(cursor) if cursor else None)
    items, more = found[:limit], len(found) > limit
    return JobPage(items=[JobSummary.of(job) for job in items], next_cursor=str(items[-1].seq) if more else None)


@router.get(
    "/{job_id}",
    operation_id="get_job",
    summary="Read a job, or wait for it",
    response_model=JobView,
    responses={304: {"description": "Not changed since the version in If-None-Match."}, **documented(404)},
)
async def get_job(
    job_id: JobId,
    service: ServiceOf,
    request: Request,
    wait: Annotated[
        float,
        Query(ge=0, le=LONGEST_WAIT_S, allow_inf_nan=False, description="Seconds to wait for the job's end."),
    ] = 0,
    if_none_match: Annotated[str | None, Header(description="ETag of a reading before.")] = None,
) -> Response:
    """The job now. With `wait`, when it has ended or the time is over; with If-None-Match too, as soon as it
    differs from that version."""
    now = await (_settled(service, request, job_id, wait, if_none_match) if wait else service.statuses.of(job_id))
    headers = {"ETag": now.tag, "Cache-Control": "no-cache"}
    if matches(if_none_match, now.tag):
        return Response(status_code=status.HTTP_304_NOT_MODIFIED, headers=headers)
    return Response(now.body, status.HTTP_200_OK, headers, media_type="application/json")


async def _settled(service: Service, request: Request, job_id: str, wait_s: float, known: str | None) -> Status:
    """The job once there is something to answer."""
    clock = asyncio.get_running_loop().time
    end = clock() + wait_s
    with service.changes.watch(job_id) as changed:
        while True:
            changed.clear()  # before reading: a change after it is not missed
            now = await service.statuses.of(job_id)
            news = known is not None and not matches(known, now.tag)
            if now.terminal or news or service.changes.closed:
                return now
            while not changed.is_set():
                left = end - clock()
                if left <= 0 or await request.is_disconnected():
                    return now
                with suppress(TimeoutError):
                    await asyncio.wait_for(changed.wait(), min(left, _LOOK_S))


@router.post(
    "/{job_id}/cancel",
    operation_id="cancel_job",
    summary="Cancel a job",
    status_code=status.HTTP_202_ACCEPTED,
    responses=documented(404, 409),
)
def cancel_job(job_id: JobId, service: ServiceOf) -> JobView:
    """A queued job is cancelled at once, a running one within a second. Once more is no error."""
    return JobView.of(service.store.cancel(job_id))


@router.post(
    "/{job_id}/retry",
    operation_id="retry_job",
    summary="Run a job again",
    status_code=status.HTTP_202_ACCEPTED,
    responses=documented(403, 404, 409, 503),
)
def retry_job(job_id: JobId, service: ServiceOf) -> JobView:
    """Queue a job again that failed, was cancelled or ran out of time; its log goes on, its attempts count on."""
    service.refuse_when_closing()
    job = service.store.retry(job_id)
    service.engine.wake()
    return JobView.of(job)


@router.post(
    "/{job_id}/pin",
    operation_id="pin_job",
    summary="Keep a job",
    responses=documented(403, 404),
)
def pin_job(job_id: JobId, service: ServiceOf) -> JobView:
    """It is passed over when old jobs are cleared away, and cannot be deleted. Once more is no error."""
    return JobView.of(service.store.pin(job_id, pinned=True))


@router.delete(
    "/{job_id}/pin",
    operation_id="unpin_job",
    summary="Keep a job no longer",
    status_code=status.HTTP_204_NO_CONTENT,
    responses=documented(403, 404),
)
def unpin_job(job_id: JobId, service: ServiceOf, request: Request) -> None:
    """It may be cleared away again. Once more is no error. Another key's needs the scope admin."""
    request.state.caller.must_own(service.store.get_summary(job_id).owner, f"job {job_id}")
    service.store.pin(job_id, pinned=False)


@router.delete(
    "/{job_id}",
    operation_id="delete_job",
    summary="Delete a job that has ended",
    status_code=status.HTTP_204_NO_CONTENT,
    responses=documented(404, 409),
)
def delete_job(job_id: JobId, service: ServiceOf, request: Request) -> None:
    """Forget the job, with its result, series and recording. Another key's needs the scope admin."""
    request.state.caller.must_own(service.store.get_summary(job_id).owner, f"job {job_id}")
    service.store.delete(job_id)
    shutil.rmtree(service.settings.jobs / job_id, ignore_errors=True)
