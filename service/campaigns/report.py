"""The report of a campaign: the paper's tables, tests and figures, or those of a parameter grid."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from benchmarks.cases import Outcome
from benchmarks.grid import page as grid_page
from benchmarks.grid import report as grid_report
from benchmarks.paper.failure_places import chosen
from benchmarks.paper.page import html
from benchmarks.paper.report import document
from benchmarks.paper.table import rows
from service.campaigns.results import outcomes
from service.store.campaign import Campaign, CampaignCase

HEADERS = {  # a page without scripts that loads nothing
    "Content-Security-Policy": "default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'self'",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}


def report(campaign: Campaign, cases: Sequence[CampaignCase]) -> dict[str, Any]:
    """The report's data: of a grid its own, of a named suite the paper's; of a running campaign so far."""
    found = outcomes(cases)
    links = {case.case_id: f"/jobs/{case.job_id}" for case in cases if case.job_id is not None}
    provenance = _provenance(campaign, found)
    if axes := campaign.request.get("grid"):
        return grid_report.document(found, axes, name=campaign.name, links=links, provenance=provenance)
    telling = {case_id: links[case_id] for case_id, _ in chosen(rows(found)) if case_id in links}
    return document(found, timing=found, recordings=telling, scale=campaign.name, provenance=provenance)


def _provenance(campaign: Campaign, found: Sequence[Outcome]) -> dict[str, Any]:
    origin: dict[str, Any] = next((o.result["provenance"] for o in found if "provenance" in o.result), {})
    known: dict[str, Any] = {
        name: origin[name] for name in ("commit", "versions", "platform", "cpu", "cpu_count") if name in origin
    }
    return {
        "campaign": campaign.id,
        "suite": campaign.suite,
        "suite_sha256": campaign.suite_sha256,
        "insertions": f"{len(found)} of {campaign.cases}",
        **known,
    }


def json_text(campaign: Campaign, cases: Sequence[CampaignCase]) -> str:
    """The report as JSON."""
    return json.dumps(report(campaign, cases), allow_nan=False)


def page(campaign: Campaign, cases: Sequence[CampaignCase]) -> str:
    """The report as one self-contained page."""
    made = report(campaign, cases)
    return grid_page.html(made) if made["schema"] == grid_report.SCHEMA else html(made)
