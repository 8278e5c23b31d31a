"""A path in the tissue frame: its target is a material point, and its cross-track error is against the carried path."""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from simcore.rollout.recorder import material_path
from simcore.rollout.rollout import run
from simcore.scenario.build import insertion_of
from simcore.trajectory import polyline_distance_m
from tests.simcore.block import Vector, block_scenario, moved

if TYPE_CHECKING:
    from simcore.rollout.result import Rollout

BREATH = {"kind": "breathing", "amplitude_mm": 6.0, "period_s": 4.0}
TARGET_MM = [14.0, 23.0, 30.0]


@cache
def breathing_run(frame: str) -> Rollout:
    """An oblique insertion of 30 mm in 3 s while the tissue goes to and fro by 12 mm; every tissue state is kept."""
    return run(
        block_scenario(
            tissue={"element_size_mm": 8.0},
            trajectory={"target_mm": TARGET_MM, "frame": frame},
            motion=BREATH,
            solver={"force_tolerance_n": 1e-6, "violation_tolerance_mm": 1e-6},
            recording={"every_steps": 1},
        )
    )


def carried(rollout: Rollout, points_m: Vector) -> Vector:
    """(steps + 1, k, 3) m: material points over the run, found by trying every tetrahedron."""
    series = rollout.series
    rest, tets = series["tissue_rest_m"], series["tissue_tets"]
    edges = np.swapaxes(rest[tets[:, 1:]] - rest[tets[:, :1]], 1, 2)
    places = []
    for point in points_m:
        three = np.linalg.solve(edges, (point - rest[tets[:, 0]])[:, :, None])[:, :, 0]
        shape = np.column_stack([1.0 - three.sum(axis=1), three])
        best = np.argmax(shape.min(axis=1))
        assert shape[best].min() > -1e-9
        places.append(np.einsum("a,sai->si", shape[best], series["tissue_m"][:, tets[best]]))
    return np.stack(places, axis=1)


def path_points(rollout: Rollout, count: int) -> Vector:
    return rollout.scenario.path().point(np.linspace(0.0, rollout.scenario.path().length_m, count))


def test_without_a_needle_the_carried_point_breathes() -> None:
    """Rigid translation: every material point moves with the held faces."""
    breath = {**BREATH, "period_s": 0.5, "direction": [1.0, 2.0, 3.0]}
    scenario = block_scenario(motion=breath, interaction={"puncture_n": 0.1})
    insertion = insertion_of(scenario)
    path = material_path(insertion, scenario.path())
    state = insertion.initial_state(np.array([0.0, 0.0, 1.0]))
    away = moved(state.base, np.array([0.0, 0.0, -0.04]))
    point = np.array([0.013, 0.017, 0.031])
    assert insertion.motion is not None
    for i in range(1, 20):
        state = insertion.step(state, away)
        shift = insertion.motion.shift_m(0.01 * i)
        end = path.positions(state.bodies.x, insertion.tissue.mesh.nodes_m)[-1]
        np.testing.assert_allclose(insertion.material_point_position(state.bodies.x, point), point + shift, atol=1e-14)
        np.testing.assert_allclose(end - shift, [0.012, 0.02, 0.06], atol=1e-14)


@pytest.mark.slow
def test_the_target_in_the_tissue_frame_is_a_material_point() -> None:
    """Row i of the series is the rest target i where the tissue of row i has it, for the needle-deformed tissue too."""
    rollout = breathing_run("tissue")
    count = len(rollout.series["t_s"])
    at_rest = rollout.scenario.path().point(0.01 * 0.01 * np.arange(count, dtype=np.float64))
    expected = carried(rollout, at_rest)[np.arange(count), np.arange(count)]
    np.testing.assert_allclose(rollout.series["target_m"], expected, atol=1e-12)
    assert (rollout.series["tissue_frame_step"] == np.arange(count)).all()
    assert np.abs(expected - at_rest).max() > 0.01


@pytest.mark.slow
def test_the_target_in_the_world_frame_stays() -> None:
    rollout = breathing_run("world")
    count = len(rollout.series["t_s"])
    at_rest = rollout.scenario.path().point(0.01 * 0.01 * np.arange(count, dtype=np.float64))
    np.testing.assert_allclose(rollout.series["target_m"], at_rest, atol=1e-15)
    assert np.abs(rollout.series["tissue_m"] - rollout.series["tissue_rest_m"]).max() > 0.01


@pytest.mark.slow
@pytest.mark.parametrize(("frame", "rmse_commanded_mm"), [("world", 0.1), ("tissue", 0.7)])
def test_inverse_fem_tracks_either(frame: str, rmse_commanded_mm: float) -> None:
    """12 mm of breathing, a needle that keeps on the target to a fraction of it. In the tissue frame the tip drags the
    very point that it is to reach, which costs more."""
    metrics = breathing_run(frame).metrics
    assert metrics["success"]
    assert metrics["rmse_commanded_mm"] < rmse_commanded_mm


@pytest.mark.slow
def test_both_frames_are_the_same_path_at_rest() -> None:
    """The first rows agree: nothing has moved yet."""
    world, tissue = breathing_run("world").series, breathing_run("tissue").series
    np.testing.assert_allclose(world["target_m"][0], tissue["target_m"][0], atol=1e-15)
    np.testing.assert_array_equal(world["base_position_m"][0], tissue["base_position_m"][0])


def segment_distance(point: Vector, line: Vector) -> float:
    """Least distance from 2,000 points of each piece of a polyline (k, 3)."""
    shares = np.linspace(0.0, 1.0, 2000)[:, None]
    pieces = np.concatenate([a + shares * (b - a) for a, b in pairwise(line)])
    return float(np.sqrt(np.sum((pieces - point) ** 2, axis=1).min()))


@pytest.mark.slow
def test_cross_track_is_measured_against_the_carried_path() -> None:
    """Rebuilt from the recorded tissue states; the path at rest, which the tip has left by 12 mm, would be wrong."""
    rollout = breathing_run("tissue")
    tips, lines = rollout.series["tip_m"][1:], carried(rollout, path_points(rollout, 61))[1:]
    errors = [polyline_distance_m(tip, line) for tip, line in zip(tips, lines, strict=True)]
    expected = 1e3 * float(np.sqrt(np.mean(np.square(errors))))
    assert rollout.metrics["cross_track_rmse_mm"] == pytest.approx(expected, rel=0.02)
    assert rollout.metrics["cross_track_rmse_mm"] <= rollout.metrics["rmse_same_time_mm"] + 1e-3
    world = breathing_run("world")
    fixed = world.scenario.path().distance_m(world.series["tip_m"][1:])
    assert world.metrics["cross_track_rmse_mm"] == pytest.approx(1e3 * float(np.sqrt(np.mean(fixed**2))), rel=1e-12)


@pytest.mark.parametrize(
    ("point", "distance"),
    [
        ([0.5, 0.3, 0.0], 0.3),
        ([-3.0, -4.0, 0.0], 5.0),
        ([1.4, 2.5, 0.3], 0.5),
        ([1.0, 1.0, 7.0], 7.0),
        ([0.0, 0.0, 0.0], 0.0),
    ],
)
def test_distance_from_a_polyline(point: list[float], distance: float) -> None:
    """By hand: beside a piece, before the beginning, beside and above the last piece; one piece has no length."""
    line: Any = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 5.0, 0.0]])
    assert polyline_distance_m(np.array(point), line) == pytest.approx(distance, abs=1e-15)
    assert segment_distance(np.array(point), line) == pytest.approx(distance, abs=2e-3)
