"""Sine, cosine, arc tangent, exponential and logarithm: within two units of the last place, and of one value inside and
outside of kernels."""

from __future__ import annotations

import math
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
import pytest

from simcore import elementary, elementary_kernels
from simcore.elementary import arc_tangent, exponential, logarithm, sigmoid, sines_cosines

if TYPE_CHECKING:
    from numpy.typing import NDArray

RNG = np.random.default_rng(3)
ANGLES = np.concatenate([RNG.uniform(-1.0, 1.0, 3000), RNG.uniform(-1e6, 1e6, 3000), np.pi / 4 * np.arange(-20, 21)])
POINTS = RNG.normal(size=(3000, 2)) * 10.0 ** RNG.integers(-150, 150, (3000, 2))


def units(found: NDArray[np.float64], expected: NDArray[np.float64]) -> float:
    """The largest difference in units of the last place."""
    return float((np.abs(found - expected) / np.spacing(np.abs(expected))).max())


def test_sines_and_cosines() -> None:
    sines, cosines = sines_cosines(ANGLES)
    assert units(sines, np.array([math.sin(angle) for angle in ANGLES])) <= 2.0
    assert units(cosines, np.array([math.cos(angle) for angle in ANGLES])) <= 2.0
    assert np.abs(sines**2 + cosines**2 - 1.0).max() < 5e-16


def test_arc_tangents() -> None:
    found = np.array([arc_tangent(y, x) for y, x in POINTS])
    assert units(found, np.array([math.atan2(y, x) for y, x in POINTS])) <= 2.0
    for y, x in product((-1.0, 0.0, 1e-300, 1.0), repeat=2):
        assert arc_tangent(y, x) == math.atan2(y, x)


def test_exponentials_and_logarithms() -> None:
    powers = np.concatenate([RNG.uniform(-1.0, 1.0, 3000), RNG.uniform(-700.0, 700.0, 3000)])
    assert units(exponential(powers), np.array([math.exp(power) for power in powers])) <= 2.0
    numbers = np.concatenate([exponential(powers), 1.0 + RNG.uniform(-0.1, 0.1, 3000)])
    assert units(np.array([logarithm(x) for x in numbers]), np.array([math.log(x) for x in numbers])) <= 2.0


def test_an_exponential_beyond_the_numbers() -> None:
    np.testing.assert_array_equal(exponential(np.array([-1e4, -np.inf, 0.0])), [0.0, 0.0, 1.0])
    assert exponential(np.array([1e4]))[0] > 1e308
    assert sigmoid(np.array([-1e4, 0.0, 1e4])) == pytest.approx([0.0, 0.5, 1.0], abs=1e-300)
    assert np.isnan(exponential(np.array([np.nan]))[0])


@pytest.mark.parametrize("start", [0, 3000, 6000])
def test_kernels_have_the_same_bits(start: int) -> None:
    angles = ANGLES[start : start + 41]
    inside = np.array([elementary_kernels.sine_cosine(angle) for angle in angles])
    np.testing.assert_array_equal(inside.T, sines_cosines(angles))
    for y, x in POINTS[start : start + 41]:
        assert elementary_kernels.arc_tangent(y, x) == elementary.arc_tangent(y, x)
