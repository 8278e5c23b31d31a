"""Two sets of insertions against each other: paired, by path or as a design says, clustered by the unit of analysis,
with all tests side by side."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.paper import statistics
from benchmarks.paper.statistics import Interval, Vector
from benchmarks.paper.table import beside

if TYPE_CHECKING:
    from benchmarks.paper.table import Row


FEWEST = 6  # units with which a two-tailed sign test can reach p < 0.05
NO_INTERVAL = Interval(math.nan, math.nan)


@dataclass(frozen=True)
class Design:
    """How insertions are paired, and which pairs count as one observation. unit: what an observation is. key: of a
    row, equal for the two of a pair. cluster: of a row of the first set, equal for pairs that are not independent.
    notes: why this unit, and what does not count, in sentences."""

    unit: str
    key: Callable[[Row], Hashable]
    cluster: Callable[[Row], Hashable]
    notes: tuple[str, ...] = ()


BY_PATH = Design("end point", lambda row: row.pair, lambda row: row.end_point)  # that of the paper


@dataclass(frozen=True)
class Pairs:
    """Errors of the same cases under two conditions, (n,) each, and the cluster of each pair."""

    first: Vector
    second: Vector
    clusters: tuple[Hashable, ...]
    unpaired: int
    keys: frozenset[Hashable]  # that both have


@dataclass(frozen=True)
class Comparison:
    """`first` against `second`; every difference is first - second in mm, so that below zero the first is better.

    unit: what counts as one observation, of which there are `clusters`; notes: why, and what does not count.
    p_primary: sign test over the medians of each unit's differences, nan of a single one. p_holm: the same, adjusted
    for the comparisons made with it; nan before that. p_sign, p_mann_whitney: as in the paper, over all insertions.
    p_wilcoxon: signed ranks of the units' medians. superiority: probability that the first is the better of a pair.
    ratio: first / second. Intervals: bootstrap over units. equivalent: shown to differ by less than the margin. floor:
    without feedback it is as good. beside_first, beside_second: medians of `table.BESIDE` over the stable insertions of
    the pairs.
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
    superiority_interval: Interval
    ratio: float
    ratio_interval: Interval
    equivalent: bool
    floor: bool | None
    beside_first: Mapping[str, float]
    beside_second: Mapping[str, float]
    unit: str
    notes: tuple[str, ...]
    p_holm: float = math.nan
    family: int = 1  # tests that p_holm is adjusted for
    fewest: int = FEWEST  # units with which p_holm could be below 0.05 at all


def pair_rows(
    first: Sequence[Row], second: Sequence[Row], metric: str = "rmse_commanded_mm", design: Design = BY_PATH
) -> Pairs:
    """Match rows by the design's key; repeats of a key count as their median."""
    one, other = _by_key(first, metric, design), _by_key(second, metric, design)
    shared = sorted(one.keys() & other.keys(), key=repr)
    cluster_of = {design.key(row): design.cluster(row) for row in first}
    return Pairs(
        np.array([one[key] for key in shared], float),
        np.array([other[key] for key in shared], float),
        tuple(cluster_of[key] for key in shared),
        len(one.keys() ^ other.keys()),
        frozenset(shared),
    )


def _by_key(rows: Sequence[Row], metric: str, design: Design) -> dict[Hashable, float]:
    errors: dict[Hashable, list[float]] = {}
    for row in rows:
        errors.setdefault(design.key(row), []).append(row.ranked(metric))
    return {key: statistics.middle(values) for key, values in errors.items()}


def compare(
    first: Sequence[Row],
    second: Sequence[Row],
    *,
    group: str,
    names: tuple[str, str],
    floor: bool | None = None,
    design: Design = BY_PATH,
) -> Comparison | None:
    """All tests of the paper's RMSE; None without a pair. A single observation is tested by nothing."""
    matched = pair_rows(first, second, design=design)
    if not matched.clusters:
        return None
    change = statistics.differences(matched.first, matched.second)
    medians = statistics.cluster_medians(change, matched.clusters)
    ratios = statistics.cluster_medians(statistics.ratios(matched.first, matched.second), matched.clusters)
    signs = statistics.sign_test(medians)
    several, many = len(medians) > 1, len(change) > 1
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
        difference_interval_mm=statistics.bootstrap_median(medians) if several else NO_INTERVAL,
        clusters_below=signs.below,
        clusters_above=signs.above,
        clusters_tied=signs.ties,
        p_primary=signs.p if several else math.nan,
        p_sign=statistics.sign_test(change).p if many else math.nan,
        p_mann_whitney=statistics.mann_whitney_p(matched.first, matched.second) if many else math.nan,
        p_wilcoxon=statistics.wilcoxon_p(medians) if several else math.nan,
        rank_biserial=statistics.rank_biserial(medians),
        cliffs_delta=statistics.cliffs_delta(matched.first, matched.second),
        superiority=statistics.superiority(change),
        superiority_interval=statistics.bootstrap_superiority(change, matched.clusters) if several else NO_INTERVAL,
        ratio=statistics.middle(ratios),
        ratio_interval=statistics.bootstrap_median(ratios) if several else NO_INTERVAL,
        equivalent=statistics.equivalent(medians),
        floor=floor,
        beside_first=beside(row for row in first if design.key(row) in matched.keys),
        beside_second=beside(row for row in second if design.key(row) in matched.keys),
        unit=design.unit,
        notes=(*design.notes, *_missing(matched)),
    )


def _missing(matched: Pairs) -> list[str]:
    count = matched.unpaired
    return [f"{count} {'case has' if count == 1 else 'cases have'} no partner and left the test"] if count else []


def corrected(comparisons: Sequence[Comparison]) -> list[Comparison]:
    """The same comparisons with `p_holm`, adjusted for all of them together."""
    adjusted = statistics.holm([one.p_primary for one in comparisons])
    family = len(comparisons)
    fewest = next(n for n in range(1, 64) if 2.0 * 0.5**n * family < 1.0 - statistics.CONFIDENCE)
    values = [math.nan if math.isnan(one.p_primary) else float(p) for one, p in zip(comparisons, adjusted, strict=True)]
    known = zip(comparisons, values, strict=True)
    return [replace(one, p_holm=p, family=family, fewest=fewest) for one, p in known]


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
