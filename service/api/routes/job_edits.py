"""Routes of what people say about jobs and keep of them: name, tags, note, pins; one action over many jobs."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from typing import Any

from fastapi import APIRouter, Request, Response, status

from service.access import Caller, ForbiddenError
from service.api.context import Service, ServiceOf
from service.api.json_bodies import JsonBodyRoute
from service.api.openapi import documented
from service.api.ownership import require_owner
from service.api.parameters import IfMatch, JobId, matched_version
from service.api.problems import CODE_OF
from service.api.schemas.job_edits import Action, JobActionOutcome, JobPatch, JobsAction, JobsActionResult
from service.api.schemas.jobs import JobView
from service.store.job import IllegalTransitionError, InputGoneError, JobPinnedError, UnknownJobError

router = APIRouter(prefix="/api/v1/jobs", tags=["jobs"], route_class=JsonBodyRoute)

_REFUSALS = (ForbiddenError, UnknownJobError, JobPinnedError, IllegalTransitionError, InputGoneError)


@router.patch(
    "/{job_id}",
    operation_id="edit_job",
    summary="Change name, tags and note of a job",
    responses=documented(400, 403, 404, 412, 413, 415),
)
def edit_job(
    job_id: JobId, body: JobPatch, service: ServiceOf, response: Response, if_match: IfMatch = None
) -> JobView:
    """Fields that are left out keep their values. With If-Match nothing changes if somebody else was faster."""
    changed = service.store.edit(job_id, body.values(), version=matched_version(if_match, "job"))
    response.headers["ETag"] = f'"{changed.version}"'
    return JobView.of(changed)


@router.post(
    "/{job_id}/pin",
    operation_id="pin_job",
    summary="Pin a job",
    responses=documented(403, 404),
)
def pin_job(job_id: JobId, service: ServiceOf) -> JobView:
    """A pinned job is kept when old jobs are removed, and cannot be deleted. Idempotent."""
    return JobView.of(service.store.pin(job_id, pinned=True))


@router.delete(
    "/{job_id}/pin",
    operation_id="unpin_job",
    summary="Unpin a job",
    status_code=status.HTTP_204_NO_CONTENT,
    responses=documented(403, 404),
)
def unpin_job(job_id: JobId, service: ServiceOf) -> None:
    """It may be removed again. Idempotent. A job of another key needs the scope admin."""
    service.store.pin(job_id, pinned=False)


@router.delete(
    "/{job_id}",
    operation_id="delete_job",
    summary="Delete a job that has ended",
    status_code=status.HTTP_204_NO_CONTENT,
    responses=documented(404, 409),
)
def delete_job(job_id: JobId, service: ServiceOf) -> None:
    """Delete the job with its result, series and recording. A job of another key needs the scope admin."""
    _delete(service, job_id)


def _delete(service: Service, job_id: str) -> None:
    service.store.delete(job_id)
    shutil.rmtree(service.settings.jobs / job_id, ignore_errors=True)


_ACTIONS: dict[Action, Callable[[Service, str], Any]] = {
    "cancel": lambda service, job_id: service.store.cancel(job_id),
    "retry": lambda service, job_id: service.store.retry(job_id),
    "pin": lambda service, job_id: service.store.pin(job_id, pinned=True),
    "unpin": lambda service, job_id: service.store.pin(job_id, pinned=False),
    "delete": _delete,
}


@router.post(
    "/actions",
    operation_id="act_on_jobs",
    summary="Cancel, retry, pin, unpin or delete many jobs",
    responses=documented(400, 403, 413, 415, 503),
)
def act_on_jobs(body: JobsAction, service: ServiceOf, request: Request) -> JobsActionResult:
    """Each job is changed by itself, or refused for a reason that its item names; the others are not held up by it.
    A job of another key needs the scope admin."""
    if body.action == "retry":
        service.refuse_when_closing()
    items = [_act(service, request.state.caller, body.action, job_id) for job_id in body.jobs]
    if body.action == "retry":
        service.engine.wake()
    return JobsActionResult.of(items)


def _act(service: Service, caller: Caller, action: Action, job_id: str) -> JobActionOutcome:
    try:
        require_owner(caller, service, "job_id", job_id)
        _ACTIONS[action](service, job_id)
    except _REFUSALS as error:
        return JobActionOutcome.of(job_id, CODE_OF[type(error)], str(error))
    return JobActionOutcome.of(job_id)
