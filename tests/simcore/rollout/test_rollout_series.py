"""The series of a run: names, shapes, units, and what the controllers make of them."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pytest

from simcore.errors import Status
from simcore.rollout.authority import AUTHORITY
from simcore.rollout.result import TIMES
from simcore.rollout.rollout import run
from simcore.rollout.series import SeriesBuilder, summary_ms
from simcore.rotations import log_map, matrix_from_quaternion
from tests.simcore.short_run import LINE, STEPS, replay, short

if TYPE_CHECKING:
    from simcore.rollout.result import Rollout


@pytest.fixture(scope="module")
def plain() -> Rollout:
    return run(short())


def test_series_names_shapes_and_types(plain: Rollout) -> None:
    rows, nodes = STEPS + 1, 3 * 5 * 5
    shapes = {
        "t_s": (rows,),
        "base_position_m": (rows, 3),
        "base_rotation": (rows, 4),
        "tip_m": (rows, 3),
        "tip_seen_m": (rows, 3),
        "target_m": (rows, 3),
        "target_noisy_m": (rows, 3),
        "command_position_m": (rows, 3),
        "command_rotation": (rows, 4),
        "limited": (rows,),
        "depth_m": (rows,),
        "base_force_n": (rows, 3),
        "base_torque_nm": (rows, 3),
        "insertion_force_n": (rows,),
        "rcm_error_m": (rows,),
        "iterations": (rows,),
        "residual_n": (rows,),
        "violation_m": (rows,),
        "min_det_f": (rows,),
        "min_det_f_at_m": (rows, 3),
        "max_displacement_m": (rows,),
        "max_strain": (rows,),
        "entry_drag_m": (rows,),
        "needle_stress_pa": (rows,),
        "lateral_sum_n": (rows,),
        "lateral_resultant_n": (rows,),
        "plant_s": (rows,),
        "jacobian_s": (rows,),
        "command_s": (rows,),
        "recording_s": (rows,),
        "rcm_authority": (rows, 2, 2),
        "rcm_sigma_min": (rows,),
        "tissue_rest_m": (nodes, 3),
        "tissue_tets": (2 * 4 * 4 * 6, 4),
        "tissue_m": (6, nodes, 3),
        "tissue_frame_step": (6,),
        "shaft_m": (6, 25, 3),
        "contact_points_m": (6, 6, 3),
        "contact_forces_n": (6, 6, 3),
        "strain_energy_j": (6,),
        "max_von_mises_pa": (6,),
    }
    assert {name: array.shape for name, array in plain.series.items()} == shapes
    integers = {name for name, array in plain.series.items() if array.dtype.kind == "i"}
    assert integers == {"iterations", "tissue_tets", "tissue_frame_step"}
    assert plain.series["limited"].dtype == bool
    padded = {"contact_points_m", "contact_forces_n"}
    assert all(np.isfinite(array).all() for name, array in plain.series.items() if name not in {*AUTHORITY, *padded})


def test_frames_have_the_needle_and_its_contacts(plain: Rollout) -> None:
    """The shaft ends at base and tip; the forces on the tissue add up to the base's; strained tissue stores energy."""
    series = plain.series
    steps = series["tissue_frame_step"]
    np.testing.assert_allclose(series["shaft_m"][:, 0], series["base_position_m"][steps], atol=1e-12)
    np.testing.assert_allclose(series["shaft_m"][:, -1], series["tip_m"][steps], atol=1e-12)
    points, forces = series["contact_points_m"], series["contact_forces_n"]
    assert np.array_equal(np.isnan(points), np.isnan(forces))
    counts = (~np.isnan(points[:, :, 0])).sum(axis=1)
    assert (np.diff(counts) >= 0).all()
    assert counts[-1] == points.shape[1]
    np.testing.assert_allclose(np.nansum(forces, axis=1)[-1], series["base_force_n"][-1], atol=1e-4)
    assert series["strain_energy_j"][0] == pytest.approx(0.0, abs=1e-12)
    assert (np.diff(series["strain_energy_j"]) > 0.0).all()
    assert series["max_von_mises_pa"][-1] > 100.0


def test_times_are_summed_up_in_milliseconds_without_the_row_before_the_first_step() -> None:
    seconds = [0.001 * (i + 1) for i in range(101)]
    assert summary_ms(seconds) == pytest.approx({"median_ms": 51, "p95_ms": 96, "p99_ms": 100, "max_ms": 101})
    assert set(summary_ms([]).values()) == {None}
    builder = SeriesBuilder.__new__(SeriesBuilder)
    builder.rows = {name: [9.0, 0.001, 0.003] for name in TIMES}
    timing = builder.timing(wall_s=0.5, simulated_s=2.0)
    for name in TIMES:
        assert (timing[name.removesuffix("_s")]["median_ms"], timing[name.removesuffix("_s")]["max_ms"]) == (2.0, 3.0)
    assert timing["realtime_factor"] == 4.0
    assert builder.timing(wall_s=0.0, simulated_s=2.0)["realtime_factor"] is None


def test_row_0_is_the_initial_state(plain: Rollout) -> None:
    series = plain.series
    entry = np.array([0.012, 0.02, 0.0])
    np.testing.assert_allclose(series["tip_m"][0], entry, atol=1e-15)
    np.testing.assert_allclose(series["target_m"][0], entry, atol=1e-15)
    axis = matrix_from_quaternion(series["base_rotation"][0])[:, 2]
    np.testing.assert_allclose(axis, short().path().first_tangent(), atol=1e-14)
    np.testing.assert_allclose(series["base_position_m"][0], entry - 0.08 * axis, atol=1e-15)
    np.testing.assert_array_equal(series["command_position_m"][0], series["base_position_m"][0])
    np.testing.assert_array_equal(series["tissue_m"][0], series["tissue_rest_m"])
    for name in ("t_s", "depth_m", "max_displacement_m", "insertion_force_n", "limited", "plant_s", "recording_s"):
        assert series[name][0] == 0, name


def test_values_are_si_and_consistent(plain: Rollout) -> None:
    s = plain.series
    np.testing.assert_allclose(s["t_s"], 0.1 * np.arange(STEPS + 1), atol=1e-12)
    np.testing.assert_allclose(s["target_m"][-1], [0.012, 0.022, 0.04], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(s["base_rotation"], axis=1), 1.0, atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(s["command_rotation"], axis=1), 1.0, atol=1e-14)
    assert 0.03 < s["depth_m"].max() < 0.05
    assert 0.1 < s["insertion_force_n"].max() < 5.0
    assert 0.1e-3 < s["max_displacement_m"].max() < 0.02
    assert s["residual_n"].max() <= 1e-5
    assert s["violation_m"].max() <= 1e-8
    assert 0.1 < s["min_det_f"].min() <= 1.0
    assert (s["iterations"][1:] >= 1).all()
    axes = np.array([matrix_from_quaternion(q)[:, 2] for q in s["base_rotation"]])
    np.testing.assert_allclose(s["insertion_force_n"], np.einsum("ij,ij->i", s["base_force_n"], axes), atol=1e-12)
    moved = np.linalg.norm(s["tissue_m"][-1] - s["tissue_rest_m"], axis=1).max()
    assert moved == pytest.approx(s["max_displacement_m"][-1])
    fixed = np.isin(s["tissue_rest_m"][:, 1], [0.0, s["tissue_rest_m"][:, 1].max()])
    np.testing.assert_array_equal(s["tissue_m"][-1][fixed], s["tissue_rest_m"][fixed])
    assert (s["lateral_sum_n"] >= s["lateral_resultant_n"] - 1e-12).all()


def test_the_robots_limits_hold_in_the_series() -> None:
    s = run(short(robot={"max_speed_mm_s": 12.0, "max_turn_deg_s": 2.0})).series
    shifts = np.linalg.norm(np.diff(s["base_position_m"], axis=0), axis=1)
    rotations = [matrix_from_quaternion(q) for q in s["base_rotation"]]
    turns = [np.linalg.norm(log_map(after @ before.T)) for before, after in pairwise(rotations)]
    assert shifts.max() <= 12e-3 * 0.1 * (1 + 1e-9)
    assert max(turns) <= math.radians(2.0) * 0.1 * (1 + 1e-6)
    assert s["limited"].sum() > 0
    free = ~s["limited"]
    np.testing.assert_allclose(s["base_position_m"][free], s["command_position_m"][free], atol=1e-15)


@pytest.mark.slow
def test_the_path_of_the_tissue_moves_with_it() -> None:
    world, tissue = run(short(noise_mm=0.0)), run(short(noise_mm=0.0, trajectory={"frame": "tissue"}))
    assert tissue.status is Status.COMPLETED
    apart = np.linalg.norm(tissue.series["target_m"] - world.series["target_m"], axis=1)
    assert apart[0] < 1e-12
    assert apart.max() > 1e-5


# ---- the controllers in the loop


def test_open_loop_commands_a_straight_line() -> None:
    s = run(short(controller={"kind": "open_loop"})).series
    axis = np.array([0.0, 2.0, 40.0]) / math.hypot(2.0, 40.0)
    np.testing.assert_allclose(matrix_from_quaternion(s["command_rotation"][-1])[:, 2], axis, atol=1e-12)
    away = s["command_position_m"][1:] - [0.012, 0.02, 0.0]
    np.testing.assert_allclose(np.cross(away, axis), 0.0, atol=1e-12)


def test_steering_beats_open_loop(plain: Rollout) -> None:
    blind = run(short(controller={"kind": "open_loop"}))
    assert plain.metrics["rmse_commanded_mm"] < 0.7 * blind.metrics["rmse_commanded_mm"]


def test_replay_is_as_long_as_its_poses_and_not_limited() -> None:
    poses = [[12.0, 20.0, -80.0 + 0.5 * (i + 1), 1.0, 0.0, 0.0, 0.0] for i in range(17)]
    found = run(short(controller=replay(poses), robot={"max_speed_mm_s": 0.1}, trajectory=LINE))
    assert found.status is Status.COMPLETED
    s = found.series
    assert len(s["t_s"]) == 18
    np.testing.assert_allclose(s["base_position_m"][1:] * 1e3, np.array(poses)[:, :3], atol=1e-12)
    np.testing.assert_allclose(s["base_rotation"][1:], np.array(poses)[:, 3:], atol=1e-15)
    assert not s["limited"].any()


@pytest.mark.slow
def test_replay_of_a_run_is_that_run() -> None:
    """The recorded base poses, prescribed, give the same states but for rounding of the poses."""
    made = run(short(noise_mm=0.0)).series
    poses = np.hstack([made["base_position_m"][1:] * 1e3, made["base_rotation"][1:]]).tolist()
    again = run(short(noise_mm=0.0, controller=replay(poses))).series
    np.testing.assert_allclose(again["tip_m"], made["tip_m"], atol=1e-9)
    np.testing.assert_allclose(again["base_force_n"], made["base_force_n"], atol=1e-3)
