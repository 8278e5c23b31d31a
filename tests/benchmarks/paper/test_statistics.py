"""Statistics against SciPy's own, hand-worked cases and identities."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from benchmarks.paper.statistics import (
    Interval,
    bootstrap_median,
    cliffs_delta,
    cluster_medians,
    differences,
    equivalent,
    mann_whitney_p,
    middle,
    quantile,
    rank_biserial,
    ratios,
    sign_test,
    superiority,
    wilcoxon_p,
    wilson,
)
from tests.budget import examples

ERRORS = st.lists(st.one_of(st.floats(0.0, 5.0), st.just(math.inf)), min_size=1, max_size=30)
CHANGES = st.lists(st.one_of(st.floats(-5.0, 5.0), st.just(math.inf), st.just(-math.inf)), max_size=30)

FEW = settings(deadline=None, max_examples=examples(40))  # exact tests with ties take a while


# ---- medians


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([3.0, 1.0, 2.0], 2.0),
        ([1.0, 2.0, 4.0, 9.0], 3.0),
        ([1.0, 2.0, math.inf], 2.0),
        ([1.0, math.inf, math.inf, 2.0], math.inf),
        ([-math.inf, math.inf], 0.0),
        ([math.inf, math.inf], math.inf),
    ],
)
def test_the_middle_knows_failures(values: list[float], expected: float) -> None:
    assert middle(values) == expected


@FEW
@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=40), st.floats(0.0, 1.0))
def test_finite_medians_and_quantiles_are_those_of_numpy(values: list[float], share: float) -> None:
    assert middle(values) == pytest.approx(np.median(values), abs=1e-9)
    assert quantile(values, share) == pytest.approx(np.quantile(values, share), abs=1e-6)


def test_nothing_has_no_middle() -> None:
    assert math.isnan(middle([]))
    assert math.isnan(quantile([], 0.5))


def test_a_quantile_that_touches_a_failure_is_one() -> None:
    assert quantile([1.0, 2.0, math.inf], 0.5) == 2.0
    assert quantile([1.0, 2.0, math.inf], 0.75) == math.inf
    assert quantile([math.inf, math.inf], 0.3) == math.inf


def test_two_failures_are_a_tie() -> None:
    first, second = [1.0, math.inf, math.inf, 1.0], [2.0, math.inf, 1.0, math.inf]
    assert differences(first, second).tolist() == [-1.0, 0.0, math.inf, -math.inf]
    assert ratios(first, second).tolist() == [0.5, 1.0, math.inf, 0.0]
    assert ratios([0.0, 1.0], [0.0, 0.0]).tolist() == [1.0, math.inf]


def test_clusters_keep_their_medians() -> None:
    assert cluster_medians([1, 5, 2, 9, 3], ["a", "b", "a", "b", "a"]).tolist() == [2.0, 7.0]


# ---- sign test


def test_sign_test_worked_by_hand() -> None:
    """Eight below, two above: 2 (C(10,0) + C(10,1) + C(10,2)) / 2^10 = 112 / 1024."""
    found = sign_test([-1.0] * 8 + [1.0] * 2 + [0.0] * 3)
    assert (found.below, found.above, found.ties) == (8, 2, 3)
    assert found.p == pytest.approx(112 / 1024, rel=1e-12)
    assert sign_test([-1.0] * 10).p == pytest.approx(2 / 1024, rel=1e-12)


@pytest.mark.parametrize("values", [[], [0.0], [0.0, 0.0]])
def test_no_signs_no_evidence(values: list[float]) -> None:
    assert sign_test(values).p == 1.0
    assert wilcoxon_p(values) == 1.0
    assert rank_biserial(values) == 0.0


@pytest.mark.slow
@FEW
@given(CHANGES)
def test_tests_of_pairs_do_not_care_who_is_first(values: list[float]) -> None:
    turned = [-v for v in values]
    one, other = sign_test(values), sign_test(turned)
    assert (one.below, one.above, one.p) == (other.above, other.below, other.p)
    assert wilcoxon_p(values) == pytest.approx(wilcoxon_p(turned), abs=1e-12)
    assert rank_biserial(values) == pytest.approx(-rank_biserial(turned), abs=1e-12)


@pytest.mark.slow
@FEW
@given(CHANGES)
def test_tests_of_pairs_do_not_care_about_order(values: list[float]) -> None:
    shuffled = sorted(values)
    assert sign_test(values) == sign_test(shuffled)
    assert wilcoxon_p(values) == pytest.approx(wilcoxon_p(shuffled), abs=1e-12)
    assert 0.0 <= wilcoxon_p(values) <= 1.0


# ---- Wilcoxon and Mann-Whitney


def test_wilcoxon_worked_by_hand() -> None:
    """Differences 1 ... 5, only the smallest negative: W- = 1; P(W <= 1) = 2 / 32 on each side."""
    assert wilcoxon_p([-1.0, 2.0, 3.0, 4.0, 5.0]) == pytest.approx(4 / 32, rel=1e-12)
    assert rank_biserial([-1.0, 2.0, 3.0, 4.0, 5.0]) == pytest.approx((14 - 1) / 15, rel=1e-12)


def test_wilcoxon_is_that_of_scipy() -> None:
    rng = np.random.default_rng(3)
    values = rng.normal(0.3, 1.0, 70)
    assert wilcoxon_p(values) == stats.wilcoxon(values).pvalue


def test_a_failure_has_the_largest_rank() -> None:
    assert wilcoxon_p([-1.0, 2.0, 3.0, 4.0, math.inf]) == wilcoxon_p([-1.0, 2.0, 3.0, 4.0, 5.0])
    assert rank_biserial([1.0, 2.0, -math.inf]) == 0.0


def test_mann_whitney_worked_by_hand() -> None:
    """Two complete sets of three: one of C(6,3) = 20 arrangements on each side."""
    assert mann_whitney_p([1.0, 2.0, 3.0], [4.0, 5.0, math.inf]) == pytest.approx(2 / 20, rel=1e-12)


def test_mann_whitney_is_that_of_scipy() -> None:
    rng = np.random.default_rng(4)
    a, b = rng.normal(0.0, 1.0, 40), rng.normal(0.4, 1.0, 55)
    assert mann_whitney_p(a, b) == pytest.approx(stats.mannwhitneyu(a, b).pvalue, rel=1e-12)


@FEW
@given(ERRORS, ERRORS)
def test_unpaired_comparisons_are_antisymmetric(first: list[float], second: list[float]) -> None:
    assert mann_whitney_p(first, second) == pytest.approx(mann_whitney_p(second, first), abs=1e-12)
    assert cliffs_delta(first, second) == pytest.approx(-cliffs_delta(second, first), abs=1e-12)


@FEW
@given(ERRORS, ERRORS)
def test_cliffs_delta_counts_couples(first: list[float], second: list[float]) -> None:
    counted = sum((a > b) - (a < b) for a, b in itertools.product(first, second))
    assert cliffs_delta(first, second) == pytest.approx(counted / (len(first) * len(second)), abs=1e-12)


def test_comparisons_with_nothing() -> None:
    assert math.isnan(mann_whitney_p([], [1.0]))
    assert math.isnan(cliffs_delta([1.0], []))
    assert math.isnan(superiority([]))
    assert mann_whitney_p([1.0, 1.0], [1.0]) == 1.0
    assert mann_whitney_p([math.inf], [math.inf, math.inf]) == 1.0


def test_superiority_is_the_share_of_pairs_with_a_smaller_error() -> None:
    assert superiority([-1.0, -math.inf, 0.0, 2.0]) == pytest.approx(2.5 / 4)


# ---- intervals


def test_wilson_worked_by_hand() -> None:
    """All of 100: (1, 1 / (1 + z^2 / n)) with z = 1.959964; 490 of 500 from the formula."""
    z2 = 1.959963984540054**2
    full = wilson(100, 100)
    assert full.low == pytest.approx(1.0 / (1.0 + z2 / 100), rel=1e-9)
    assert full.high == pytest.approx(1.0)
    p, n = 0.98, 500
    centre, half = p + z2 / (2 * n), math.sqrt(z2 * (p * (1 - p) / n + z2 / (4 * n * n)))
    found = wilson(490, 500)
    assert found.low == pytest.approx((centre - half) / (1 + z2 / n), rel=1e-9)
    assert found.high == pytest.approx((centre + half) / (1 + z2 / n), rel=1e-9)
    assert wilson(0, 0) == Interval(0.0, 1.0)


@FEW
@given(st.integers(1, 300), st.data())
def test_wilson_contains_the_share(trials: int, data: st.DataObject) -> None:
    hits = data.draw(st.integers(0, trials))
    found = wilson(hits, trials)
    assert 0.0 <= found.low <= hits / trials <= found.high <= 1.0 + 1e-12


def test_bootstrap_interval_is_that_of_the_order_statistics() -> None:
    """Of 100 distinct values the exact 95 % interval of the median is from the 40th to the 61st."""
    found = bootstrap_median(np.arange(1.0, 101.0))
    assert 39.0 <= found.low <= 42.0
    assert 59.0 <= found.high <= 62.0


def test_bootstrap_covers_the_median_as_often_as_it_says() -> None:
    rng = np.random.default_rng(11)
    hits = 0
    for trial in range(200):
        found = bootstrap_median(rng.normal(0.0, 1.0, 41), seed=trial, draws=400)
        hits += found.low <= 0.0 <= found.high
    assert 178 <= hits <= 200  # 95 % of 200, four standard deviations below


def test_copies_in_a_cluster_are_no_new_evidence() -> None:
    values = np.random.default_rng(5).normal(0.0, 1.0, 50)
    alone = bootstrap_median(values)
    fourfold = bootstrap_median(np.repeat(values, 4), np.repeat(np.arange(50), 4).tolist())
    naive = bootstrap_median(np.repeat(values, 4))
    assert fourfold == alone
    assert naive.high - naive.low < 0.8 * (alone.high - alone.low)


@FEW
@given(st.lists(st.tuples(st.floats(-2.0, 2.0), st.integers(0, 5)), min_size=1, max_size=20), st.integers(0, 3))
def test_bootstrap_knows_neither_order_nor_names(couples: list[tuple[float, int]], seed: int) -> None:
    values, clusters = [v for v, _ in couples], [f"c{c}" for _, c in couples]
    one = bootstrap_median(values, clusters, seed=seed, draws=60)
    renamed = bootstrap_median(values[::-1], [f"{c}{5 - int(c[1])}" for c in clusters[::-1]], seed=seed, draws=60)
    assert one == renamed
    assert min(values) <= one.low <= one.high <= max(values)


def test_bootstrap_of_failures() -> None:
    assert bootstrap_median([math.inf] * 5) == Interval(math.inf, math.inf)
    mixed = bootstrap_median([0.1, 0.2, 0.3, math.inf, math.inf, math.inf])
    assert math.isfinite(mixed.low)
    assert mixed.high == math.inf
    assert math.isnan(bootstrap_median([]).low)


@pytest.mark.parametrize(("shift", "expected"), [(0.0, True), (0.03, True), (0.05, False), (0.2, False), (-0.2, False)])
def test_equivalence_needs_the_whole_interval_inside(shift: float, expected: bool) -> None:
    noise = np.random.default_rng(7).normal(0.0, 0.01, 100)
    assert equivalent(noise - np.median(noise) + shift) is expected


def test_one_insertion_shows_no_equivalence() -> None:
    assert not equivalent([0.0])
    assert not equivalent([0.0, 0.001, 0.0], ["a", "a", "a"])
    assert not equivalent([0.0, 0.001, 0.0, 0.002])  # outside the range of four is their median with 1/8
    assert equivalent([0.0, 0.001, 0.0, 0.002, 0.001])
    assert not equivalent([])
    assert not equivalent([math.inf] * 20)


# ---- what is no number never wins


@pytest.mark.parametrize("broken", [math.nan, math.inf, -math.inf])
def test_an_error_that_is_no_number_loses_every_comparison(broken: float) -> None:
    sound, odd = [0.1, 0.2, 0.3, 0.4, 0.5], [broken] * 5
    change = differences(odd, sound)
    assert (change == math.inf).all()
    assert sign_test(change).above == 5
    assert (differences(sound, odd) == -math.inf).all()
    assert (ratios(odd, sound) == math.inf).all()
    assert cliffs_delta(odd, sound) == 1.0
    assert mann_whitney_p(odd, sound) == mann_whitney_p([9.0] * 5, sound) < 0.05
    assert superiority(change) == 0.0
    assert (differences(odd, [math.nan] * 5) == 0.0).all()  # two failures are a tie


def test_a_median_with_what_is_no_number_is_that_of_a_failure() -> None:
    assert middle([math.nan, 0.1]) == math.inf
    assert middle([0.2, math.nan, 0.1]) == 0.2
    assert quantile([math.nan, 0.1, 0.2], 0.75) == math.inf
