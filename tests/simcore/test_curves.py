"""Arcs and curves through points: by arc length, against closed forms and dense sampling."""

from __future__ import annotations

import math

import numpy as np
import pytest

from simcore.trajectory import ArcPath, Path, SinePath, SplinePath, targets

ENTRY = np.array([0.018, 0.031, 0.0])
END = np.array([0.024, 0.041, 0.1])
SIDE = np.array([3.0, -1.0, 2.0])
POINTS = np.array([ENTRY, [0.020, 0.033, 0.03], [0.017, 0.036, 0.034], [0.024, 0.041, 0.1]])

PATHS: dict[str, Path] = {
    "arc": ArcPath(ENTRY, END, 0.12, SIDE),
    "half circle": ArcPath(ENTRY, END, 0.5 * math.dist(ENTRY, END), SIDE),
    "flat arc": ArcPath(ENTRY, END, 100.0, SIDE),
    "spline": SplinePath.through(POINTS),
    "two points": SplinePath.through(POINTS[[0, 3]]),
    "many points": SplinePath.through(SinePath(ENTRY, END, 2e-3, 2.0, SIDE).curve(np.linspace(0.0, 1.0, 400))),
    "sine": SinePath(ENTRY, END, 2e-3, 2.0, SIDE),
}
every = pytest.mark.parametrize("path", PATHS.values(), ids=PATHS.keys())


@every
def test_it_begins_and_ends_where_it_should(path: Path) -> None:
    np.testing.assert_allclose(path.curve(np.array([0.0, 1.0])), [ENTRY, END], atol=1e-12)
    np.testing.assert_allclose(path.point(np.array([-1.0, 9.0])), [ENTRY, END], atol=1e-12)


@every
def test_derivatives_are_those_of_the_curve(path: Path) -> None:
    u, h = np.linspace(0.01, 0.99, 50), 1e-5
    central = (path.curve(u + h) - path.curve(u - h)) / (2 * h)
    np.testing.assert_allclose(path.derivative(u), central, atol=1e-7)
    central = (path.derivative(u + h) - path.derivative(u - h)) / (2 * h)
    np.testing.assert_allclose(path.second_derivative(u), central, atol=2e-3 * np.abs(central).max() + 1e-8)


@every
def test_the_target_slides_at_constant_speed(path: Path) -> None:
    """Against the lengths of a polygon of 400,000 pieces."""
    u = np.linspace(0.0, 1.0, 400_001)
    reached = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path.curve(u), axis=0), axis=1))])
    assert path.length_m == pytest.approx(reached[-1], rel=1e-8)
    s = np.linspace(0.0, path.length_m, 101)
    np.testing.assert_allclose(np.interp(path.parameter(s), u, reached), s, atol=1e-9)
    moved = targets(path, speed_m_s=0.01, dt_s=0.1, steps=50)
    np.testing.assert_allclose(moved, path.point(np.linspace(0.0, 50e-3, 51)), atol=1e-15)


@every
def test_curvature_is_that_of_three_near_points(path: Path) -> None:
    """1 / radius of the circle through them (Heron's formula)."""
    s = np.linspace(0.1, 0.9, 30) * path.length_m
    a, b, c = (path.point(s + shift) for shift in (-2e-4, 0.0, 2e-4))
    sides = [np.linalg.norm(p - q, axis=1) for p, q in ((a, b), (b, c), (a, c))]
    doubled = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    near = 2.0 * doubled / np.prod(sides, axis=0)
    np.testing.assert_allclose(path.curvature_per_m(path.parameter(s)), near, rtol=0.05, atol=2.0)


def test_an_arc_keeps_its_distance_from_one_point_and_bulges_to_its_side() -> None:
    path = PATHS["arc"]
    assert isinstance(path, ArcPath)
    points = path.curve(np.linspace(0.0, 1.0, 50))
    around = points - path._frame[0]
    np.testing.assert_allclose(np.linalg.norm(around, axis=1), 0.12, atol=1e-12)
    assert abs(np.linalg.det(around[[0, 20, 40]])) < 1e-15
    assert (points[25] - 0.5 * (ENTRY + END)) @ SIDE > 0.0
    chord = math.dist(ENTRY, END)
    assert path.length_m == pytest.approx(2.0 * 0.12 * math.asin(0.5 * chord / 0.12), rel=1e-12)
    np.testing.assert_allclose(path.curvature_per_m(np.linspace(0, 1, 9)), 1.0 / 0.12, rtol=1e-12)


def test_a_half_circle_is_the_longest_arc() -> None:
    assert PATHS["half circle"].length_m == pytest.approx(0.5 * np.pi * math.dist(ENTRY, END), rel=1e-9)


def test_a_spline_goes_through_its_points_and_is_not_bent_at_its_ends() -> None:
    path = PATHS["spline"]
    assert path.distance_m(POINTS).max() < 1e-9
    np.testing.assert_allclose(path.second_derivative(np.array([0.0, 1.0])), 0.0, atol=1e-12)
    through_two = PATHS["two points"]
    assert through_two.is_straight
    assert through_two.length_m == pytest.approx(math.dist(ENTRY, END), rel=1e-15)


def test_a_spline_through_many_points_of_a_curve_is_that_curve() -> None:
    many, sine = PATHS["many points"], PATHS["sine"]
    assert many.length_m == pytest.approx(sine.length_m, rel=1e-7)
    s = np.linspace(0.0, sine.length_m, 77)
    np.testing.assert_allclose(many.point(s), sine.point(s), atol=2e-8)
