"""Many arms at once: interquartile means and performance profiles, with bootstrap intervals over the cases that all of
them ran (Agarwal et al. 2021, after Dolan and More 2002)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.paper.statistics import CONFIDENCE, SEED, Interval, Vector, cluster_medians, percentiles
from benchmarks.paper.table import Row, arms, beside, only

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

DRAWS = 2000
LEVELS = 60  # error levels of a profile
FEWEST = 2  # cases; of a single one there is nothing to say


@dataclass(frozen=True)
class Aggregate:
    """One arm over the cases that all arms ran. iqm_mm: mean of the middle half of the RMSE, infinite where failures
    reach into it. share: of the cases whose RMSE is at most each level of the profiles, with the ends of its interval.
    beside: medians of `table.BESIDE`, stable cases alone."""

    arm: str
    cases: int
    iqm_mm: float
    iqm_interval_mm: Interval
    success: float
    beside: Mapping[str, float]
    share: tuple[float, ...]
    share_low: tuple[float, ...]
    share_high: tuple[float, ...]


@dataclass(frozen=True)
class Profiles:
    """cases: that all arms ran, of how many places. strata: kinds of paths within which cases are drawn. levels_mm:
    RMSE at which the shares are taken."""

    cases: int
    places: int
    strata: int
    levels_mm: tuple[float, ...]
    aggregates: tuple[Aggregate, ...]


def profiles(table: Sequence[Row], *, fewest_arms: int = 2) -> Profiles | None:
    """Of so many arms or more; None without cases that all of them ran."""
    names = arms(table)
    errors = {arm: _by_place(only(table, arm=arm)) for arm in names}
    places, shared = _places(errors)
    if len(names) < fewest_arms or len(shared) < FEWEST:
        return None
    kinds = {row.place: row.group for row in table}
    strata = [np.flatnonzero([kinds[place] == kind for place in shared]) for kind in sorted(set(kinds.values()))]
    strata = [members for members in strata if len(members)]
    draws = _draws(strata, len(shared))
    values = {arm: np.array([errors[arm][place] for place in shared]) for arm in names}
    levels = _levels(values)
    found = []
    for arm in names:
        mine = [row for row in only(table, arm=arm) if row.place in set(shared)]
        found.append(_aggregate(arm, mine, values[arm], draws, levels))
    return Profiles(len(shared), len(places), len(strata), tuple(map(float, levels)), tuple(found))


@dataclass(frozen=True)
class Shares:
    """Performance profiles alone, without intervals. share: by arm, of the cases whose RMSE is at most each level."""

    cases: int
    levels_mm: tuple[float, ...]
    share: Mapping[str, tuple[float, ...]]


def shares(table: Sequence[Row]) -> Shares | None:
    """Of any number of arms; None without cases that all of them ran. Draws nothing, so it is quick."""
    errors = {arm: _by_place(only(table, arm=arm)) for arm in arms(table)}
    shared = _places(errors)[1]
    if len(shared) < FEWEST:
        return None
    values = {arm: np.array([known[place] for place in shared]) for arm, known in errors.items()}
    levels = _levels(values)
    below = {arm: (mine[:, None] <= levels[None, :]).mean(axis=0) for arm, mine in values.items()}
    return Shares(
        len(shared), tuple(map(float, levels)), {arm: tuple(map(float, share)) for arm, share in below.items()}
    )


def _places(errors: Mapping[str, Mapping[str, float]]) -> tuple[set[str], list[str]]:
    """All places, and those that every arm has."""
    places = {place for known in errors.values() for place in known}
    return places, sorted(places.intersection(*errors.values())) if errors else []


def _by_place(rows: Sequence[Row]) -> dict[str, float]:
    places = [row.place for row in rows]
    medians = cluster_medians([row.rmse_commanded_mm for row in rows], places)
    return dict(zip(dict.fromkeys(places), map(float, medians), strict=True))


def _draws(strata: Sequence[np.ndarray], count: int) -> np.ndarray:
    """(DRAWS, count) numbers of cases, each stratum drawn with replacement from itself."""
    rng = np.random.default_rng(SEED)
    drawn = [rng.choice(members, size=(DRAWS, len(members))) for members in strata]
    return np.concatenate(drawn, axis=1).reshape(DRAWS, count)


def _levels(values: Mapping[str, Vector]) -> Vector:
    every = np.concatenate(list(values.values()))
    known = every[np.isfinite(every) & (every > 0.0)]
    if not len(known):
        return np.array([])
    return np.geomspace(0.9 * known.min(), 1.1 * known.max(), LEVELS)


def _aggregate(arm: str, rows: Sequence[Row], errors: Vector, draws: np.ndarray, levels: Vector) -> Aggregate:
    below = (errors[:, None] <= levels[None, :]).astype(float)
    shares = below[draws].mean(axis=1)
    tail = 0.5 * (1.0 - CONFIDENCE)
    low, high = (np.quantile(shares, share, axis=0) for share in (tail, 1.0 - tail))
    return Aggregate(
        arm=arm,
        cases=len(errors),
        iqm_mm=interquartile_mean(errors),
        iqm_interval_mm=percentiles(np.array([interquartile_mean(one) for one in errors[draws]])),
        success=sum(row.success for row in rows) / len(rows),
        beside=beside(rows),
        share=tuple(map(float, below.mean(axis=0))),
        share_low=tuple(map(float, low)),
        share_high=tuple(map(float, high)),
    )


def interquartile_mean(values: Vector) -> float:
    """Mean of the middle half, the values at its ends counted in part; infinite where a failure is within, nan of
    nothing."""
    ordered = np.sort(np.where(np.isnan(values), math.inf, values))
    count = len(ordered)
    if not count:
        return math.nan
    edges = np.arange(count + 1)
    weights = np.clip(np.minimum(edges[1:], 0.75 * count) - np.maximum(edges[:-1], 0.25 * count), 0.0, 1.0)
    inner = weights > 0.0
    return float((weights[inner] * ordered[inner]).sum() / weights.sum())
