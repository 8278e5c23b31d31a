"""Two reports side by side: which figures changed by more than their noise."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from benchmarks.measurements import Table, verdict_of
from simcore.errors import Problem, ScenarioError

# A figure has changed if its medians are farther apart than the two interquartile ranges together, and than a floor:
# a few runs in a row agree better with each other than with the same runs an hour later.
FLOOR = 0.03
FLOOR_SINGLE = 0.15  # where one side is a single run, which tells nothing about its own spread


class Verdict(StrEnum):
    """How a figure changed."""

    SAME = "same"
    BETTER = "better"
    WORSE = "worse"
    ONLY_A = "only in A"
    ONLY_B = "only in B"


@dataclass(frozen=True)
class Change:
    """One figure in both reports; noise is the difference that would not count, in the figure's unit."""

    key: str
    unit: str
    a: float | None
    b: float | None
    noise: float | None
    verdict: Verdict
    met: bool | None

    @property
    def percent(self) -> float | None:
        """(B - A) / |A| in per cent."""
        if self.a is None or self.b is None or self.a == 0.0:
            return None
        return 100.0 * (self.b - self.a) / abs(self.a)


def compare(a: dict[str, Any], b: dict[str, Any]) -> list[Change]:
    """Every figure that has a value in A or B, in the order of A. Raises ScenarioError if they do not compare."""
    for name in ("quick", "limit"):
        if a.get(name) != b.get(name):
            why = f"differs between the reports ({a.get(name)!r}, {b.get(name)!r}): they do not compare"
            raise ScenarioError([Problem("--compare", name, why)])
    keys = dict.fromkeys([*a["figures"], *b["figures"]])
    changes = (_change(key, a["figures"].get(key), b["figures"].get(key)) for key in keys)
    return [change for change in changes if change is not None]


def _change(key: str, a: dict[str, Any] | None, b: dict[str, Any] | None) -> Change | None:
    old = a["median"] if a else None
    new = b["median"] if b else None
    known = b or a
    assert known is not None
    if old is None and new is None:
        return None
    if a is None or b is None or old is None or new is None:
        verdict = Verdict.ONLY_B if old is None else Verdict.ONLY_A
        return Change(key, known["unit"], old, new, None, verdict, known["met"])
    if not (math.isfinite(old) and math.isfinite(new)):
        return Change(key, b["unit"], old, new, None, _of_what_is_no_number(old, new), b["met"])
    noise = _noise(a, b)
    verdict = Verdict.SAME
    if abs(new - old) > noise:
        lower = new < old
        verdict = Verdict.BETTER if lower == (b["better"] == "lower") else Verdict.WORSE
    return Change(key, b["unit"], old, new, noise, verdict, b["met"])


def _of_what_is_no_number(old: float, new: float) -> Verdict:
    """NaN and infinities never win: a new one is worse than any number, an old one is no reference."""
    if math.isfinite(new):
        return Verdict.ONLY_B
    return Verdict.WORSE if math.isfinite(old) else Verdict.SAME


def _noise(a: dict[str, Any], b: dict[str, Any]) -> float:
    single = a["iqr"] is None or b["iqr"] is None
    floor = (FLOOR_SINGLE if single else FLOOR) * max(abs(a["median"]), abs(b["median"]))
    return float(max(floor, (a["iqr"] or 0.0) + (b["iqr"] or 0.0)))


def regressions(changes: list[Change]) -> list[Change]:
    """Those that got worse."""
    return [change for change in changes if change.verdict is Verdict.WORSE]


def table(changes: list[Change]) -> Table:
    """A row for each figure; `target` is whether B meets it."""
    rows = tuple(
        (c.key, c.a, c.b, _signed(c.percent), c.noise, c.unit, str(c.verdict), verdict_of(c.met)) for c in changes
    )
    return Table("", ("figure", "A", "B", "change", "noise", "unit", "verdict", "target"), rows)


def _signed(percent: float | None) -> str:
    return "" if percent is None else f"{percent:+.1f} %"
