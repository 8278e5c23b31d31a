"""The paper's tables, tests and figures over the insertions of any campaign."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from benchmarks.paper.page import html
from benchmarks.paper.records import Outcome
from benchmarks.paper.report import document
from service.campaigns import Campaign

HEADERS = {  # a page without scripts that loads nothing
    "Content-Security-Policy": "default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'self'",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}


def report(campaign: Campaign, found: Sequence[Outcome]) -> dict[str, Any]:
    """The report's data; of a running campaign that of the insertions that have ended."""
    origin: dict[str, Any] = next((o.result["provenance"] for o in found if "provenance" in o.result), {})
    known: dict[str, Any] = {
        name: origin[name] for name in ("commit", "versions", "platform", "cpu", "cpu_count") if name in origin
    }
    provenance: dict[str, Any] = {
        "campaign": campaign.id,
        "suite": campaign.suite,
        "suite_sha256": campaign.suite_sha256,
        "insertions": f"{len(found)} of {campaign.cases}",
        **known,
    }
    return document(found, timing=found, scale=campaign.name, provenance=provenance)


def json_text(campaign: Campaign, found: Sequence[Outcome]) -> str:
    """The report as JSON."""
    return json.dumps(report(campaign, found), allow_nan=False)


def page(campaign: Campaign, found: Sequence[Outcome]) -> str:
    """The report as one self-contained page."""
    return html(report(campaign, found))
