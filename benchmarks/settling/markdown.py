"""The experiment as a page of the documentation: verdicts, planned comparisons, cells, in tables of Markdown."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from benchmarks.measurements import Table
from benchmarks.paper.number_text import error_text, p_value, signed_text
from benchmarks.paper.table import BESIDE

if TYPE_CHECKING:
    from collections.abc import Mapping

Json = dict[str, Any]
NOTHING = "–"


def markdown(report: Json, *, drawn: bool) -> str:
    """The page. report: what `report.document` returns, or settling.json read back; drawn: there is a picture."""
    counts, rules = report["counts"], report["rules"]
    cells = {score["cell"]: score for score in report["cells"]}
    lead = (
        f"# Curved paths: what decides\n\n{counts['insertions']} insertions in {len(cells)} cells, of which"
        f" {counts['failed'] or 'none'} failed. The undelayed ELM against each cell of I-FEM on the same plant, at"
        f" equal RCM budget of {rules['budget_mm']:g} mm; p by the sign test over end points, adjusted by Holm over"
        f" {rules['planned_comparisons']}. Differences and cells: medians over end points; errors of two compared: over"
        " their pairs. Reasons and intervals are in settling.html.\n"
    )
    picture = "\n![tip error over RCM error](pareto.svg)\n" if drawn else ""
    tables = (_together(report), _planned(report, cells), _cells(report))
    return lead + picture + "".join(f"\n## {table.title}\n\n{table.markdown()}" for table in tables)


def _together(report: Json) -> Table:
    head = ("family", "verdict", "reproduced", "not reproduced", "undecided")
    keys = ("family", "verdict", "reproduced", "not_reproduced", "undecided")
    return Table("Verdicts together", head, tuple(tuple(one[key] for key in keys) for one in report["verdicts"]))


def _planned(report: Json, cells: Mapping[str, Json]) -> Table:
    head = ("plant", "I-FEM late, ms", "remote centre", "verdict", "pairs", "ELM, mm", "I-FEM, mm", "ELM − I-FEM, mm")
    rows = []
    for one in report["planned"]:
        cell, found = cells[one["second"]], one["budget"]
        compared = (0, *[NOTHING] * 3)
        if found is not None:
            medians = (error_text(found[f"median_{which}_mm"]) for which in ("first", "second"))
            compared = (found["pairs"], *medians, _signed(found["difference_mm"]))
        p = p_value(math.nan if one["p_holm"] is None else one["p_holm"])
        outside = " / ".join(map(str, one["outside"]))
        rows.append((cell["plant"], cell["delay_ms"], cell["rows"], one["claim"]["verdict"], *compared, p, outside))
    return Table("Planned comparisons", (*head, "p, adjusted", "over budget, ELM / I-FEM"), tuple(rows))


def _cells(report: Json) -> Table:
    head = (
        "controller",
        "plant",
        "late, ms",
        "remote centre",
        "failed",
        "over budget",
        "RMSE, mm",
        "beside the path, mm",
    )
    rows = []
    for score in report["cells"]:
        some = bool(score["insertions"])
        errors = (error_text(score[key]["median"]) if some else NOTHING for key in ("rmse_mm", "cross_track_mm"))
        beside = (_measured(score["beside"][metric]["median"], digits) for metric, (_, digits) in BESIDE.items())
        who = ("ELM" if score["arm"] == "elm" else "I-FEM", score["plant"], score["delay_ms"], score["rows"])
        rows.append((*who, score["failed"], score["over_budget"], *errors, *beside))
    return Table("Cells", (*head, *(name for name, _ in BESIDE.values())), tuple(rows))


def _measured(value: float | None, digits: int) -> str:
    return NOTHING if value is None else f"{value:.{digits}f}"


def _signed(value: float | None) -> str:
    return NOTHING if value is None else signed_text(value)
