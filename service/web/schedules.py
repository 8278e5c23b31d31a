"""The pages of repeated work: schedules with their history, and the trend of a suite over commits and dates."""

from __future__ import annotations

from zoneinfo import available_timezones

from fastapi import APIRouter, Request, Response

from service.api.context import ServiceOf
from service.api.routes.campaigns import SuiteName, get_trend
from service.api.schemas.campaigns import ScheduleRunView, ScheduleView
from service.web.campaigns import request_form
from service.web.site import missing, page

router = APIRouter(include_in_schema=False)

RUNS = 10


@router.get("/schedules")
def get_schedules(request: Request, service: ServiceOf) -> Response:
    """All schedules with their last runs, and the form of a new one."""
    found = service.schedules.all()
    return page(
        request,
        "schedules.html",
        schedules=[
            (ScheduleView.of(one), [ScheduleRunView.of(run) for run in service.schedules.runs(one.id, limit=RUNS)])
            for one in found
        ],
        trended=set(service.campaigns.suites()),
        zones=sorted(available_timezones()),
        **request_form(),
    )


@router.get("/trends")
def get_trends(request: Request, service: ServiceOf) -> Response:
    """Every suite that has a history, with its last point."""
    return page(request, "trends.html", trends=[get_trend(suite, service) for suite in service.campaigns.suites()])


@router.get("/trends/{suite:path}")
def get_trend_page(suite: SuiteName, request: Request, service: ServiceOf) -> Response:
    """One suite over commits and dates."""
    trend = get_trend(suite, service)
    if not trend.points:
        return missing(request, f"history of a suite {suite}")
    points = [point.model_dump(mode="json") for point in trend.points]
    return page(request, "trend.html", suite=suite, points=trend.points, losses=trend.losses, data=points)
