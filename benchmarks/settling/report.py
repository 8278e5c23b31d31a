"""settling.json holds every figure and test, settling.html shows it, settling.md has the main tables, cases.csv is what
they rest on, pareto.svg is the picture alone."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from benchmarks.paper.bands import bands_of
from benchmarks.paper.claims import assumptions
from benchmarks.paper.comparison import as_json
from benchmarks.paper.direction_claims import SIGNIFICANT
from benchmarks.paper.page import VERDICTS, render
from benchmarks.paper.report import LISTED_FAILURES, failure, rules
from benchmarks.paper.table import TRAINING, Row, insertions_csv, rows
from benchmarks.settling.analysis import CLAIM, Planned, families, planned_comparisons
from benchmarks.settling.cells import cells
from benchmarks.settling.figure import pareto
from benchmarks.settling.markdown import markdown
from benchmarks.settling.plan import CELL
from benchmarks.settling.scale import END_POINTS, EXPLORED
from benchmarks.settling.scores import BUDGET_MM, OUTCOME, score
from simcore.rollout.artefacts import replace_atomically

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from benchmarks.cases import Outcome
    from benchmarks.settling.scale import SettlingScale

SCHEMA = "needlebench/settling/1"
JSON, HTML, MARKDOWN, CSV, PARETO = "settling.json", "settling.html", "settling.md", "cases.csv", "pareto.svg"
Json = dict[str, Any]


def document(outcomes: Sequence[Outcome], scale: SettlingScale, provenance: Mapping[str, Any] | None = None) -> Json:
    """All figures and tests as plain JSON; what is not finite (a median of failures) is null.

    outcomes: of any part of the plan; a cell without any has no medians, a comparison without a pair is undecided.
    """
    table = rows(outcomes)
    tests = [row for row in table if row.group != TRAINING]
    planned = planned_comparisons(tests, scale)
    failed = [row for row in table if row.failed]
    content = {
        "schema": SCHEMA,
        "scale": scale.name,
        "provenance": dict(provenance or {}),
        "claim": CLAIM,
        "rules": {
            **rules(),
            "outcome": OUTCOME,
            "budget_mm": BUDGET_MM,
            "significant": SIGNIFICANT,
            "planned_comparisons": len(planned),
            "end_points": END_POINTS[: scale.end_points],
            "explored_end_points": EXPLORED,
        },
        "counts": {"insertions": len(tests), "training": len(table) - len(tests), "failed": len(failed)},
        "assumptions": assumptions(table),
        "bands": bands_of(scale).as_json(),
        "verdicts": families(planned),
        "planned": [_flat(one) for one in planned],
        "cells": [score(cell, _rows_of(tests, cell.name)) for cell in cells(scale)],
        "failures": [failure(row) for row in failed[:LISTED_FAILURES]],
    }
    result: Json = as_json(content)
    return result


def _rows_of(table: Sequence[Row], cell: str) -> list[Row]:
    return [row for row in table if row.labels.get(CELL) == cell]


def _flat(planned: Planned) -> Json:
    """With the names of the cells in their place."""
    return {**as_json(planned), "first": planned.first.name, "second": planned.second.name}


def html(report: Json) -> str:
    """The page. report: what `document` returns, or settling.json read back."""
    counts = {name: sum(one["claim"]["verdict"] == name for one in report["planned"]) for name in VERDICTS}
    return render("settling.html.j2", report=report, counts=counts, symbols=VERDICTS, picture=pareto(report))


def write(outcomes: Sequence[Outcome], scale: SettlingScale, out: Path, provenance: Mapping[str, Any]) -> Path:
    """Write the five files into `out`, each complete or as it was; the path of the page."""
    report = document(outcomes, scale, provenance)
    picture = pareto(report)
    texts = {
        CSV: insertions_csv(rows(outcomes)),
        PARETO: picture,
        HTML: html(report),
        MARKDOWN: markdown(report, drawn=picture is not None),
        JSON: json.dumps(report, indent=1, allow_nan=False, ensure_ascii=False) + "\n",
    }
    for name, text in texts.items():
        if text is not None:
            _put(out / name, text.encode())
    return out / HTML


def _put(path: Path, content: bytes) -> None:
    replace_atomically(path, lambda file: file.write(content))
