"""A suite over commits and dates: which run is worse than those before it, beyond noise.

Accuracy is compared with the run before: the same digests are the same result; else a paired sign test over the cases
that both have. Time is compared with the history of the same machine by a robust rule, since timings have outliers.
"""

from __future__ import annotations

import math
import statistics
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

SIGNIFICANCE = 0.01  # [ours] two-tailed p below which a difference of paired errors is taken to be real
WORTH_MM = 0.005  # [ours] median difference below which a real one is not worth a mark
SPREADS = 4.0  # [ours] robust standard deviations of the history that a time may be above its median
FLOOR = 0.10  # [ours] least share above the median that counts: a machine an hour later is not the same
LEAST_HISTORY = 3  # runs on the same machine before a time can be judged
_NORMAL = 1.4826  # median absolute deviation -> standard deviation, for a normal distribution


class Mark(StrEnum):
    """How a figure compares with the runs before."""

    UNJUDGED = "unjudged"  # nothing to compare with, or too little
    SAME = "same"  # identical, or within noise
    BETTER = "better"
    WORSE = "worse"


@dataclass(frozen=True)
class Point:
    """One run of a suite. rmse_commanded_mm: of each case by its id, inf where it failed; digests too. beside: medians
    of what a small tip error may have been paid with, None where it was not measured. arms: what ran, by name: id and
    code of each.

    at: UTC seconds since 1970. machine: processor and number of cores. step_ms: median of the cases' median steps,
    None where none was measured.
    """

    at: float
    commit: str | None
    machine: str
    rmse_commanded_mm: Mapping[str, float]
    digests: Mapping[str, str]
    successes: int
    step_ms: float | None
    beside: Mapping[str, float | None]
    arms: Mapping[str, str]

    @property
    def median_rmse_mm(self) -> float:
        """Median over the cases, failures last; nan of none."""
        ordered = sorted(_ranked(error) for error in self.rmse_commanded_mm.values())
        return ordered[len(ordered) // 2] if ordered else math.nan


@dataclass(frozen=True)
class Judgement:
    """Marks of one point and the sentence behind each."""

    accuracy: Mark
    accuracy_why: str
    success: Mark
    success_why: str
    time: Mark
    time_why: str

    @property
    def regression(self) -> bool:
        """Whether anything got worse."""
        return Mark.WORSE in (self.accuracy, self.success, self.time)


def judge(point: Point, before: Sequence[Point]) -> Judgement:
    """A point against those before it, oldest first."""
    last = before[-1] if before else None
    accuracy, accuracy_why = _accuracy(point, last)
    success, success_why = _success(point, last)
    time, time_why = _time(point, [p for p in before if p.machine == point.machine])
    return Judgement(accuracy, accuracy_why, success, success_why, time, time_why)


def judge_all(points: Sequence[Point]) -> list[Judgement]:
    """Every point of a history, oldest first, against those before it."""
    return [judge(point, points[:i]) for i, point in enumerate(points)]


@dataclass(frozen=True)
class Loss:
    """What got worse and has not recovered: `figure` (accuracy or success) since point `since` of the history; the
    last point is still worse than the one before that, and `why` says by how much."""

    figure: str
    since: int
    why: str


def lasting_losses(points: Sequence[Point]) -> list[Loss]:
    """The losses of a history, oldest first. A time is judged against many runs, so it needs no such check."""
    marks = judge_all(points)
    losses = []
    for figure in ("accuracy", "success"):
        for i, mark in enumerate(marks):
            if getattr(mark, figure) is Mark.WORSE:
                now = judge(points[-1], [points[i - 1]])
                if getattr(now, figure) is Mark.WORSE:
                    losses.append(Loss(figure, i, getattr(now, f"{figure}_why")))
                    break
    return losses


def _accuracy(point: Point, last: Point | None) -> tuple[Mark, str]:
    shared = [case for case in point.rmse_commanded_mm if last is not None and case in last.rmse_commanded_mm]
    if last is None or not shared:
        return Mark.UNJUDGED, "there is no earlier run of these cases"
    changed = [case for case in shared if point.digests.get(case) != last.digests.get(case)]
    if not changed:
        return Mark.SAME, f"all {len(shared)} digests unchanged"
    others = [f"{arm} {last.arms[arm]} -> {ran}" for arm, ran in point.arms.items() if last.arms.get(arm, ran) != ran]
    gaps = [_gap(point.rmse_commanded_mm[case], last.rmse_commanded_mm[case]) for case in shared]
    above, below = sum(gap > 0 for gap in gaps), sum(gap < 0 for gap in gaps)
    from scipy.stats import binomtest  # a second of imports that readers of this module do not wait for

    p = float(binomtest(above, above + below).pvalue) if above + below else 1.0
    middle = statistics.median(gaps)
    why = f"{len(changed)} of {len(shared)} digests changed; RMSE {middle:+.4f} mm in the median, sign test p = {p:.2g}"
    why += f"; other arms: {', '.join(others)}" if others else ""
    if abs(middle) >= WORTH_MM and 2.0 ** (1 - above - below) >= SIGNIFICANCE:  # p of that many alike signs
        return Mark.UNJUDGED, f"{why}; {above + below} cases are too few to tell a difference from chance"
    if p >= SIGNIFICANCE or abs(middle) < WORTH_MM:
        return Mark.SAME, why
    return (Mark.WORSE if middle > 0 else Mark.BETTER), why


def _gap(now_mm: float, then_mm: float) -> float:
    now, then = _ranked(now_mm), _ranked(then_mm)
    return 0.0 if now == then else now - then  # two failures are a tie


def _ranked(error_mm: float) -> float:
    return error_mm if math.isfinite(error_mm) else math.inf  # what is no number never wins


def _success(point: Point, last: Point | None) -> tuple[Mark, str]:
    if last is None or point.rmse_commanded_mm.keys() != last.rmse_commanded_mm.keys():
        return Mark.UNJUDGED, "there is no earlier run of the same cases"
    why = f"{point.successes} of {len(point.rmse_commanded_mm)} succeeded, {last.successes} before"
    if point.successes == last.successes:
        return Mark.SAME, why
    return (Mark.WORSE if point.successes < last.successes else Mark.BETTER), why


def _time(point: Point, history: Sequence[Point]) -> tuple[Mark, str]:
    known = [p.step_ms for p in history if p.step_ms is not None]
    if point.step_ms is None or len(known) < LEAST_HISTORY:
        return Mark.UNJUDGED, f"needs {LEAST_HISTORY} earlier runs on this machine, there are {len(known)}"
    middle = statistics.median(known)
    deviation = _NORMAL * statistics.median(abs(step - middle) for step in known)
    allowed = max(SPREADS * deviation, FLOOR * middle)
    why = f"step {point.step_ms:.2f} ms, {middle:.2f} +- {allowed:.2f} ms in {len(known)} earlier runs on this machine"
    if abs(point.step_ms - middle) <= allowed:
        return Mark.SAME, why
    return (Mark.WORSE if point.step_ms > middle else Mark.BETTER), why
