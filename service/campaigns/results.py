"""What the jobs of a campaign amount to, for the analyses of the paper: one outcome for each insertion."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from benchmarks.cases import Case, Outcome
from service.store.campaign import CampaignCase
from service.store.job import TERMINAL


def outcomes(cases: Iterable[CampaignCase]) -> list[Outcome]:
    """The cases that have ended. A job that left no result is an insertion that failed, with the reason."""
    return [Outcome(_case(case), case.result or _failure(case)) for case in cases if _ended(case)]


def _ended(case: CampaignCase) -> bool:
    return case.result is not None or case.state is None or case.state in TERMINAL


def _case(case: CampaignCase) -> Case:
    scenario = (case.result or {}).get("provenance", {}).get("scenario", {})
    return Case(case.case_id, scenario, case.labels)


def _failure(case: CampaignCase) -> dict[str, Any]:
    status = case.error_kind or case.state or "deleted"
    return {"status": status, "message": case.error or "", "metrics": {"stable": False, "success": False}}


def origin(results: Iterable[Outcome]) -> dict[str, Any]:
    """The provenance of the first insertion that has one; the others ran on the same service."""
    return next((one.result["provenance"] for one in results if "provenance" in one.result), {})
