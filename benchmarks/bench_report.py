"""The versioned JSON of a bench run: where, when and on what, the figures by key, the tables."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from benchmarks.performance.reference_kernels import UNIT
from simcore.errors import Problem, ScenarioError
from simcore.provenance import machine

if TYPE_CHECKING:
    from pathlib import Path

    from benchmarks.measurements import Part

SCHEMA = "needlebench/bench/1"
FIGURE_FIELDS = ("median", "iqr", "runs", "unit", "better", "target", "met", "note")
BUSY_LOAD = 0.5  # load average above which other work is running


def document(
    parts: dict[str, Part],
    *,
    date: str,
    quick: bool,
    load_before: float | None,
    load_after: float | None,
) -> dict[str, Any]:
    """What is stored. date: ISO 8601. load: of the machine over a minute, None where it is not counted."""
    origin = machine()
    figures = {figure.key: figure.as_json() for part in parts.values() for figure in part.figures}
    return {
        "schema": SCHEMA,
        "date": date,
        "quick": quick,
        "names": list(parts),
        "limit": UNIT,
        "commit": origin["commit"],
        "versions": origin["versions"],
        "machine": {
            "cpu": origin["cpu"],
            "cpu_count": origin["cpu_count"],
            "platform": origin["platform"],
            "threads": origin["threads"],
            "load_before": load_before,
            "load_after": load_after,
        },
        "figures": figures,
        "tables": {name: [table.as_json() for table in part.tables] for name, part in parts.items() if part.tables},
    }


def busy(load: float | None) -> str | None:
    """A warning if the machine had other work, else None."""
    if load is None or load < BUSY_LOAD:
        return None
    return f"the machine is busy (load average {load:.2f}): do not trust these timings"


def load_report(path: Path) -> dict[str, Any]:
    """A stored report. Raises ScenarioError for anything else."""
    try:
        report = json.loads(path.read_bytes())
    except (OSError, ValueError) as error:
        raise ScenarioError([Problem("--compare", str(path), f"is not readable JSON: {error}")]) from None
    known = isinstance(report, dict) and report.get("schema") == SCHEMA and isinstance(report.get("figures"), dict)
    if not known:
        raise ScenarioError([Problem("--compare", str(path), f"is not a report of schema {SCHEMA}")])
    for key, figure in report["figures"].items():
        missing = [name for name in FIGURE_FIELDS if not isinstance(figure, dict) or name not in figure]
        if missing:
            raise ScenarioError([Problem("--compare", str(path), f"{key} lacks {', '.join(missing)}")])
    return dict(report)
