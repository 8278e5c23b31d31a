"""The report of a campaign: the paper's tables, tests and figures, or those of a parameter grid."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from benchmarks.grid import page as grid_page
from benchmarks.grid import report as grid_report
from benchmarks.paper.failure_places import notable_cases
from benchmarks.paper.page import html
from benchmarks.paper.report import document
from benchmarks.paper.table import rows
from service.campaigns.results import origin, outcomes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from benchmarks.cases import Outcome
    from service.store.campaign import Campaign, CampaignCase


def report(campaign: Campaign, cases: Sequence[CampaignCase]) -> dict[str, Any]:
    """The report's data: a grid has its own kind, a named suite the paper's; of a running campaign so far."""
    results = outcomes(cases)
    links = {case.case_id: f"/jobs/{case.job_id}" for case in cases if case.job_id is not None}
    provenance = _provenance(campaign, results)
    if axes := campaign.request.get("grid"):
        return grid_report.document(results, axes, name=campaign.name, links=links, provenance=provenance)
    shown = {case_id: links[case_id] for case_id, _ in notable_cases(rows(results)) if case_id in links}
    return document(results, timing=results, recordings=shown, scale=campaign.name, provenance=provenance)


def page_of_outcomes(
    results: Sequence[Outcome], *, name: str, axes: dict[str, list[Any]] | None, provenance: dict[str, Any]
) -> str:
    """The page of a campaign without a service. axes: of a grid; None for a named suite."""
    if axes:
        return grid_page.html(grid_report.document(results, axes, name=name, links={}, provenance=provenance))
    return html(document(results, timing=results, recordings={}, scale=name, provenance=provenance))


def _provenance(campaign: Campaign, results: Sequence[Outcome]) -> dict[str, Any]:
    source = origin(results)
    names = ("commit", "versions", "platform", "cpu", "cpu_count")
    return {
        "campaign": campaign.id,
        "suite": campaign.suite,
        "suite_sha256": campaign.suite_sha256,
        "insertions": f"{len(results)} of {campaign.cases}",
        **{name: source[name] for name in names if name in source},
    }


def json_text(campaign: Campaign, cases: Sequence[CampaignCase]) -> str:
    """The report as JSON."""
    return json.dumps(report(campaign, cases), allow_nan=False)


def page(campaign: Campaign, cases: Sequence[CampaignCase]) -> str:
    """The report as one self-contained page."""
    data = report(campaign, cases)
    return grid_page.html(data) if data["schema"] == grid_report.SCHEMA else html(data)
