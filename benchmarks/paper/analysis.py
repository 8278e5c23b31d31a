"""What the insertions say: precision and stability of each controller, comparisons, failures, seeds, sensitivity."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.paper import statistics
from benchmarks.paper.comparison import Comparison, compare, pair_rows
from benchmarks.paper.statistics import FLOOR_MM, Interval, bootstrap_median, wilson
from benchmarks.paper.table import REFERENCES, Row, arms, beside, by_group, main_rows, only

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

CLOSE_MM = 1.0  # an insertion whose error never exceeds it
RATIO_TARGET = 0.4  # of the open-loop RMSE on curved paths [ours]
STEERED: tuple[str, str] = ("ifem", "elm")
WHISKER = 1.5  # interquartile ranges, after Tukey


@dataclass(frozen=True)
class Box:
    """A box plot: quartiles of all errors, failures ranking worst; whiskers to the last finite errors within 1.5
    interquartile ranges, the other finite ones beyond. Infinite from where on failures begin."""

    q1: float
    median: float
    q3: float
    low: float
    high: float
    beyond: tuple[float, ...]


@dataclass(frozen=True)
class Score:
    """One controller in one group under one condition. Medians and quartiles are over all insertions, failures ranking
    worst; mean and maximum are over the stable ones. within_1mm: share whose error never exceeded 1 mm.
    ratio: median over paths of RMSE / open-loop RMSE. limited: mean share of steps that the robot's limits changed.
    yielded: share of the insertions whose needle would have stayed bent. beside: medians of `table.BESIDE`, stable ones
    alone."""

    group: str
    arm: str
    young: str
    noise: str
    insertions: int
    end_points: int
    failed: int
    stable: float
    stable_interval: Interval
    success: float
    success_interval: Interval
    median_mm: float
    median_interval_mm: Interval
    q1_mm: float
    q3_mm: float
    mean_mm: float
    max_mm: float
    worst_error_mm: float
    submillimetric: float
    within_1mm: float
    within_1mm_interval: Interval
    ratio: float
    ratio_interval: Interval
    ratio_pairs: int
    ratio_met: bool | None
    limited: float
    yielded: float
    beside: Mapping[str, float]
    box: Box | None


@dataclass(frozen=True)
class Condition:
    """What is held while controllers are compared; the first is the primary one."""

    young: str
    noise: str


PRIMARY = Condition("constant", "off")


def conditions(table: Sequence[Row]) -> list[Condition]:
    """Conditions that occur, the primary one first."""
    present = {Condition(row.young, row.noise) for row in table}
    return sorted(present, key=lambda c: (c.young != PRIMARY.young, c.noise != PRIMARY.noise, c.young, c.noise))


def under(table: Sequence[Row], condition: Condition) -> list[Row]:
    """The rows under one condition."""
    return only(table, young=condition.young, noise=condition.noise)


# ---- scores


def scores(table: Sequence[Row]) -> list[Score]:
    """Condition by condition, group by group, controller by controller. Of several groups together (`ALL`) only the
    controllers that ran in all of them have a score."""
    result = []
    main = main_rows(table)
    for condition in conditions(main):
        for group, members in by_group(under(main, condition)).items():
            wanted = {row.group for row in members}
            for arm in arms(members):
                mine = only(members, arm=arm)
                if {row.group for row in mine} == wanted:
                    result.append(score(mine, only(members, arm="open_loop"), group=group))
    return result


def score(mine: Sequence[Row], open_loop: Sequence[Row], *, group: str) -> Score:
    """Of one controller's rows, of which there is at least one."""
    errors = np.array([row.rmse_commanded_mm for row in mine])
    worst = np.array([row.ranked("max_commanded_mm") for row in mine])
    clusters = [row.end_point for row in mine]
    count, stable, success = len(mine), sum(row.stable for row in mine), sum(row.success for row in mine)
    close = int((worst <= CLOSE_MM).sum())
    matched = pair_rows(mine, open_loop)
    ratio = statistics.ratios(matched.first, matched.second)
    aimed = group == "CUR" and mine[0].arm in STEERED and len(ratio) > 0
    limited = [
        float(row.metrics["limited_fraction"]) for row in mine if row.metrics.get("limited_fraction") is not None
    ]
    stresses = [row.yielded for row in mine if row.yielded is not None]
    return Score(
        group=group,
        arm=mine[0].arm,
        young=mine[0].young,
        noise=mine[0].noise,
        insertions=count,
        end_points=len(set(clusters)),
        failed=count - stable,
        stable=stable / count,
        stable_interval=wilson(stable, count),
        success=success / count,
        success_interval=wilson(success, count),
        median_mm=statistics.middle(errors),
        median_interval_mm=bootstrap_median(errors, clusters),
        q1_mm=statistics.quantile(errors, 0.25),
        q3_mm=statistics.quantile(errors, 0.75),
        mean_mm=_mean(errors),
        max_mm=_largest(errors),
        worst_error_mm=_largest(worst),
        submillimetric=float((errors < CLOSE_MM).mean()),
        within_1mm=close / count,
        within_1mm_interval=wilson(close, count),
        ratio=statistics.middle(ratio),
        ratio_interval=bootstrap_median(ratio, matched.clusters),
        ratio_pairs=len(ratio),
        ratio_met=statistics.middle(ratio) <= RATIO_TARGET if aimed else None,
        limited=float(np.mean(limited)) if limited else math.nan,
        yielded=float(np.mean(stresses)) if stresses else math.nan,
        beside=beside(mine),
        box=box(errors),
    )


def _mean(errors: statistics.Vector) -> float:
    finite = errors[np.isfinite(errors)]
    return float(finite.mean()) if len(finite) else math.nan


def _largest(errors: statistics.Vector) -> float:
    finite = errors[np.isfinite(errors)]
    return float(finite.max()) if len(finite) else math.nan


def box(errors: statistics.Vector) -> Box | None:
    """Of all errors, infinite ones worst; None without a finite one."""
    kept = np.sort(errors[np.isfinite(errors)])
    if not len(kept):
        return None
    q1, median, q3 = (statistics.quantile(errors, share) for share in (0.25, 0.5, 0.75))
    if math.isinf(q3):
        return Box(q1, median, q3, min(q1, float(kept[0])), math.inf, ())
    reach = WHISKER * (q3 - q1)
    inner = kept[(kept >= q1 - reach) & (kept <= q3 + reach)]
    beyond = kept[(kept < q1 - reach) | (kept > q3 + reach)]
    low, high = min(q1, float(inner.min())), max(q3, float(inner.max()))  # a quartile may lie between two errors
    return Box(q1, median, q3, low, high, tuple(float(v) for v in beyond))


def at_floor(members: Sequence[Row]) -> bool | None:
    """Whether every controller without feedback scores below the floor; None if none of them ran."""
    medians = [statistics.middle([row.rmse_commanded_mm for row in only(members, arm=arm)]) for arm in REFERENCES]
    known = [median for median in medians if not math.isnan(median)]
    return all(median < FLOOR_MM for median in known) if known else None


# ---- comparisons


@dataclass(frozen=True)
class Contrast:
    """A comparison and the condition under which it was made; `varied` names what differs."""

    young: str
    noise: str
    varied: str
    comparison: Comparison


def controller_contrasts(table: Sequence[Row]) -> list[Contrast]:
    """I-FEM against ELM in every group and condition, then each of the two against every other controller."""
    contrasts = []
    main = main_rows(table)
    for condition in conditions(main):
        for group, members in by_group(under(main, condition)).items():
            floor = at_floor(members)
            for first, second in _couples(arms(members)):
                names = (first, second)
                compared = compare(
                    only(members, arm=first), only(members, arm=second), group=group, names=names, floor=floor
                )
                if compared:
                    contrasts.append(Contrast(condition.young, condition.noise, "arm", compared))
    return contrasts


def direction_contrasts(table: Sequence[Row]) -> list[Contrast]:
    """I-FEM against ELM along the curved paths of one direction at a time, which `varied` names: the four to an end
    point differ in how close to a held face they lead. Under the primary condition; nothing of a single direction."""
    curved = [row for row in under(main_rows(table), PRIMARY) if row.direction and row.arm in STEERED]
    contrasts = []
    for direction in sorted({row.direction for row in curved}):
        mine = only(curved, direction=direction)
        first, second = (only(mine, arm=arm) for arm in STEERED)
        if compared := compare(first, second, group=mine[0].group, names=STEERED):
            contrasts.append(Contrast(PRIMARY.young, PRIMARY.noise, direction, compared))
    return contrasts if len(contrasts) > 1 else []


def _couples(present: Sequence[str]) -> list[tuple[str, str]]:
    steered = [arm for arm in STEERED if arm in present]
    others = [arm for arm in present if arm not in STEERED]
    among = [(steered[0], steered[1])] if len(steered) == 2 else []
    return among + [(arm, other) for arm in steered for other in others]


def young_contrasts(table: Sequence[Row]) -> list[Contrast]:
    """Constant against variable Young's modulus, the same paths, for every controller that saw both."""
    contrasts = []
    main = only(main_rows(table), noise=PRIMARY.noise)
    for arm in arms(main):
        mine = only(main, arm=arm)
        fixed, changing = only(mine, young="constant"), only(mine, young="variable")
        shared = {row.pair for row in fixed} & {row.pair for row in changing}
        for group, members in by_group([row for row in mine if row.pair in shared]).items():
            names = ("constant", "variable")
            compared = compare(
                only(members, young="constant"), only(members, young="variable"), group=group, names=names
            )
            if compared:
                contrasts.append(Contrast("constant / variable", PRIMARY.noise, arm, compared))
    return contrasts
