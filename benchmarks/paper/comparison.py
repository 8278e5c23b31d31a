"""Two sets of insertions against each other: paired by path, clustered by end point, with all tests side by side."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.paper import statistics
from benchmarks.paper.statistics import Interval, Vector
from benchmarks.paper.table import beside

if TYPE_CHECKING:
    from benchmarks.paper.table import Row


@dataclass(frozen=True)
class Pairs:
    """Errors of the same paths under two conditions, (n,) each, and the end point of each path."""

    first: Vector
    second: Vector
    clusters: tuple[str, ...]
    unpaired: int
    paths: frozenset[tuple[str, str, str]]  # that both have: group, end point, direction


@dataclass(frozen=True)
class Comparison:
    """`first` against `second`; every difference is first - second in mm, so that below zero the first is better.

    p_primary: sign test over the medians of each end point's differences. p_sign, p_mann_whitney: as in the paper, over
    all insertions. p_wilcoxon: signed ranks of the end points' medians. superiority: probability that the first is the
    better of a pair. equivalent: shown to differ by less than the margin. floor: without feedback it is as good.
    beside_first, beside_second: medians of `table.BESIDE` over the stable insertions of the pairs.
    """

    group: str
    first: str
    second: str
    pairs: int
    clusters: int
    unpaired: int
    median_first_mm: float
    median_second_mm: float
    difference_mm: float
    difference_interval_mm: Interval
    clusters_below: int
    clusters_above: int
    clusters_tied: int
    p_primary: float
    p_sign: float
    p_mann_whitney: float
    p_wilcoxon: float
    rank_biserial: float
    cliffs_delta: float
    superiority: float
    equivalent: bool
    floor: bool | None
    beside_first: Mapping[str, float]
    beside_second: Mapping[str, float]


def pair_rows(first: Sequence[Row], second: Sequence[Row], metric: str = "rmse_commanded_mm") -> Pairs:
    """Match rows by group, end point and direction; repeats of a path count as their median."""
    one, other = _by_path(first, metric), _by_path(second, metric)
    shared = sorted(one.keys() & other.keys())
    return Pairs(
        np.array([one[key] for key in shared], float),
        np.array([other[key] for key in shared], float),
        tuple(end_point for _, end_point, _ in shared),
        len(one.keys() ^ other.keys()),
        frozenset(shared),
    )


def _by_path(rows: Sequence[Row], metric: str) -> dict[tuple[str, str, str], float]:
    errors: dict[tuple[str, str, str], list[float]] = {}
    for row in rows:
        errors.setdefault(row.pair, []).append(row.ranked(metric))
    return {key: statistics.middle(values) for key, values in errors.items()}


def compare(
    first: Sequence[Row], second: Sequence[Row], *, group: str, names: tuple[str, str], floor: bool | None = None
) -> Comparison | None:
    """All tests of the paper's RMSE; None without a pair."""
    matched = pair_rows(first, second)
    if not matched.clusters:
        return None
    change = statistics.differences(matched.first, matched.second)
    medians = statistics.cluster_medians(change, matched.clusters)
    signs = statistics.sign_test(medians)
    return Comparison(
        group=group,
        first=names[0],
        second=names[1],
        pairs=len(change),
        clusters=len(medians),
        unpaired=matched.unpaired,
        median_first_mm=statistics.middle(matched.first),
        median_second_mm=statistics.middle(matched.second),
        difference_mm=statistics.middle(medians),
        difference_interval_mm=statistics.bootstrap_median(medians),
        clusters_below=signs.below,
        clusters_above=signs.above,
        clusters_tied=signs.ties,
        p_primary=signs.p,
        p_sign=statistics.sign_test(change).p,
        p_mann_whitney=statistics.mann_whitney_p(matched.first, matched.second),
        p_wilcoxon=statistics.wilcoxon_p(medians),
        rank_biserial=statistics.rank_biserial(medians),
        cliffs_delta=statistics.cliffs_delta(matched.first, matched.second),
        superiority=statistics.superiority(change),
        equivalent=statistics.equivalent(medians),
        floor=floor,
        beside_first=beside(row for row in first if row.pair in matched.paths),
        beside_second=beside(row for row in second if row.pair in matched.paths),
    )


def as_json(thing: Any) -> Any:
    """Dataclasses as objects, intervals as [low, high]; what is not finite becomes null."""
    if isinstance(thing, Interval):
        return [as_json(thing.low), as_json(thing.high)]
    if hasattr(thing, "__dataclass_fields__"):
        return {name: as_json(getattr(thing, name)) for name in thing.__dataclass_fields__}
    if isinstance(thing, Mapping):
        return {str(key): as_json(value) for key, value in thing.items()}
    if isinstance(thing, list | tuple):
        return [as_json(value) for value in thing]
    if isinstance(thing, float):
        return float(thing) if math.isfinite(thing) else None
    return thing
