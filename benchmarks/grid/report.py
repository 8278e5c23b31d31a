"""The report of a parameter grid: the arms against each other, every point, and what each field does."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from benchmarks.cases import Label, Outcome
from benchmarks.cautions import cautions
from benchmarks.grid.design import SEED, between_arms, between_values, case_of
from benchmarks.grid.names import label, value_names
from benchmarks.grid.profiles import profiles
from benchmarks.paper import statistics
from benchmarks.paper.analysis import at_floor, score, scores
from benchmarks.paper.comparison import Comparison, as_json, compare, corrected
from benchmarks.paper.failure_places import notable_cases
from benchmarks.paper.report import failure, notable_insertions, rules
from benchmarks.paper.table import Row, arms, beside, by_group, only, rows
from benchmarks.paper.timing import costs, part_ms
from simcore.arms import makes_arm

SCHEMA = "needlebench/grid/2"
WHOLE = ("controller", "controller.kind", "controller.name", "controller.settings")  # axes whose effect is the arms'
ALL_COUPLES = 5  # values up to which each is compared with each; above, with the first
LISTED_POINTS = 500
LISTED_FAILURES = 200
LISTED_CAUTIONS = 50
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
        "fields": [_field(path, values) for path, values in axes.items()],
        "arms": what_ran(table),
        "points": points[:LISTED_POINTS],
        "scores": scores([_by_case(row) for row in table]),
        "comparisons": arm_comparisons(table),
        "profiles": profiles(table),
        "effects": [effect for path in known if (effect := _effect(table, path, known))],
        "cautions": cautions((row.id, row.warnings) for row in table)[:LISTED_CAUTIONS],
        "failures": [{**failure(row), "link": (links or {}).get(row.id)} for row in failed[:LISTED_FAILURES]],
        "timing": {"costs": costs(table)},
        "chosen": notable_insertions(table, {one: where for one, where in (links or {}).items() if one in telling}),
    }
    result: Json = as_json(content)
    return result


def _field(path: str, values: Sequence[Any]) -> Json:
    """An axis. names: its values as people read them."""
    texts = value_names(path, values) if any(isinstance(value, list | dict) for value in values) else map(str, values)
    return {
        "path": path,
        "values": [label(value) for value in values],
        "names": list(texts),
        "repeats": path == SEED,
        "of_arm": makes_arm(path),
    }


def what_ran(table: Sequence[Row]) -> list[Json]:
    """Each arm by its name, with its settings, code and files as its first result says them."""
    found = []
    for arm in arms(table):
        known = next((row.steered_by for row in only(table, arm=arm) if row.steered_by is not None), None)
        found.append({"name": arm, **({} if known is None else known.data())})
    return found


def arm_comparisons(table: Sequence[Row]) -> list[Comparison]:
    """Arms against each other in each group of paths and in all together, adjusted for all tests of their group."""
    found = []
    for group, members in by_group(table).items():
        tests = [compare_arms(members, *names, group=group) for names in _couples(arms(members))]
        found += corrected([test for test in tests if test is not None])
    return found


def compare_arms(members: Sequence[Row], first: str, second: str, *, group: str) -> Comparison | None:
    """Two arms of a table by its cases that differ in the arm alone; None without such a pair."""
    one, other = only(members, arm=first), only(members, arm=second)
    design = between_arms(one, other)
    return compare(one, other, group=group, names=(first, second), floor=at_floor(members), design=design)


def _by_case(row: Row) -> Row:
    """The row with its case in place of its end point: intervals are then over cases."""
    return replace(row, end_point=case_of(row), direction=str(row.labels.get(SEED, "")))


def _points(table: Sequence[Row], axes: Axes) -> list[Json]:
    """The points that have an insertion, arm by arm in the order of the grid; repeats of a point count as one."""
    paths = [path for path in axes if path != SEED and not makes_arm(path)]
    members: dict[tuple[Label, ...], list[Row]] = {}
    for row in table:
        members.setdefault((row.arm, *(row.labels.get(path, "") for path in paths)), []).append(row)
    ordered = itertools.product(arms(table), *(axes[path] for path in paths))
    return [_point(dict(zip(("arm", *paths), at, strict=True)), members[at]) for at in ordered if at in members]


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
    """What a field does: scores at each of its values, and the values compared at cases that are else the same."""
    mine = [replace(row, arm=_arm_beside(row, path)) for row in table if path in row.labels]
    values = {str(value): [row for row in mine if str(row.labels[path]) == str(value)] for value in axes[path]}
    present = [value for value, members in values.items() if members]
    if path == SEED or path in WHOLE or len(present) < 2:
        return None
    scored = []
    for value in present:
        members = [_by_case(row) for row in values[value]]
        open_loop = only(members, arm="open_loop")
        scored += [score(only(members, arm=arm), open_loop, group=value) for arm in arms(members)]
    couples = _couples(present)
    tests = [test for names in couples for test in _contrasts(values[names[0]], values[names[1]], names, path)]
    tests = tests if any(test.clusters > 1 for test in tests) else []  # a path against a path tests nothing
    return {
        "field": path,
        "values": present,
        "numeric": all(isinstance(value, int | float) for value in axes[path]),
        "scores": scored,
        "contrasts": corrected(tests),
    }


def _arm_beside(row: Row, path: str) -> str:
    """The arm without the field that is looked at, so that its values have the same one."""
    if not makes_arm(path):
        return row.arm
    return str(row.labels.get("controller.kind") or (row.steered_by.controller if row.steered_by else row.arm))


def _couples(values: Sequence[str]) -> list[tuple[str, str]]:
    if len(values) <= ALL_COUPLES:
        return list(itertools.combinations(values, 2))
    return [(values[0], value) for value in values[1:]]


def _contrasts(first: Sequence[Row], second: Sequence[Row], names: tuple[str, str], path: str) -> list[Comparison]:
    """Two values of a field for each arm."""
    tests = []
    for arm in arms(first):
        one, other = only(first, arm=arm), only(second, arm=arm)
        test = compare(one, other, group=arm, names=names, design=between_values(one, other, path))
        tests += [] if test is None else [test]
    return tests
