"""The report of a parameter grid: every point, what each field does, and the controllers against each other."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from benchmarks.cases import Label, Outcome
from benchmarks.grid.suite import label
from benchmarks.paper import statistics
from benchmarks.paper.analysis import score, scores
from benchmarks.paper.comparison import as_json, compare
from benchmarks.paper.failure_places import notable_cases
from benchmarks.paper.report import failure, notable_insertions, rules
from benchmarks.paper.table import Row, arms, beside, only, rows
from benchmarks.paper.timing import costs, part_ms

SCHEMA = "needlebench/grid/1"
REPEATS = "seed"  # a field that repeats a point and makes no other one
CONTROLLER = "controller.kind"
ALL_COUPLES = 5  # values up to which each is compared with each; above, with the first
LISTED_POINTS = 500
LISTED_FAILURES = 200
Json = dict[str, Any]
Axes = Mapping[str, Sequence[Label]]


def document(
    outcomes: Sequence[Outcome],
    axes: Mapping[str, Sequence[Any]],
    *,
    name: str,
    links: Mapping[str, str] | None = None,
    provenance: Mapping[str, Any] | None = None,
) -> Json:
    """All figures and tests of a grid's insertions, as plain JSON; what is not finite (a median of failures) is null.

    axes: dotted path of a field -> its values, as `grid` takes them. links: case id -> address of its insertion.
    """
    known: Axes = {path: [label(value) for value in values] for path, values in axes.items()}
    table = rows(outcomes)
    failed = [row for row in table if row.failed]
    points = _points(table, known)
    telling = {case_id for case_id, _ in notable_cases(table)}
    content = {
        "schema": SCHEMA,
        "name": name,
        "provenance": dict(provenance or {}),
        "rules": rules(),
        "counts": {"insertions": len(table), "failed": len(failed), "points": len(points)},
        "fields": [{"path": path, "values": values, "repeats": path == REPEATS} for path, values in known.items()],
        "points": points[:LISTED_POINTS],
        "scores": scores(table),
        "effects": [effect for path in known if (effect := _effect(table, path, known))],
        "failures": [{**failure(row), "link": (links or {}).get(row.id)} for row in failed[:LISTED_FAILURES]],
        "timing": {"costs": costs(table)},
        "chosen": notable_insertions(table, {one: where for one, where in (links or {}).items() if one in telling}),
    }
    result: Json = as_json(content)
    return result


def _points(table: Sequence[Row], axes: Axes) -> list[Json]:
    """The points that have an insertion, in the order of the grid; repeats of a point count as one."""
    paths = [path for path in axes if path != REPEATS]
    members: dict[tuple[Label, ...], list[Row]] = {}
    for row in table:
        members.setdefault(tuple(row.labels.get(path, "") for path in paths), []).append(row)
    ordered = itertools.product(*(axes[path] for path in paths))
    return [_point(dict(zip(paths, place, strict=True)), members[place]) for place in ordered if place in members]


def _point(place: Mapping[str, Label], mine: Sequence[Row]) -> Json:
    steps = [step for row in mine if math.isfinite(step := part_ms(row, "total"))]
    return {
        "place": dict(place),
        "insertions": len(mine),
        "failed": sum(row.failed for row in mine),
        "success": sum(row.success for row in mine) / len(mine),
        "median_mm": statistics.middle([row.rmse_commanded_mm for row in mine]),
        "worst_error_mm": max(row.ranked("max_commanded_mm") for row in mine),
        "beside": beside(mine),
        "yielded": sum(bool(row.yielded) for row in mine),
        "step_ms": statistics.middle(steps) if steps else math.nan,
    }


def _effect(table: Sequence[Row], path: str, axes: Axes) -> Json | None:
    """What a field does: scores at each of its values, and the values compared at points that are else the same."""
    moved = [_at_place(row, path, axes) for row in table if path in row.labels]
    present = [value for value in map(str, axes[path]) if any(row.group == value for row in moved)]
    if path == REPEATS or len(present) < 2:
        return None
    scores_by_value = []
    for value in present:
        members = only(moved, group=value)
        open_loop = [] if path == CONTROLLER else only(members, arm="open_loop")
        scores_by_value += [score(only(members, arm=arm), open_loop, group=value) for arm in arms(members)]
    return {
        "field": path,
        "values": present,
        "numeric": all(isinstance(value, int | float) for value in axes[path]),
        "scores": scores_by_value,
        "contrasts": [c for first, second in _couples(present) for c in _contrasts(moved, first, second, path)],
    }


def _at_place(row: Row, path: str, axes: Axes) -> Row:
    """The row in the group of its value, to be paired with that of another value at the same place."""
    rest = {other: row.labels.get(other) for other in axes if other not in (path, REPEATS)}
    seed = str(row.labels.get(REPEATS, ""))
    return replace(row, group=str(row.labels[path]), end_point=json.dumps(rest), direction=seed)


def _couples(values: Sequence[str]) -> list[tuple[str, str]]:
    if len(values) <= ALL_COUPLES:
        return list(itertools.combinations(values, 2))
    return [(values[0], value) for value in values[1:]]


def _contrasts(moved: Sequence[Row], first: str, second: str, path: str) -> list[Json]:
    """Two values of a field for each controller; two controllers over everything."""
    members = [[replace(row, group="") for row in only(moved, group=value)] for value in (first, second)]
    names = [""] if path == CONTROLLER else [arm for arm in arms(members[0]) if arm in arms(members[1])]
    comparisons = []
    for arm in names:
        one, other = (only(rows, arm=arm) if arm else rows for rows in members)
        if compared := compare(one, other, group=arm, names=(first, second)):
            comparisons.append(as_json(compared))
    return comparisons
