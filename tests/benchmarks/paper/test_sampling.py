"""Where the insertions go: properties that hold for every seed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.learning.training_insertions import grid_mm
from benchmarks.paper import sampling
from tests.budget import examples

seeds = st.integers(0, 2**32 - 1)


@given(seeds)
@settings(max_examples=examples(20), deadline=None)
def test_points_keep_their_distance_for_every_seed(seed: int) -> None:
    points = sampling.end_points_mm(100, seed=seed)
    grid = grid_mm()
    assert points.shape == (100, 3)
    assert points[:, 0].min() >= 2.0
    assert points[:, 0].max() <= 34.0
    assert points[:, 1].min() >= 2.0
    assert points[:, 1].max() <= 60.0
    assert np.all(points[:, 2] == 122.0)
    assert np.linalg.norm(points[:, None] - grid, axis=2).min() >= 1.0


def test_points_fill_the_face() -> None:
    points = sampling.end_points_mm()
    quarter = (points[:, 0] > 18).astype(int) + 2 * (points[:, 1] > 31).astype(int)
    assert np.bincount(quarter, minlength=4).min() >= 15  # of 25 expected; binomial: below 15 with p = 0.005 each


@given(st.integers(1, 100))
@settings(max_examples=examples(10))
def test_the_first_points_do_not_depend_on_the_count(count: int) -> None:
    assert np.array_equal(sampling.end_points_mm(count), sampling.end_points_mm()[:count])


def test_stiffness_is_paired_seeded_and_uniform() -> None:
    draws = np.array([[sampling.young_kpa(i, d) for d in ("", *sampling.DIRECTIONS)] for i in range(100)])
    assert draws.min() >= 5.5
    assert draws.max() <= 6.3
    assert draws.mean() == pytest.approx(5.9, abs=4 * 0.8 / 12**0.5 / 500**0.5)
    assert len(np.unique(draws)) > 450
    assert sampling.young_kpa(17, "+x") == draws[17, 1]
    assert sampling.young_kpa(17, "+x", seed=1) != draws[17, 1]


def test_a_direction_that_is_none_is_refused() -> None:
    with pytest.raises(ValueError, match="direction = '\\+z'"):
        sampling.young_kpa(0, "+z")
