"""Paths by arc length, step counts, distances and held noise; references are dense sampling and closed forms."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from simcore.trajectory import SinePath, held_noise, step_count, targets
from tests.budget import examples

if TYPE_CHECKING:
    from simcore.arrays import Floats

ENTRY = np.array([0.018, 0.031, 0.0])
END = np.array([0.024, 0.041, 0.122])
X = np.array([1.0, 0.0, 0.0])

PATHS = {
    "line": SinePath(ENTRY, END),
    "bow": SinePath(ENTRY, END, 3e-3, 0.5, X),
    "sine": SinePath(ENTRY, END, 1e-3, 1.0, X),
    "steep": SinePath(ENTRY, END, 0.02, 3.0, np.array([0.3, -2.0, 5.0])),
    "wild": SinePath(ENTRY, END, 0.02, 10.0, X),
}
curved = pytest.mark.parametrize("path", [p for n, p in PATHS.items() if n != "line"], ids=list(PATHS)[1:])
every = pytest.mark.parametrize("path", PATHS.values(), ids=PATHS.keys())

coordinates = st.floats(-0.2, 0.2)
vectors = st.tuples(coordinates, coordinates, coordinates).map(np.array)


@st.composite
def paths(draw: st.DrawFn) -> SinePath:
    entry, chord, direction = draw(vectors), draw(vectors), draw(vectors)
    assume(np.linalg.norm(chord) > 1e-3)
    assume(np.linalg.norm(np.cross(direction, chord)) > 1e-3 * np.linalg.norm(chord))
    amplitude = draw(st.floats(0.0, 0.3)) * float(np.linalg.norm(chord))
    return SinePath(entry, entry + chord, amplitude, draw(st.floats(0.1, 4.0)), direction)


def dense(path: SinePath, n: int = 200_001) -> tuple[Floats, Floats, Floats]:
    """u (n,), points (n, 3) and summed chord lengths (n,)."""
    u = np.linspace(0.0, 1.0, n)
    points = path.curve(u)
    return u, points, np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


@every
def test_length_is_the_limit_of_polygons(path: SinePath) -> None:
    assert path.length_m == pytest.approx(dense(path)[2][-1], rel=1e-8)


def test_length_of_a_line_is_its_chord() -> None:
    assert PATHS["line"].length_m == pytest.approx(math.dist(ENTRY, END), rel=1e-15)
    assert SinePath(ENTRY, END, 0.0, 3.0, X).length_m == pytest.approx(math.dist(ENTRY, END), rel=1e-15)


def test_length_of_a_shallow_sine() -> None:
    """L = c (1 + (A k / c)^2 / 4 + O(4th order)), k = 2 pi n; the next term is 3 / 64 of the square's square."""
    chord, amplitude = 0.1, 1e-4
    path = SinePath(np.zeros(3), np.array([0.0, 0.0, chord]), amplitude, 1.0, X)
    slope = amplitude * 2 * np.pi / chord
    assert path.length_m / chord - 1 == pytest.approx(slope**2 / 4 - 3 * slope**4 / 64, rel=1e-6)


def test_amplitude_extremes() -> None:
    tiny = SinePath(ENTRY, END, 1e-12, 1.0, X)
    assert tiny.length_m == pytest.approx(math.dist(ENTRY, END), rel=1e-14)
    needle_eye = SinePath(np.zeros(3), np.array([0.0, 0.0, 1e-4]), 0.02, 10.0, X)  # forty strands of 20 mm
    assert needle_eye.length_m == pytest.approx(40 * 0.02, rel=5e-5)
    s = np.linspace(0.0, needle_eye.length_m, 2001)
    u = needle_eye.parameter(s)
    assert (np.diff(u) >= 0.0).all()
    gaps = np.linalg.norm(np.diff(needle_eye.point(s), axis=0), axis=1)
    assert gaps.max() <= (s[1] - s[0]) * (1 + 1e-3)


@every
def test_points_run_at_constant_speed(path: SinePath) -> None:
    u, _, lengths = dense(path)
    s = np.linspace(0.0, path.length_m, 777)
    np.testing.assert_allclose(np.interp(path.parameter(s), u, lengths), s, atol=2e-8 * path.length_m)


@pytest.mark.slow
@settings(max_examples=examples(60), deadline=None)
@given(paths(), st.lists(st.floats(0.0, 1.0), min_size=1, max_size=5))
def test_parameter_inverts_the_arc_length(path: SinePath, shares: list[float]) -> None:
    u, _, lengths = dense(path, 20_001)
    s = path.length_m * np.array(shares)
    np.testing.assert_allclose(np.interp(path.parameter(s), u, lengths), s, atol=2e-6 * path.length_m)


@every
def test_the_ends_are_exact_and_clipped(path: SinePath) -> None:
    length = path.length_m
    np.testing.assert_allclose(path.point(np.array([-1.0, 0.0]))[0], path.entry_m, atol=1e-15)
    np.testing.assert_allclose(path.point(np.array([0.0]))[0], path.entry_m, atol=1e-15)
    end = path.curve(np.ones(1))[0]
    np.testing.assert_allclose(path.point(np.array([length, length + 1e-9, 9.0])), [end] * 3, atol=1e-14)


@settings(max_examples=examples(60), deadline=None)
@given(paths())
def test_the_overlay_is_a_unit_vector_across_the_chord(path: SinePath) -> None:
    assume(not path.is_straight)
    chord = path.end_m - path.entry_m
    assert np.linalg.norm(path.overlay) == pytest.approx(1.0, abs=1e-12)
    assert path.overlay @ chord == pytest.approx(0.0, abs=1e-9 * float(np.linalg.norm(chord)))
    assert path.direction is not None
    assert path.overlay @ path.direction > 0.0
    assert path.overlay @ np.cross(path.direction, chord) == pytest.approx(0.0, abs=1e-12)  # in their plane


def test_a_straight_path_has_no_overlay() -> None:
    assert not PATHS["line"].overlay.any()
    assert not SinePath(ENTRY, END, 0.0, 1.0, X).overlay.any()


@curved
def test_the_excursion_is_the_amplitude(path: SinePath) -> None:
    away = (dense(path)[1] - path.entry_m) @ path.overlay
    reached = 1.0 if path.periods < 0.75 else -1.0
    assert away.max() == pytest.approx(path.amplitude_m, rel=1e-6)
    assert away.min() == pytest.approx(min(0.0, reached * path.amplitude_m), abs=1e-8)


@every
def test_the_derivative_is_that_of_the_curve(path: SinePath) -> None:
    u, h = np.linspace(0.01, 0.99, 50), 1e-6
    central = (path.curve(u + h) - path.curve(u - h)) / (2 * h)
    np.testing.assert_allclose(path.derivative(u), central, atol=1e-9 * path.periods**3)


@every
def test_the_first_tangent(path: SinePath) -> None:
    tangent = path.first_tangent()
    assert np.linalg.norm(tangent) == pytest.approx(1.0, abs=1e-15)
    ahead = path.point(np.array([1e-7]))[0] - path.entry_m
    np.testing.assert_allclose(tangent, ahead / np.linalg.norm(ahead), atol=1e-4)
    slope = path.amplitude_m * 2 * np.pi * path.periods / np.linalg.norm(path.chord)
    assert tangent @ path.chord / np.linalg.norm(path.chord) == pytest.approx(1 / np.hypot(1, slope), rel=1e-12)


# ---- distances


@every
def test_points_of_the_path_have_no_distance(path: SinePath) -> None:
    s = np.linspace(0.0, path.length_m, 301)
    assert path.distance_m(path.point(s)).max() < 1e-10


@curved
def test_distance_along_the_normal_within_the_curvature(path: SinePath) -> None:
    """A point off the curve along its normal, nearer than the centre of curvature, has that distance."""
    u = np.linspace(0.05, 0.95, 41)
    tangents = path.derivative(u) / np.linalg.norm(path.derivative(u), axis=1)[:, None]
    normal = np.cross(path.chord / np.linalg.norm(path.chord), path.overlay)  # out of the plane: never bent towards
    for off in (1e-6, 1e-3, 0.05, 1.0):
        np.testing.assert_allclose(path.distance_m(path.curve(u) + off * normal), off, rtol=1e-9)
    bend = float(np.linalg.norm(path.chord) ** 2 / (path.amplitude_m * (2 * np.pi * path.periods) ** 2))
    across = np.cross(tangents, normal)
    for off in (0.2 * bend, -0.2 * bend):
        np.testing.assert_allclose(path.distance_m(path.curve(u) + off * across), abs(off), rtol=1e-6)


def test_distance_from_a_line_and_beyond_its_ends() -> None:
    line = SinePath(np.zeros(3), np.array([0.0, 0.0, 0.1]))
    points = np.array([[0.003, 0.004, 0.05], [0.0, 0.0, 0.05], [0.0, 0.0, -0.02], [0.003, 0.004, 0.112]])
    np.testing.assert_allclose(line.distance_m(points), [0.005, 0.0, 0.02, 0.013], atol=1e-11)
    assert line.distance_m(np.array([0.0, 0.001, 0.01])) == pytest.approx([0.001])


@pytest.mark.slow
@settings(max_examples=examples(40), deadline=None)
@given(paths(), vectors)
def test_distance_is_the_smallest_one(path: SinePath, point: Floats) -> None:
    """Far beyond the centre of curvature too, where Newton's method for the foot point runs away."""
    points = dense(path, 100_001)[1]
    smallest = np.linalg.norm(points - point, axis=1).min()
    assert path.distance_m(point)[0] == pytest.approx(smallest, rel=1e-6, abs=5e-6 * path.length_m)


# ---- steps and targets


@pytest.mark.parametrize(
    ("length", "speed", "dt", "steps"),
    [
        (0.122, 0.01, 0.01, 1220),
        (0.122, 0.01, 0.001, 12_200),
        (0.122, 0.01, 0.0012, 10_167),  # 10166.67
        (0.122, 0.01, 0.03, 407),  # 406.67
        (0.03, 0.01, 0.01, 300),
        (0.0001, 0.01, 0.01, 1),
        (0.00011, 0.01, 0.01, 2),
        (1e-6, 1.0, 0.1, 1),
        (0.1 + 1e-13, 0.01, 0.01, 1000),
        (0.1 + 1e-9, 0.01, 0.01, 1001),
    ],
)
def test_step_count(length: float, speed: float, dt: float, steps: int) -> None:
    assert step_count(length, speed, dt) == steps


@pytest.mark.slow
@settings(max_examples=examples(300))
@given(st.integers(1, 1_000_000), st.integers(1, 10_000), st.integers(1, 1000))
def test_an_exact_quotient_is_not_rounded_up(steps: int, speed_um_s: int, dt_tenth_ms: int) -> None:
    speed, dt = speed_um_s * 1e-6, dt_tenth_ms * 1e-4
    assert step_count(steps * speed * dt, speed, dt) == steps
    assert step_count(speed * steps * dt * (1 + 1e-7), speed, dt) == steps + math.ceil(steps * 1e-7 - 1e-9 * steps)


@pytest.mark.slow
@every
@pytest.mark.parametrize("dt", [0.001, 0.01, 0.03])
def test_targets_slide_at_constant_speed_and_stop_at_the_end(path: SinePath, dt: float) -> None:
    steps = step_count(path.length_m, 0.01, dt)
    points = targets(path, speed_m_s=0.01, dt_s=dt, steps=steps)
    assert points.shape == (steps + 1, 3)
    np.testing.assert_allclose(points[0], path.entry_m, atol=1e-15)
    np.testing.assert_allclose(points[-1], path.curve(np.ones(1))[0], atol=1e-10)
    u, _, lengths = dense(path)
    walked = np.interp(path.parameter(0.01 * dt * np.arange(steps + 1, dtype=np.float64)), u, lengths)
    np.testing.assert_allclose(np.diff(walked)[:-1], 0.01 * dt, rtol=1e-3)
    assert 0.0 < np.diff(walked)[-1] <= 0.01 * dt * (1 + 1e-3)


def test_targets_beyond_the_last_step_wait_at_the_end() -> None:
    points = targets(PATHS["line"], speed_m_s=0.1, dt_s=0.1, steps=50)
    np.testing.assert_allclose(points[13:], np.broadcast_to(END, (38, 3)), atol=1e-15)


# ---- noise


def noise(dt: float, *, duration: float = 0.6, seed: int = 5, amplitude: float = 0.25e-3) -> Floats:
    steps = round(duration / dt)
    return held_noise(np.random.default_rng(seed), amplitude_m=amplitude, hold_s=0.01, dt_s=dt, steps=steps)


@pytest.mark.parametrize("dt", [0.0001, 0.001, 0.0012, 0.0025, 0.003, 0.005, 0.01, 0.02, 0.03, 0.1])
def test_noise_belongs_to_time_windows_whatever_the_step(dt: float) -> None:
    by_window = noise(0.01)
    found = noise(dt)
    tenth_ms = round(dt * 1e4)
    for i, row in enumerate(found):  # in whole tenths of a millisecond: no rounding
        np.testing.assert_array_equal(row, by_window[i * tenth_ms // 100])


def test_noise_is_redrawn_in_every_window() -> None:
    by_window = noise(0.01)
    assert len(np.unique(by_window, axis=0)) == len(by_window) == 61
    assert len(np.unique(noise(0.0012), axis=0)) == 61


def test_noise_at_any_length_begins_the_same() -> None:
    np.testing.assert_array_equal(noise(0.01, duration=0.3), noise(0.01, duration=9.0)[:31])


def test_noise_is_uniform_within_its_bounds() -> None:
    values = noise(0.01, duration=300.0, amplitude=2e-3)
    assert np.abs(values).max() <= 2e-3
    assert np.abs(values).max() > 0.999 * 2e-3
    np.testing.assert_allclose(values.mean(axis=0), 0.0, atol=5 * 2e-3 / math.sqrt(3 * len(values)))
    np.testing.assert_allclose(values.std(axis=0), 2e-3 / math.sqrt(3), rtol=0.02)
    assert np.abs(np.corrcoef(values.T) - np.eye(3)).max() < 5 / math.sqrt(len(values))


def test_noise_comes_from_its_seed_alone() -> None:
    np.testing.assert_array_equal(noise(0.01, seed=3), noise(0.01, seed=3))
    assert not np.array_equal(noise(0.01, seed=3), noise(0.01, seed=4))
    assert not np.array_equal(noise(0.01, seed=2**53 - 1), noise(0.01, seed=2**53 - 2))


def test_no_amplitude_draws_nothing() -> None:
    rng = np.random.default_rng(1)
    assert not held_noise(rng, amplitude_m=0.0, hold_s=0.01, dt_s=0.01, steps=100).any()
    assert rng.random() == np.random.default_rng(1).random()
