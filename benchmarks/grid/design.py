"""The unit of analysis: which pairs of cases count as one observation, chosen from the cases and said in words."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from benchmarks.paper.comparison import FEWEST, Design
from benchmarks.paper.table import OF_ARMS

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Sequence

    from benchmarks.paper.table import Row

SEED = "seed"


def between_arms(first: Sequence[Row], second: Sequence[Row]) -> Design:
    """Pairs are cases that differ in the arm alone. An observation is an end point where there are enough of them,
    else a case."""
    return _design(first, second, lambda row: row.place, by_end_point=True)


def between_values(first: Sequence[Row], second: Sequence[Row], field: str) -> Design:
    """Pairs are cases that differ in a field of the scenario alone; it may be one of the controller's."""

    def key(row: Row) -> str:
        labels = {name: value for name, value in row.labels.items() if name not in OF_ARMS}
        return _without(json.dumps(labels, sort_keys=True), field)

    return _design(first, second, key, by_end_point=not field.startswith("trajectory"))


def _design(first: Sequence[Row], second: Sequence[Row], key: Callable[[Row], str], *, by_end_point: bool) -> Design:
    partners = {key(row): row for row in second}
    shared = [row for row in first if key(row) in partners]
    ends = {row.end_point for row in shared}
    if by_end_point and len(ends) >= FEWEST:
        return Design("end point", key, _end_point, _end_notes(len(shared), len(ends)))
    notes: list[str] = []
    if by_end_point and 1 < len(ends) < len(shared):
        notes.append(
            f"cases are the unit: {len(ends)} end points are too few to be one, so those of one are taken as "
            "independent"
        )
    cases = {_without(key(row), SEED) for row in shared}
    if len(cases) >= FEWEST or len(cases) == len(shared):
        if len(cases) < len(shared):
            notes.append(
                f"{len(shared)} pairs are {len(cases)} cases: those that differ in their seed alone count once"
            )
        return Design("case", key, lambda row: _without(key(row), SEED), tuple(notes))
    same = {key(row): (_without(key(row), SEED), row.digest, partners[key(row)].digest) for row in shared}
    different = len(set(same.values()))
    if different < len(same) and all(row.digest for row in shared):
        notes.append(f"{len(same)} pairs are {different} cases: seeds that gave the same result to the bit count once")

    def repeated(row: Row) -> Hashable:
        return same[key(row)] if row.digest else key(row)

    return Design("case", key, lambda row: repeated(row) if key(row) in same else None, tuple(notes))


def _end_point(row: Row) -> str:
    return row.end_point


def _end_notes(pairs: int, ends: int) -> tuple[str, ...]:
    return () if pairs == ends else (f"{pairs} pairs are {ends} end points: cases with the same one count once",)


def _without(place: str, name: str) -> str:
    """A place that leaves out one label; the end point goes with the path that it belongs to."""
    labels = json.loads(place)
    labels.pop(name, None)
    if name.startswith("trajectory"):
        labels.pop("end_point", None)
        labels.pop("group", None)
    return json.dumps(labels, sort_keys=True)


def case_of(row: Row) -> str:
    """A case apart from its arm and its seed."""
    return _without(row.place, SEED)


def unit_text(unit: str, count: int) -> str:
    """As in "20 end points"."""
    return f"{count} {unit}{'' if count == 1 else 's'}"
