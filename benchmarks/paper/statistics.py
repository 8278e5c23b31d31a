"""Tests, intervals and effect sizes for errors of which less is better. A failure is an infinite error, and so is one
that is no number: it ranks behind everything and stays in. All tests are two-tailed; randomness comes from a seed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Hashable, Sequence

# scipy.stats is imported where it is used: it takes most of a second, and a service starts without it
Vector = NDArray[np.float64]

SEED = 0
DRAWS = 4000
CONFIDENCE = 0.95
MARGIN_MM = 0.05  # [ours] equivalence margin, fixed before any result
FLOOR_MM = 0.05  # [ours] where controllers without feedback are below, a comparison says nothing
FEWEST_CLUSTERS = 5  # the range of fewer holds the median with less than 90 %: 2 * 0.5^n > 0.1


@dataclass(frozen=True)
class Interval:
    """A confidence interval, ends included."""

    low: float
    high: float

    def inside(self, margin: float) -> bool:
        """Whether all of it lies between -margin and +margin, neither end reached."""
        return -margin < self.low and self.high < margin


@dataclass(frozen=True)
class SignTest:
    """How often a difference was below zero, above, and zero; p of the two signs being equally likely."""

    below: int
    above: int
    ties: int
    p: float


def ranked_errors(values: Sequence[float] | Vector) -> Vector:
    """Errors of which less is better, every one that is not finite (NaN, either infinity) the worst of all."""
    errors = np.asarray(values, float)
    result: Vector = np.where(np.isfinite(errors), errors, math.inf)
    return result


def differences(first: Sequence[float] | Vector, second: Sequence[float] | Vector) -> Vector:
    """Differences first - second of paired errors; two failures are a tie."""
    a, b = ranked_errors(first), ranked_errors(second)
    both = np.isinf(a) & np.isinf(b)
    result: Vector = np.subtract(a, b, out=np.zeros_like(a), where=~both)
    return result


def ratios(first: Sequence[float] | Vector, second: Sequence[float] | Vector) -> Vector:
    """Ratios first / second of paired errors; two failures and two zeros are equal."""
    a, b = ranked_errors(first), ranked_errors(second)
    equal = a == b
    with np.errstate(divide="ignore"):
        result: Vector = np.divide(a, b, out=np.ones_like(a), where=~equal)
    return result


def _sorted(values: Sequence[float] | Vector) -> Vector:
    """What is no number counts as a failure, last of all."""
    known = np.asarray(values, float)
    return np.sort(np.where(np.isnan(known), math.inf, known))


def middle(values: Sequence[float] | Vector) -> float:
    """Median that knows infinite values; nan of nothing. Between minus and plus infinity it is zero: undecided."""
    ordered = _sorted(values)
    if not len(ordered):
        return math.nan
    low, high = ordered[(len(ordered) - 1) // 2], ordered[len(ordered) // 2]
    return _between(float(low), float(high))


def _between(low: float, high: float) -> float:
    if low == high:
        return low
    return 0.0 if math.isinf(low) and math.isinf(high) else 0.5 * low + 0.5 * high


def quantile(values: Sequence[float] | Vector, share: float) -> float:
    """Linearly interpolated; infinite as soon as an infinite value has a part in it; nan of nothing."""
    ordered = _sorted(values)
    if not len(ordered):
        return math.nan
    place = share * (len(ordered) - 1)
    low, part = math.floor(place), place - math.floor(place)
    if part == 0.0 or ordered[low] == ordered[low + 1]:
        return float(ordered[low])
    return float((1.0 - part) * ordered[low] + part * ordered[low + 1])


def cluster_medians(values: Sequence[float] | Vector, clusters: Sequence[Hashable]) -> Vector:
    """Median of each cluster, in the order in which clusters appear first."""
    members: dict[Hashable, list[float]] = {}
    for value, cluster in zip(np.asarray(values, float), clusters, strict=True):
        members.setdefault(cluster, []).append(float(value))
    return np.array([middle(inner) for inner in members.values()])


# ---- tests


def sign_test(values: Sequence[float] | Vector) -> SignTest:
    """Exact two-tailed sign test of paired differences; ties are counted and left out. p = 1 where nothing is left."""
    from scipy import stats

    signs = np.sign(np.asarray(values, float))
    below, above = int((signs < 0).sum()), int((signs > 0).sum())
    p = float(stats.binomtest(below, below + above, 0.5).pvalue) if below + above else 1.0
    return SignTest(below, above, int((signs == 0).sum()), p)


def holm(p_values: Sequence[float] | Vector) -> Vector:
    """Holm's step-down adjustment: as many planned tests as values, of which one that could not be made (NaN) counts as
    1. A test rejected at level a by its adjusted p keeps the chance of any false rejection among all below a."""
    known = np.asarray(p_values, float)
    known = np.where(np.isnan(known), 1.0, known)
    order = np.argsort(known, kind="stable")
    stepped = np.maximum.accumulate(known[order] * np.arange(len(known), 0, -1))
    adjusted: Vector = np.empty_like(known)
    adjusted[order] = np.minimum(stepped, 1.0)
    return adjusted


def mann_whitney_p(first: Sequence[float] | Vector, second: Sequence[float] | Vector) -> float:
    """Two-tailed Mann-Whitney U, unpaired; nan if a side is empty, 1 if all values are the same."""
    from scipy import stats

    a, b = ranked_errors(first), ranked_errors(second)
    if not len(a) or not len(b):
        return math.nan
    ranks = stats.rankdata(np.concatenate([a, b]))  # ranks are finite where failures are not
    if ranks.min() == ranks.max():
        return 1.0
    return float(stats.mannwhitneyu(ranks[: len(a)], ranks[len(a) :], alternative="two-sided").pvalue)


def wilcoxon_p(values: Sequence[float] | Vector) -> float:
    """Two-tailed Wilcoxon signed-rank test of paired differences, zeros left out; 1 where nothing is left."""
    from scipy import stats

    kept = _finite_ranks(values)
    return float(stats.wilcoxon(kept).pvalue) if len(kept) else 1.0


def _finite_ranks(values: Sequence[float] | Vector) -> Vector:
    """Differences without zeros; an infinite one becomes larger than every finite one, keeping its sign."""
    kept = np.asarray(values, float)
    kept = kept[kept != 0.0]
    finite = np.abs(kept[np.isfinite(kept)])
    beyond = 2.0 * float(finite.max()) if len(finite) else 1.0
    result: Vector = np.where(np.isfinite(kept), kept, np.sign(kept) * beyond)
    return result


# ---- effect sizes


def rank_biserial(values: Sequence[float] | Vector) -> float:
    """Matched-pairs rank-biserial correlation of differences, (W+ - W-) / (W+ + W-): -1 if all are below zero."""
    from scipy import stats

    kept = _finite_ranks(values)
    if not len(kept):
        return 0.0
    ranks = stats.rankdata(np.abs(kept))
    return float((np.sign(kept) * ranks).sum() / ranks.sum())


def cliffs_delta(first: Sequence[float] | Vector, second: Sequence[float] | Vector) -> float:
    """P(first > second) - P(first < second) over all unpaired couples, from -1 to 1; nan if a side is empty."""
    a, b = ranked_errors(first), ranked_errors(second)
    if not len(a) or not len(b):
        return math.nan
    return float(np.sign(differences(*np.broadcast_arrays(a[:, None], b[None, :]))).mean())


def superiority(values: Sequence[float] | Vector) -> float:
    """Probability that the first of a pair has the smaller error, ties counting half; nan of nothing."""
    signs = np.sign(np.asarray(values, float))
    return float(0.5 - 0.5 * signs.mean()) if len(signs) else math.nan


# ---- intervals


def wilson(hits: int, trials: int, confidence: float = CONFIDENCE) -> Interval:
    """Wilson's score interval of a share; everything from 0 to 1 without trials."""
    from scipy import stats

    if not trials:
        return Interval(0.0, 1.0)
    interval = stats.binomtest(hits, trials).proportion_ci(confidence_level=confidence, method="wilson")
    return Interval(float(interval.low), float(interval.high))


def bootstrap_median(
    values: Sequence[float] | Vector,
    clusters: Sequence[Hashable] | None = None,
    *,
    seed: int = SEED,
    draws: int = DRAWS,
    confidence: float = CONFIDENCE,
) -> Interval:
    """Percentile interval of the median when whole clusters are drawn with replacement (None: each value is one).

    nan, nan without values. Same seed, same interval, whatever the order of the values.
    """
    data = np.asarray(values, float)
    if not len(data):
        return Interval(math.nan, math.nan)
    names: list[Hashable] = list(clusters) if clusters is not None else list(range(len(data)))
    inverse = _canonical(data, names, paired=clusters is not None)
    counts = _drawn(int(inverse.max()) + 1, seed, draws)
    order = np.argsort(data, kind="stable")
    ordered = data[order]
    total = np.cumsum(counts[:, inverse[order]], axis=1)
    last = total[:, -1:]
    low = ordered[(total >= (last + 1) // 2).argmax(axis=1)]
    high = ordered[(total >= last // 2 + 1).argmax(axis=1)]
    medians = np.array([_between(float(a), float(b)) for a, b in zip(low, high, strict=True)])
    return percentiles(medians, confidence)


def bootstrap_superiority(
    values: Sequence[float] | Vector,
    clusters: Sequence[Hashable],
    *,
    seed: int = SEED,
    draws: int = DRAWS,
    confidence: float = CONFIDENCE,
) -> Interval:
    """Percentile interval of `superiority` when whole clusters are drawn with replacement; nan, nan of nothing."""
    signs = np.sign(np.asarray(values, float))
    if not len(signs):
        return Interval(math.nan, math.nan)
    inverse = _canonical(signs, list(clusters), paired=True)
    size = int(inverse.max()) + 1
    counts = _drawn(size, seed, draws)
    won = 0.5 - 0.5 * (counts @ np.bincount(inverse, signs, size)) / (counts @ np.bincount(inverse, minlength=size))
    return percentiles(won, confidence)


def percentiles(draws: Vector, confidence: float = CONFIDENCE) -> Interval:
    """The percentile interval of what a bootstrap has drawn; infinite values are the largest."""
    tail = 0.5 * (1.0 - confidence)
    low, high = np.quantile(draws, tail, method="lower"), np.quantile(draws, 1.0 - tail, method="higher")
    return Interval(float(low), float(high))


def _canonical(data: Vector, names: list[Hashable], *, paired: bool) -> NDArray[np.intp]:
    """A number for each value's cluster that depends on what is in the clusters, not on names or order."""
    if not paired:
        numbers: NDArray[np.intp] = np.empty(len(data), dtype=np.intp)
        numbers[np.argsort(data, kind="stable")] = np.arange(len(data))
        return numbers
    members: dict[Hashable, list[float]] = {}
    for name, value in zip(names, data, strict=True):
        members.setdefault(name, []).append(float(value))
    ranked = sorted(members, key=lambda name: sorted(members[name]))
    place = {name: i for i, name in enumerate(ranked)}
    return np.array([place[name] for name in names], dtype=np.intp)


def _drawn(clusters: int, seed: int, draws: int) -> NDArray[np.int64]:
    """How often each cluster is in each draw, (draws, clusters)."""
    rng = np.random.default_rng(seed)
    picked = rng.integers(0, clusters, size=(draws, clusters))
    flat = (picked + clusters * np.arange(draws)[:, None]).ravel()
    return np.bincount(flat, minlength=draws * clusters).reshape(draws, clusters)


def equivalent(
    values: Sequence[float] | Vector,
    clusters: Sequence[Hashable] | None = None,
    *,
    margin: float = MARGIN_MM,
    seed: int = SEED,
) -> bool:
    """Whether the median difference is shown to be smaller than the margin: its 90 % interval, two one-sided tests of
    5 %, lies inside. Never of fewer than five clusters: no 90 % interval of a median can be had from them."""
    names = clusters if clusters is not None else range(len(values))
    if len(set(names)) < FEWEST_CLUSTERS:
        return False
    return bootstrap_median(values, clusters, seed=seed, confidence=0.90).inside(margin)
