"""What a benchmark returns: figures with their spread and target, tables, and files to write."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

Better = Literal["lower", "higher"]


@dataclass(frozen=True)
class Target:
    """A bound that a figure's median has to keep."""

    bound: float
    sense: Literal["at_most", "at_least"] = "at_most"

    def met_by(self, value: float) -> bool:
        """Whether the bound is kept."""
        return value <= self.bound if self.sense == "at_most" else value >= self.bound

    def __str__(self) -> str:
        return f"{'<=' if self.sense == 'at_most' else '>='} {self.bound:.4g}"


TARGETS: dict[str, Target] = {
    "step.line.plant_in_limits": Target(0.9),
    "step.sine.plant_in_limits": Target(1.0),
    "step.line.in_limits": Target(1.1),
    "step.sine.in_limits": Target(1.2),
    "step.sine.exact_in_limits": Target(15.0),
    "jacobian.perturbation.in_limits": Target(12.0),
    "realtime.line": Target(4.0, "at_least"),
    "realtime.sine": Target(4.0, "at_least"),
    "step.sine.p99_over_median": Target(5.0),
    "scaling.depth.ratio": Target(1.5),
    "recording.ratio": Target(1.05),
    "recording.realtime": Target(3.8, "at_least"),
    "throughput.two_over_one": Target(1.9, "at_least"),
    "start.warm_s": Target(1.0),
    "start.cold_s": Target(15.0),
    "memory.1617_mb": Target(400.0),
    "memory.4743_mb": Target(700.0),
}
EXPONENT_MARGIN = 0.1  # scaling.nodes.exponent may exceed scaling.limit.exponent by so much


@dataclass(frozen=True)
class Figure:
    """One measured number: a value for each independent run, or none and a note that says why."""

    key: str
    unit: str
    values: tuple[float, ...]
    better: Better = "lower"
    target: Target | None = None
    note: str = ""

    @property
    def median(self) -> float | None:
        """Middle of the runs."""
        return float(np.median(self.values)) if self.values else None

    @property
    def iqr(self) -> float | None:
        """Distance of the quartiles; None for a single run, which has no spread."""
        if len(self.values) < 2:
            return None
        low, high = np.percentile(self.values, [25, 75])
        return float(high - low)

    @property
    def met(self) -> bool | None:
        """Whether the target is kept; None without target or value."""
        median = self.median
        return None if self.target is None or median is None else self.target.met_by(median)

    def as_json(self) -> dict[str, Any]:
        """The figure as a report stores it."""
        target = None if self.target is None else {self.target.sense: self.target.bound}
        return {
            "median": self.median,
            "iqr": self.iqr,
            "runs": len(self.values),
            "unit": self.unit,
            "better": self.better,
            "target": target,
            "met": self.met,
            "note": self.note,
        }


def figure(
    key: str,
    unit: str,
    values: Sequence[float],
    *,
    better: Better = "lower",
    target: Target | None = None,
    note: str = "",
) -> Figure:
    """A figure; its target is that of its key unless another is given."""
    return Figure(key, unit, tuple(float(v) for v in values), better, target or TARGETS.get(key), note)


def missing_figure(key: str, unit: str, why: str) -> Figure:
    """A figure that could not be measured, and why."""
    return figure(key, unit, (), note=why)


@dataclass(frozen=True)
class Table:
    """Rows of text and numbers, for a terminal, Markdown and CSV alike."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]

    def as_json(self) -> dict[str, Any]:
        """The table as a report stores it."""
        return {"title": self.title, "columns": list(self.columns), "rows": [list(row) for row in self.rows]}

    def markdown(self) -> str:
        """A GitHub table, numbers to the right."""
        numeric = [all(isinstance(row[i], int | float | None) for row in self.rows) for i in range(len(self.columns))]
        lines = [
            f"| {' | '.join(self.columns)} |",
            f"|{'|'.join(' ---: ' if right else ' --- ' for right in numeric)}|",
            *(f"| {' | '.join(cell_text(value) for value in row)} |" for row in self.rows),
        ]
        return "\n".join(lines) + "\n"


@dataclass(frozen=True)
class Part:
    """All that one benchmark produced. files: name -> text, written where the caller wants them."""

    figures: tuple[Figure, ...] = ()
    tables: tuple[Table, ...] = ()
    files: dict[str, str] = field(default_factory=dict)


def cell_text(value: Any) -> str:
    """A value for readers: four significant digits, a dash where there is none."""
    if value is None or (isinstance(value, float) and not np.isfinite(value)):
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def verdict_of(met: bool | None) -> str:
    """A target in a word; empty where there is none."""
    return {None: "", True: "met", False: "missed"}[met]


def figure_table(parts: dict[str, Part]) -> Table:
    """All figures of a run with their spread and target."""
    rows = tuple(
        (f.key, f.median, f.iqr, len(f.values), f.unit, str(f.target or ""), verdict_of(f.met), f.note)
        for part in parts.values()
        for f in part.figures
    )
    return Table("", ("figure", "median", "IQR", "runs", "unit", "target", "", "note"), rows)
