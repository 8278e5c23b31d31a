"""Computation time as the paper means it: a whole step under each controller, and the command alone.

Only an interleaved pass of one worker is compared; each figure is the median of the medians of the insertions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.paper import statistics
from benchmarks.paper.statistics import Interval, bootstrap_median
from benchmarks.paper.table import Row, arm_name

PAPER_REDUCTIONS = {  # share of the I-FEM time that is said to be saved [paper]
    "text": 0.60,
    "abstract": 2.0 / 3.0,  # "to a third"
    "earlier paper": 0.66,
}


@dataclass(frozen=True)
class Spread:
    """Median and quartiles over insertions, ms."""

    median_ms: float
    q1_ms: float
    q3_ms: float


@dataclass(frozen=True)
class StepTimes:
    """What a step costs under one controller. plant: the simulation; jacobian: its linearisation, which I-FEM needs;
    command: the controller; total: their sum; mean_step: wall time of the loop by steps, series included."""

    way: str
    arm: str
    insertions: int
    plant: Spread
    jacobian: Spread
    command: Spread
    total: Spread
    mean_step: Spread


@dataclass(frozen=True)
class Saving:
    """How much of I-FEM's time the ELM saves: 1 - ELM / I-FEM, median over paths and its interval.

    part: "total" (a whole step, plant included), "controller" (Jacobian and command) or "mean_step"."""

    way: str
    part: str
    pairs: int
    saved: float
    saved_interval: Interval


def way_of(row: Row) -> str:
    """A controller, for I-FEM with how it gets its Jacobian."""
    if row.arm != "ifem":
        return arm_name(row.arm)
    jacobian = row.scenario.get("controller", {}).get("jacobian", "constraint")
    return f"{arm_name(row.arm)}, {jacobian}"


def part_ms(row: Row, part: str) -> float:
    """Median ms of a step's part; nan where it was not measured."""
    names = {"total": ("plant", "jacobian", "command"), "controller": ("jacobian", "command")}.get(part, (part,))
    values = [row.timing_ms.get(name) for name in names]
    return math.nan if any(value is None for value in values) else math.fsum(v for v in values if v is not None)


def costs(table: Sequence[Row]) -> list[StepTimes]:
    """One row a way, I-FEM first; insertions that failed have no place in a time."""
    result = []
    ways: dict[str, list[Row]] = {}
    for row in table:
        if row.stable:
            ways.setdefault(way_of(row), []).append(row)
    for way in sorted(ways, key=lambda way: (not way.startswith(arm_name("ifem")), way)):
        mine = ways[way]
        parts = (_spread(mine, part) for part in ("plant", "jacobian", "command", "total", "mean_step"))
        result.append(StepTimes(way, mine[0].arm, len(mine), *parts))
    return result


def _spread(rows: Sequence[Row], part: str) -> Spread:
    values = [value for row in rows if not math.isnan(value := part_ms(row, part))]
    return Spread(*(statistics.quantile(values, share) for share in (0.5, 0.25, 0.75)))


def savings(table: Sequence[Row]) -> list[Saving]:
    """ELM against I-FEM in each of its ways, path by path; repeats of a path count as their median."""
    stable = [row for row in table if row.stable]
    elm = [row for row in stable if row.arm == "elm"]
    ways = sorted({way_of(row) for row in stable if row.arm == "ifem"})
    result = []
    for way in ways:
        for part in ("total", "mean_step", "controller"):
            one = _by_path(elm, part)
            other = _by_path([row for row in stable if way_of(row) == way], part)
            shared = sorted(one.keys() & other.keys())
            if shared:
                saved = 1.0 - np.array([one[key] / other[key] for key in shared])
                result.append(Saving(way, part, len(shared), statistics.middle(saved), bootstrap_median(saved)))
    return result


def _by_path(rows: Sequence[Row], part: str) -> dict[tuple[str, str, str], float]:
    times: dict[tuple[str, str, str], list[float]] = {}
    for row in rows:
        value = part_ms(row, part)
        if value > 0.0:
            times.setdefault(row.pair, []).append(value)
    return {key: statistics.middle(values) for key, values in times.items()}
