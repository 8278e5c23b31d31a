"""Routes of schedules: campaigns that run at set times."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Request, Response, status

from service.api.context import ServiceOf
from service.api.json_bodies import JsonBodyRoute
from service.api.openapi import documented
from service.api.parameters import IfMatch, ScheduleId, matched_version
from service.api.schemas.schedules import (
    CronPreview,
    ScheduleList,
    SchedulePatch,
    ScheduleRequest,
    ScheduleRunList,
    ScheduleRunView,
    ScheduleView,
)

router = APIRouter(prefix="/api/v1/schedules", tags=["schedules"], route_class=JsonBodyRoute)


@router.post(
    "",
    operation_id="create_schedule",
    summary="Schedule a campaign",
    status_code=status.HTTP_201_CREATED,
    responses=documented(400, 403, 409, 413, 415),
)
def create_schedule(body: ScheduleRequest, service: ServiceOf, request: Request, response: Response) -> ScheduleView:
    """The campaign is checked now, and created again at each tick."""
    caller = request.state.caller
    caller.require_priority(body.campaign.priority)
    service.planner.plan(body.campaign)
    schedule = service.schedules.create({**body.values(), "owner": caller.key_id})
    response.headers["Location"] = f"/api/v1/schedules/{schedule.id}"
    response.headers["ETag"] = f'"{schedule.version}"'
    return ScheduleView.of(schedule)


@router.get("", operation_id="list_schedules", summary="List the schedules", responses=documented())
def list_schedules(service: ServiceOf) -> ScheduleList:
    """All of them, by name."""
    return ScheduleList(items=[ScheduleView.of(one) for one in service.schedules.all()])


@router.get(
    "/preview",
    operation_id="preview_cron",
    summary="Read a cron line",
    responses=documented(),
)
def preview_cron(
    service: ServiceOf,
    cron: Annotated[str, Query(min_length=1, max_length=200, description="As in 0 2 * * *.")],
    timezone: Annotated[str, Query(min_length=1, max_length=64, description="IANA time zone.")] = "UTC",
) -> CronPreview:
    """The line as a sentence, and its next three moments."""
    return CronPreview.of(cron, timezone, service.store.now)


@router.get("/{schedule_id}", operation_id="get_schedule", summary="Read a schedule", responses=documented(404))
def get_schedule(schedule_id: ScheduleId, service: ServiceOf, response: Response) -> ScheduleView:
    """The schedule now; its ETag goes into If-Match of a change."""
    one = service.schedules.get(schedule_id)
    response.headers["ETag"] = f'"{one.version}"'
    return ScheduleView.of(one)


@router.patch(
    "/{schedule_id}",
    operation_id="change_schedule",
    summary="Change a schedule",
    responses=documented(400, 403, 404, 409, 412, 413, 415),
)
def change_schedule(
    schedule_id: ScheduleId,
    body: SchedulePatch,
    service: ServiceOf,
    request: Request,
    response: Response,
    if_match: IfMatch = None,
) -> ScheduleView:
    """Fields that are left out keep their values. With If-Match nothing changes if somebody else was faster."""
    if body.campaign is not None:
        request.state.caller.require_priority(body.campaign.priority)
        service.planner.plan(body.campaign)
    changed = service.schedules.change(schedule_id, body.values(), version=matched_version(if_match, "schedule"))
    response.headers["ETag"] = f'"{changed.version}"'
    return ScheduleView.of(changed)


@router.delete(
    "/{schedule_id}",
    operation_id="delete_schedule",
    summary="Delete a schedule",
    status_code=status.HTTP_204_NO_CONTENT,
    responses=documented(403, 404),
)
def delete_schedule(schedule_id: ScheduleId, service: ServiceOf) -> None:
    """Delete the schedule and its history; the campaigns that it started are kept."""
    service.schedules.delete(schedule_id)


@router.post(
    "/{schedule_id}/trigger",
    operation_id="trigger_schedule",
    summary="Run the campaign of a schedule now",
    status_code=status.HTTP_202_ACCEPTED,
    responses=documented(403, 404, 503),
)
def trigger_schedule(schedule_id: ScheduleId, service: ServiceOf) -> ScheduleRunView:
    """As if it were due; its overlap rule applies."""
    service.refuse_when_closing()
    run = service.schedules.trigger(schedule_id, service.planner.of_stored)
    service.engine.wake()
    return ScheduleRunView.of(run)


@router.get(
    "/{schedule_id}/runs",
    operation_id="list_schedule_runs",
    summary="List the runs of a schedule",
    responses=documented(404),
)
def list_schedule_runs(
    schedule_id: ScheduleId,
    service: ServiceOf,
    limit: Annotated[int, Query(ge=1, le=1000, description="Most items of the list.")] = 100,
) -> ScheduleRunList:
    """Newest first."""
    return ScheduleRunList(items=[ScheduleRunView.of(run) for run in service.schedules.runs(schedule_id, limit=limit)])
