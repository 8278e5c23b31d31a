"""The cases of a campaign as rows of a table: what each insertion measured, and the scores of all."""

from __future__ import annotations

import math
import statistics
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from benchmarks.paper.table import BESIDE, Row, arms, beside, by_group, main_rows
from service.store.job import INSERTION, outcome_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from service.store.campaign import CampaignCase

Column = Literal[
    "number",
    "case",
    "state",
    "outcome",
    "rmse",
    "max",
    "final",
    "rcm",
    "push",
    "lateral",
    "drag",
    "strain",
    "stress",
    "step",
]


@dataclass(frozen=True, kw_only=True)
class CaseResult:
    """One insertion of a campaign. Numbers are None before its end and where it failed.

    job_id: None once the job was deleted. status: how the run ended, as in result.json. outcome: success, missed or the
    status; the error of a job that left no result. message: why it failed. beside: each metric of `BESIDE`. step_ms:
    median of the plant's steps.
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
    final_commanded_mm: float | None
    beside: dict[str, float | None]
    step_ms: float | None
    digest: str | None
    warnings: list[str]

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
            outcome=outcome_of(INSERTION, case.result) or case.error_kind or "",
            message=case.error or result.get("message") or "",
            success=metrics.get("success"),
            rmse_commanded_mm=metrics.get("rmse_commanded_mm"),
            max_commanded_mm=metrics.get("max_commanded_mm"),
            final_commanded_mm=metrics.get("final_commanded_mm"),
            beside={metric: metrics.get(metric) for metric in BESIDE},
            step_ms=((result.get("timing") or {}).get("plant") or {}).get("median_ms"),
            digest=result.get("digest"),
            warnings=[str(one) for one in result.get("warnings") or ()],
        )

    def value(self, name: str) -> Any:
        """A field, or a metric of `beside`."""
        return self.beside[name] if name in self.beside else getattr(self, name)


FIELDS: dict[Column, str] = {
    "number": "number",
    "case": "case_id",
    "state": "state",
    "outcome": "outcome",
    "rmse": "rmse_commanded_mm",
    "max": "max_commanded_mm",
    "final": "final_commanded_mm",
    "rcm": "rcm_max_mm",
    "push": "max_push_n",
    "lateral": "max_lateral_n",
    "drag": "entry_drag_mm",
    "strain": "max_strain",
    "stress": "max_needle_stress_mpa",
    "step": "step_ms",
}


@dataclass(frozen=True)
class CaseMeasure:
    """A number of a case: its field, the heading with its unit, decimals."""

    field: str
    heading: str
    digits: int


MEASURES: dict[str, CaseMeasure] = {
    "rmse": CaseMeasure("rmse_commanded_mm", "RMSE, mm", 3),
    "max": CaseMeasure("max_commanded_mm", "Largest error, mm", 3),
    "final": CaseMeasure("final_commanded_mm", "Final error, mm", 3),
    **{name: CaseMeasure(field, *BESIDE[field]) for name, field in FIELDS.items() if field in BESIDE},
    "step": CaseMeasure("step_ms", "Plant step, ms", 2),
}  # by the name of its column


def sorted_cases(rows: Sequence[CaseResult], column: Column, *, descending: bool) -> list[CaseResult]:
    """The cases sorted by a column; those without a value there come last in either direction."""
    name = FIELDS[column]
    known = [row for row in rows if _ranks(row.value(name))]
    ordered = sorted(known, key=lambda row: row.value(name), reverse=descending)
    return ordered + [row for row in rows if not _ranks(row.value(name))]


def _ranks(value: Any) -> bool:
    return value is not None and (not isinstance(value, float) or math.isfinite(value))


@dataclass(frozen=True, kw_only=True)
class Score:
    """The insertions of one arm in one group. Errors in mm; None where the figure is that of a failure. beside:
    medians of `BESIDE` over the stable ones. yielded: how many needles would have stayed bent."""

    group: str
    arm: str
    insertions: int
    stable: int
    successful: int
    median_rmse_mm: float | None
    worst_rmse_mm: float | None
    beside: dict[str, float | None]
    yielded: int


def scores(table: Sequence[Row]) -> list[Score]:
    """One for each group and arm of the main rows."""
    found = []
    for group, members in by_group(main_rows(table)).items():
        of_arm: dict[str, list[Row]] = {}
        for row in members:
            of_arm.setdefault(row.arm, []).append(row)
        found += [_score(group, arm, of_arm[arm]) for arm in arms(members)]
    return found


def _score(group: str, arm: str, rows: Sequence[Row]) -> Score:
    errors = sorted(row.rmse_commanded_mm for row in rows)
    return Score(
        group=group,
        arm=arm,
        insertions=len(rows),
        stable=sum(row.stable for row in rows),
        successful=sum(row.success for row in rows),
        median_rmse_mm=_finite(statistics.median(errors)),
        worst_rmse_mm=_finite(errors[-1]),
        beside={metric: _finite(value) for metric, value in beside(rows).items()},
        yielded=sum(bool(row.yielded) for row in rows),
    )


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
