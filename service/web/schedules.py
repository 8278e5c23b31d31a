"""The pages of schedules with their history, and of the trend of a suite over commits and dates."""

from __future__ import annotations

from typing import NamedTuple
from zoneinfo import available_timezones

from fastapi import APIRouter, Request, Response

from benchmarks.trend import Mark
from service.api.context import ServiceOf
from service.api.parameters import SuiteName
from service.api.schemas.campaigns import Trend
from service.api.schemas.schedules import ScheduleRunView, ScheduleView
from service.campaigns.trends import trend
from service.store.schedule import next_ticks
from service.web.campaigns import request_form
from service.web.formatting import when
from service.web.site import missing, page

router = APIRouter(include_in_schema=False)

RUNS = 10
FIGURES = ("accuracy", "success", "time")
NEXT = 3  # ticks that are shown before they come


@router.get("/schedules")
def get_schedules(request: Request, service: ServiceOf) -> Response:
    """All schedules with their last runs, and the form of a new one."""
    return page(
        request,
        "schedules.html",
        schedules=[
            (
                ScheduleView.of(one),
                next_ticks(one.cron, one.timezone, service.store.now, NEXT) if one.enabled else [],
                [ScheduleRunView.of(run) for run in service.schedules.runs(one.id, limit=RUNS)],
            )
            for one in service.schedules.all()
        ],
        trended=set(service.campaigns.suites()),
        zones=sorted(available_timezones()),
        **request_form(),
    )


@router.get("/trends")
def get_trends(request: Request, service: ServiceOf) -> Response:
    """Every suite that has a history, with its last point."""
    views = [Trend.of(trend(service.campaigns, suite)) for suite in service.campaigns.suites()]
    return page(request, "trends.html", trends=[(view, verdict_of(view)) for view in views if view.points])


@router.get("/trends/{suite:path}")
def get_trend(suite: SuiteName, request: Request, service: ServiceOf) -> Response:
    """One suite over commits and dates."""
    view = Trend.of(trend(service.campaigns, suite))
    if not view.points:
        return missing(request, f"history of the suite {suite}")
    points = [point.model_dump(mode="json") for point in view.points]
    verdict = verdict_of(view)
    return page(
        request, "trend.html", suite=suite, points=view.points, losses=view.losses, data=points, verdict=verdict
    )


class Verdict(NamedTuple):
    """What can be said of the last run of a suite. judged: figures that are no worse; open: (figure, why it cannot be
    judged)."""

    state: str
    text: str
    judged: list[str]
    open: list[tuple[str, str]]


def verdict_of(view: Trend) -> Verdict:
    """Of a suite with at least one run. No regression is said of what could be judged alone."""
    last = view.points[-1]
    judged = [name for name in FIGURES if getattr(last, name) in (Mark.SAME, Mark.BETTER)]
    open_ = [(name, getattr(last, f"{name}_why")) for name in FIGURES if getattr(last, name) == Mark.UNJUDGED]
    if last.regression:
        return Verdict("worse", "got worse", judged, open_)
    if view.losses:
        return Verdict("worse", f"worse since {when(view.losses[0].at)}", judged, open_)
    if not judged:
        return Verdict("", "not judged yet", judged, open_)
    only = "" if not open_ else f" in {' and '.join(judged)}"
    return Verdict("done", f"no regression{only}", judged, open_)
