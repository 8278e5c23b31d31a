"""Where insertions fail, over the end points of their paths, and which of them are worth a recording."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from benchmarks.paper import statistics
from benchmarks.paper.analysis import conditions, under
from benchmarks.paper.table import Row, arms, groups, main_rows, only

if TYPE_CHECKING:
    from collections.abc import Sequence


@dataclass(frozen=True)
class Spot:
    """All insertions of a controller to one end point under one condition. border_mm: to the nearest side face."""

    arm: str
    young: str
    noise: str
    end_point: str
    x_mm: float
    y_mm: float
    border_mm: float
    insertions: int
    failed: int
    unsuccessful: int
    median_mm: float
    worst_mm: float


def spots(table: Sequence[Row]) -> list[Spot]:
    """The error and failure map over the end points."""
    members: dict[tuple[str, str, str, str], list[Row]] = {}
    for row in main_rows(table):
        members.setdefault((row.arm, row.young, row.noise, row.end_point), []).append(row)
    result = []
    for (arm, young, noise, end_point), mine in members.items():
        x, y = mine[0].end_mm
        worst = [row.ranked("max_commanded_mm") for row in mine]
        result.append(
            Spot(
                *(arm, young, noise, end_point, x, y, border_mm(mine[0]), len(mine)),
                failed=sum(row.failed for row in mine),
                unsuccessful=sum(not row.success for row in mine),
                median_mm=statistics.middle([row.rmse_commanded_mm for row in mine]),
                worst_mm=max(worst),
            )
        )
    return sorted(result, key=lambda spot: (spot.arm, spot.young, spot.noise, spot.end_point))


def face_mm(table: Sequence[Row]) -> tuple[float, float] | None:
    """Width and height of the block's far face; None if the tissue is not a block or there are several."""
    sizes = set()
    for row in table:
        tissue = row.scenario.get("tissue", {})
        if tissue.get("mesh_file") or not tissue.get("size_mm"):
            return None
        sizes.add((float(tissue["size_mm"][0]), float(tissue["size_mm"][1])))
    return sizes.pop() if len(sizes) == 1 else None


def border_mm(row: Row) -> float:
    """From the end point to the nearest side face; nan where the tissue is not a block."""
    face = face_mm([row])
    if face is None:
        return math.nan
    x, y = row.end_mm
    return min(x, face[0] - x, y, face[1] - y)


def notable_cases(table: Sequence[Row], *, failed: int = 5) -> list[tuple[str, str]]:
    """(id, why) of the cases worth a recording: best, median and worst stable insertion of each controller in each
    group under each condition, and the first that failed or lost their target; no id twice."""
    reasons: dict[str, str] = {}
    main = main_rows(table)
    for condition in conditions(main):
        for group in groups(under(main, condition)):
            members = only(under(main, condition), group=group)
            for arm in arms(members):
                ranked = sorted(only(members, arm=arm), key=lambda row: (row.rmse_commanded_mm, row.id))
                good = [row for row in ranked if row.stable]
                picks = [("best", 0), ("median", len(good) // 2), ("worst", len(good) - 1)] if good else []
                for why, place in picks:
                    reasons.setdefault(good[place].id, why)
                for row in [row for row in ranked if not row.success][:failed]:
                    reasons.setdefault(row.id, outcome_word(row))
    return list(reasons.items())


def outcome_word(row: Row) -> str:
    """In a word: the run ended early, or the tip was off the target for too long; empty for a success."""
    return "failed" if row.failed else "" if row.success else "lost"
