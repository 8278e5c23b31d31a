"""The pages of suites: how well each arm did in the latest campaign, and every figure over the campaigns so far."""

from __future__ import annotations

from fastapi import APIRouter, Request, Response

from benchmarks.grid.profiles import shares
from benchmarks.paper.table import main_rows, rows
from service.api.context import ServiceOf
from service.api.parameters import SuiteName
from service.campaigns.results import outcomes
from service.campaigns.trends import trend
from service.web.pictures.history import multiples
from service.web.pictures.profiles import profile_picture
from service.web.site import missing, page

router = APIRouter(include_in_schema=False)

SHOWN = 30  # suites with their pictures on one page


@router.get("/suites")
def get_suites(request: Request, service: ServiceOf) -> Response:
    """Every suite of which a campaign has ended, with its main figures."""
    found = [trend(service.campaigns, suite) for suite in service.campaigns.suites()[:SHOWN]]
    return page(request, "suites.html", suites=[(one, multiples(one)[:2]) for one in found if one.runs])


@router.get("/suites/{suite:path}")
def get_suite(suite: SuiteName, request: Request, service: ServiceOf) -> Response:
    """One suite: the profiles of its latest campaign, its figures over time."""
    found = trend(service.campaigns, suite)
    if not found.runs:
        return missing(request, f"campaign of the suite {suite} that has ended")
    latest = found.runs[-1].campaign
    table = main_rows(rows(outcomes(service.campaigns.cases(latest.id, whole=False))))
    return page(
        request,
        "suite.html",
        suite=suite,
        latest=latest,
        runs=len(found.runs),
        profile=profile_picture(shares(table)),
        multiples=multiples(found),
    )
