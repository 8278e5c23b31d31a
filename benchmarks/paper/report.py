"""The report of a rerun: report.json holds every figure and test, report.html shows it, insertions.csv is what they
rest on, headline.svg is the main figure alone."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.cautions import cautions
from benchmarks.paper import statistics
from benchmarks.paper.analysis import (
    CLOSE_MM,
    RATIO_TARGET,
    Contrast,
    box,
    controller_contrasts,
    direction_contrasts,
    scores,
    young_contrasts,
)
from benchmarks.paper.bands import UNKNOWN, Bands
from benchmarks.paper.claims import assumptions, claims
from benchmarks.paper.comparison import as_json, corrected
from benchmarks.paper.evidence import Evidence
from benchmarks.paper.failure_places import face_mm, notable_cases, outcome_word, spots
from benchmarks.paper.figures import conditions, headline
from benchmarks.paper.learning_studies import LearningPoint, learning_steps, seed_scores, seed_shares, variants
from benchmarks.paper.page import html
from benchmarks.paper.retraining import training_scores
from benchmarks.paper.table import BESIDE, TRAINING, Row, arm_name, insertions_csv, main_rows, rows
from benchmarks.paper.timing import PAPER_REDUCTIONS, costs, savings
from simcore.rollout.artefacts import replace_atomically

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from benchmarks.cases import Outcome

SCHEMA = "needlebench/paper/1"
JSON, HTML, CSV, HEADLINE = "report.json", "report.html", "insertions.csv", "headline.svg"
LISTED_FAILURES = 200
LISTED_CAUTIONS = 50
Json = dict[str, Any]


def document(
    outcomes: Sequence[Outcome],
    *,
    timing: Sequence[Outcome] = (),
    learning: Sequence[LearningPoint] = (),
    recordings: Mapping[str, str] | None = None,
    scale: str = "",
    provenance: Mapping[str, Any] | None = None,
    bands: Bands = UNKNOWN,
) -> Json:
    """All figures and tests of any outcomes, as plain JSON; what is not finite (a median of failures) is null.

    timing: the one-worker pass, which alone is used for times. learning: trained ELMs. recordings: case id -> link,
    relative to the report. provenance: shown as it is. bands: of the discretisation, by `needlebench bench
    convergence`; where they are unknown, no claim about precision or failures is decided.
    """
    table = rows(outcomes)
    families = controller_contrasts(table), young_contrasts(table), direction_contrasts(table)
    contrasts, young, directions = (_corrected(family) for family in families)
    scored, timed = scores(table), rows(timing)
    seeds = seed_scores(table)
    shares = seed_shares(seeds, table)
    evidence = Evidence(table, scored, contrasts, young, directions, savings(timed), shares, bands)
    failed = [row for row in table if row.failed]
    content = {
        "schema": SCHEMA,
        "scale": scale,
        "provenance": dict(provenance or {}),
        "rules": rules(),
        "counts": {"insertions": len(table), "failed": len(failed), "timed": len(timed)},
        "claims": claims(evidence),
        "assumptions": assumptions(table),
        "bands": bands.as_json(),
        "scores": scored,
        "contrasts": [_flat(contrast) for contrast in contrasts],
        "directions": [_flat(contrast) for contrast in directions],
        "young": [_flat(contrast) for contrast in young],
        "face_mm": face_mm(main_rows(table)),
        "entry_mm": _entry_mm(main_rows(table)),
        "spots": spots(table),
        "failures": [failure(row) for row in failed[:LISTED_FAILURES]],
        "cautions": cautions((row.id, row.warnings) for row in table)[:LISTED_CAUTIONS],
        "seeds": {"scores": seeds, "shares": shares, "boxes": _seed_boxes(seeds)},
        "training": training_scores([row for row in table if row.group == TRAINING]),
        "learning": learning_steps(learning),
        "sensitivity": variants(table),
        "timing": {"costs": costs(timed), "savings": evidence.savings, "paper": PAPER_REDUCTIONS},
        "recordings": notable_insertions(table, recordings or {}),
    }
    result: Json = as_json(content)
    return result


def rules() -> Json:
    """What the statistics rest on, fixed before any result."""
    return {
        "confidence": statistics.CONFIDENCE,
        "bootstrap_draws": statistics.DRAWS,
        "bootstrap_seed": statistics.SEED,
        "margin_mm": statistics.MARGIN_MM,
        "fewest_clusters": statistics.FEWEST_CLUSTERS,
        "floor_mm": statistics.FLOOR_MM,
        "close_mm": CLOSE_MM,
        "ratio_target": RATIO_TARGET,
    }


def _corrected(family: Sequence[Contrast]) -> list[Contrast]:
    """The contrasts of one table, adjusted together."""
    adjusted = corrected([contrast.comparison for contrast in family])
    return [replace(contrast, comparison=one) for contrast, one in zip(family, adjusted, strict=True)]


def _flat(contrast: Contrast) -> Json:
    outer: Json = as_json(contrast)
    inner = outer.pop("comparison")
    return {**outer, **inner}


def _entry_mm(table: Sequence[Row]) -> tuple[float, float] | None:
    """The entry if all paths share it."""
    entries = {row.entry_mm for row in table}
    entry = entries.pop() if len(entries) == 1 else None
    return entry if entry and not any(math.isnan(value) for value in entry) else None


def failure(row: Row) -> Json:
    """An insertion that failed, and why."""
    return {"id": row.id, "arm": row.arm, "group": row.group, "status": row.status, "message": row.message}


def _seed_boxes(seeds: Sequence[Any]) -> Json:
    groups = dict.fromkeys(score.group for score in seeds)
    return {g: box(np.array([score.median_mm for score in seeds if score.group == g])) for g in groups}


def notable_insertions(table: Sequence[Row], links: Mapping[str, str]) -> list[Json]:
    """Best, median and worst cases and failures, each with its link if it has one, then all others that have one."""
    known = {row.id: row for row in table}
    reasons = dict(notable_cases(table))
    reasons |= {name: outcome_word(known[name]) or "another" for name in sorted(links.keys() & known.keys() - reasons)}
    insertions = []
    for case_id, why in reasons.items():
        row = known[case_id]
        named = {name: getattr(row, name) for name in ("id", "group", "arm", "young", "noise", "status", "digest")}
        error = row.metrics.get("max_commanded_mm")
        insertions.append(
            {
                **named,
                "why": why,
                "rmse_commanded_mm": row.rmse_commanded_mm,
                "max_commanded_mm": error,
                "beside": {metric: row.metrics.get(metric) for metric in BESIDE},
                "link": links.get(case_id),
            }
        )
    return insertions


def write(
    outcomes: Sequence[Outcome],
    *,
    timing: Sequence[Outcome],
    learning: Sequence[LearningPoint],
    recordings: Mapping[str, str],
    scale: str,
    out: Path,
    provenance: Mapping[str, Any],
    bands: Bands = UNKNOWN,
) -> list[Path]:
    """Write the four files into `out`, each complete or as it was; returns their paths. See `document`."""
    report = document(
        outcomes,
        timing=timing,
        learning=learning,
        recordings=recordings,
        scale=scale,
        provenance=provenance,
        bands=bands,
    )
    texts = {
        CSV: insertions_csv(rows([*outcomes, *timing])),
        HEADLINE: headline(report),
        HTML: html(report),
        JSON: json.dumps(report, indent=1, allow_nan=False, ensure_ascii=False) + "\n",
    }
    out.mkdir(parents=True, exist_ok=True)
    written = []
    for name, content in texts.items():
        if content is not None:
            _put(out / name, content.encode())
            written.append(out / name)
    return written


def _put(path: Path, content: bytes) -> None:
    replace_atomically(path, lambda file: file.write(content))


def main_table_markdown(report: Json) -> str:
    """The main table as Markdown: the primary condition, a row for each group and controller. floor: there
    controllers without feedback are as good, and precision says nothing."""
    primary = next(iter(conditions(report)), None)
    head = "| paths | controller | insertions | S | median RMSE mm (quartiles) | largest RMSE mm | max error <= 1 mm "
    headings = "".join(f" {heading} |" for heading, _ in BESIDE.values())
    rule = f"| --- | --- |{' ---: |' * (6 + len(BESIDE))}"
    lines = [f"{head}| ratio to open loop |{headings}", rule]
    floors = {(c["group"], c["young"], c["noise"]) for c in report["contrasts"] if c["floor"]}
    before = ""
    for score in report["scores"]:
        if (score["young"], score["noise"]) != primary:
            continue
        marked = " (floor)" if (score["group"], score["young"], score["noise"]) in floors else ""
        group = f"{score['group']}{marked}" if score["group"] != before else ""
        before = score["group"]
        spread = f"{_number(score['median_mm'])} ({_number(score['q1_mm'])} to {_number(score['q3_mm'])})"
        cells = (
            group,
            arm_name(score["arm"]),
            str(score["insertions"]),
            f"{100 * score['stable']:.4g} %",
            spread,
            _number(score["max_mm"]),
            f"{100 * score['within_1mm']:.4g} %",
            _number(score["ratio"]) if score["ratio_pairs"] else "-",
            *(_number(score["beside"][metric], "-", digits) for metric, (_, digits) in BESIDE.items()),
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _number(value: float | None, absent: str = "failed", digits: int = 3) -> str:
    return absent if value is None else f"{value:.{digits}f}"
