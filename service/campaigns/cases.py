"""The cases of a campaign as rows of a table: what each insertion measured, and the scores of all."""

from __future__ import annotations

import math
import statistics
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from benchmarks.paper.table import Row, arms, by_group, main_rows, only

if TYPE_CHECKING:
    from collections.abc import Sequence

    from service.store.campaign import CampaignCase

Column = Literal["number", "case", "state", "outcome", "rmse", "max", "final", "step"]


@dataclass(frozen=True, kw_only=True)
class CaseResult:
    """One insertion of a campaign. Numbers are None before its end and where it failed.

    job_id: None once the job was deleted. status: how the run ended, as in result.json. outcome: the same in words.
    message: why it failed. step_ms: median of the plant's steps.
    """

    number: int
    case_id: str
    labels: dict[str, Any]
    job_id: str | None
    state: str | None
    status: str | None
    outcome: str
    message: str
    success: bool | None
    rmse_commanded_mm: float | None
    max_commanded_mm: float | None
    final_same_time_mm: float | None
    step_ms: float | None
    digest: str | None

    @classmethod
    def of(cls, case: CampaignCase) -> CaseResult:
        """The row of one case."""
        result = case.result or {}
        metrics = result.get("metrics") or {}
        return cls(
            number=case.number,
            case_id=case.case_id,
            labels=case.labels,
            job_id=case.job_id,
            state=case.state,
            status=result.get("status"),
            outcome=_outcome(case),
            message=case.error or result.get("message") or "",
            success=metrics.get("success"),
            rmse_commanded_mm=metrics.get("rmse_commanded_mm"),
            max_commanded_mm=metrics.get("max_commanded_mm"),
            final_same_time_mm=metrics.get("final_same_time_mm"),
            step_ms=((result.get("timing") or {}).get("plant") or {}).get("median_ms"),
            digest=result.get("digest"),
        )


def _outcome(case: CampaignCase) -> str:
    if case.result is None:
        return (case.error_kind or "").replace("_", " ")
    if (case.result.get("metrics") or {}).get("success"):
        return "on target"
    return str(case.result.get("status", "")).replace("_", " ") + ", no success"


_FIELDS: dict[Column, str] = {
    "number": "number",
    "case": "case_id",
    "state": "state",
    "outcome": "outcome",
    "rmse": "rmse_commanded_mm",
    "max": "max_commanded_mm",
    "final": "final_same_time_mm",
    "step": "step_ms",
}


def sorted_cases(cases: Sequence[CampaignCase], column: Column, *, descending: bool) -> list[CaseResult]:
    """The cases sorted by a column; those without a value there come last in either direction."""
    rows, name = [CaseResult.of(case) for case in cases], _FIELDS[column]
    known = [row for row in rows if getattr(row, name) is not None]
    ordered = sorted(known, key=lambda row: getattr(row, name), reverse=descending)
    return ordered + [row for row in rows if getattr(row, name) is None]


@dataclass(frozen=True, kw_only=True)
class Score:
    """The insertions of one controller in one group. Errors in mm; None where the figure is that of a failure."""

    group: str
    controller: str
    insertions: int
    stable: int
    successful: int
    median_rmse_mm: float | None
    worst_rmse_mm: float | None


def scores(table: Sequence[Row]) -> list[Score]:
    """One for each group and controller of the main rows."""
    return [
        _score(group, arm, only(members, arm=arm))
        for group, members in by_group(main_rows(table)).items()
        for arm in arms(members)
    ]


def _score(group: str, controller: str, rows: Sequence[Row]) -> Score:
    errors = sorted(row.rmse_commanded_mm for row in rows)
    return Score(
        group=group,
        controller=controller,
        insertions=len(rows),
        stable=sum(row.stable for row in rows),
        successful=sum(row.success for row in rows),
        median_rmse_mm=_finite(statistics.median(errors)),
        worst_rmse_mm=_finite(errors[-1]),
    )


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
