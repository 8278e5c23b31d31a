"""The metrics on series that were worked by hand, on a straight path along z at 0.1 mm a step."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from simcore.errors import Status
from simcore.metrics import MEASURED, lambda_ratio, longest_loss_s, metrics, root_mean_square
from simcore.trajectory import SinePath

PATH = SinePath(np.zeros(3), np.array([0.0, 0.0, 0.1]))
STEP_M = 1e-4

Series = dict[str, np.ndarray]


def series(offsets_mm: list[list[float]], **columns: Any) -> Series:
    """Row 0 at the entry; after step i the tip is at target i plus an offset (3,) mm."""
    rows = len(offsets_mm) + 1
    target = np.outer(np.arange(rows) * STEP_M, [0.0, 0.0, 1.0])
    tip = target + 1e-3 * np.array([[0.0, 0.0, 0.0], *offsets_mm])
    base = {
        "t_s": 0.01 * np.arange(rows),
        "tip_m": tip,
        "target_m": target,
        "rcm_error_m": np.zeros(rows),
        "insertion_force_n": np.zeros(rows),
        "base_force_n": np.zeros((rows, 3)),
        "entry_drag_m": np.zeros(rows),
        "max_strain": np.zeros(rows),
        "needle_stress_pa": np.zeros(rows),
        "max_displacement_m": np.zeros(rows),
        "min_det_f": np.ones(rows),
        "lateral_sum_n": np.zeros(rows),
        "lateral_resultant_n": np.zeros(rows),
        "limited": np.zeros(rows, bool),
    }
    return {**base, **{name: np.array(values) for name, values in columns.items()}}


def judged(
    found: Series, status: Status = Status.COMPLETED, *, dt_s: float = 0.01, steps: int = -1, success_mm: float = 2.0
) -> dict[str, Any]:
    done = len(found["t_s"]) - 1
    steps = done if steps < 0 else steps
    return metrics(status, found, PATH, dt_s=dt_s, steps=steps, success_mm=success_mm, yield_mpa=1030.0)


def offsets(errors_mm: list[float]) -> list[list[float]]:
    """Lateral offsets that make the paper's error of step i exactly errors_mm[i]: tip i + 1 against target i."""
    return [[error, 0.0, -STEP_M * 1e3] for error in errors_mm]


def test_a_tip_on_the_previous_target_has_no_paper_error_but_the_lag() -> None:
    """n_tip(t_i+1) = n_traj(t_i): the command was followed; the same-time error is one step of 0.1 mm."""
    found = judged(series(offsets([0.0, 0.0, 0.0, 0.0])))
    assert found["rmse_commanded_mm"] == pytest.approx(0.0, abs=1e-13)
    assert found["rmse_same_time_mm"] == pytest.approx(0.1)
    assert found["cross_track_rmse_mm"] == pytest.approx(0.0, abs=1e-7)
    assert found["final_same_time_mm"] == pytest.approx(0.1)


def test_a_tip_on_its_own_target_leads_by_one_step() -> None:
    found = judged(series([[0.0, 0.0, 0.0]] * 3))
    assert found["rmse_commanded_mm"] == pytest.approx(0.1)
    assert found["rmse_same_time_mm"] == 0.0


def test_the_paper_rmse_is_the_mean_over_all_steps() -> None:
    """e = 3, 4, 0, 0 mm: sqrt(25 / 4) = 2.5; row 0, where nothing was executed, does not count."""
    found = judged(series(offsets([3.0, 4.0, 0.0, 0.0])))
    assert found["rmse_commanded_mm"] == pytest.approx(2.5)
    assert found["max_commanded_mm"] == pytest.approx(4.0)
    assert found["cross_track_rmse_mm"] == pytest.approx(2.5)
    assert found["rmse_same_time_mm"] == pytest.approx(math.sqrt(25 / 4 + 0.01))


def test_all_three_axes_count() -> None:
    found = judged(series([[1.0, 2.0, 2.0 - 0.1]]))
    assert found["rmse_commanded_mm"] == pytest.approx(3.0)
    assert found["rmse_same_time_mm"] == pytest.approx(math.sqrt(5 + 1.9**2))
    assert found["cross_track_rmse_mm"] == pytest.approx(math.sqrt(5.0))


def test_the_target_of_a_command_is_the_clean_one_of_its_row() -> None:
    """Targets that jump: tip 1 is judged by target 0, tip 2 by target 1."""
    jump = series([[0.0, 0.0, 0.0]] * 2)
    jump["target_m"] = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 5e-3], [0.0, 0.0, 7e-3]])
    jump["tip_m"] = np.array([[9.0, 9.0, 9.0], [0.0, 0.0, 3e-3], [0.0, 0.0, 9e-3]])
    found = judged(jump)
    assert found["rmse_commanded_mm"] == pytest.approx(math.sqrt((9 + 16) / 2))
    assert found["rmse_same_time_mm"] == pytest.approx(math.sqrt((4 + 4) / 2))
    assert found["final_same_time_mm"] == pytest.approx(2.0)


def test_the_final_error_is_that_at_the_last_target() -> None:
    found = judged(series([[9.0, 0.0, 0.0], [0.0, 9.0, 0.0], [0.3, 0.4, 0.0]]))
    assert found["final_same_time_mm"] == pytest.approx(0.5)


def test_the_95th_percentile() -> None:
    """0, 1, ..., 20 mm: 95 % lies at rank 19 exactly; of 0 to 9 at rank 8.55, interpolated."""
    assert judged(series(offsets([float(e) for e in range(21)])))["p95_commanded_mm"] == pytest.approx(19.0)
    assert judged(series(offsets([float(e) for e in range(10)])))["p95_commanded_mm"] == pytest.approx(8.55)


def test_the_cross_track_error_forgets_where_along_the_path() -> None:
    found = judged(series([[0.6, 0.8, 30.0], [0.6, 0.8, 60.0]]))
    assert found["cross_track_rmse_mm"] == pytest.approx(1.0)
    assert found["rmse_commanded_mm"] > 30.0


def test_remote_centre_force_displacement_and_det() -> None:
    columns = {
        "rcm_error_m": [9.0, 1e-3, 3e-3],
        "insertion_force_n": [0.0, 0.7, -2.0],
        "max_displacement_m": [0.0, 4e-3, 1e-3],
        "min_det_f": [1.0, 0.8, 0.9],
        "limited": [False, True, False],
    }
    found = judged(series([[0.0, 0.0, 0.0]] * 2, **columns))
    assert found["rcm_mean_mm"] == pytest.approx(2.0)  # row 0 is before the first step
    assert found["rcm_max_mm"] == pytest.approx(3.0)
    assert found["max_push_n"] == pytest.approx(0.7)
    assert found["max_tissue_displacement_mm"] == pytest.approx(4.0)
    assert found["min_det_f"] == pytest.approx(0.8)
    assert found["limited_fraction"] == pytest.approx(0.5)


def test_limited_fraction_is_over_steps() -> None:
    found = series([[0.0, 0.0, 0.0]] * 4, limited=[True, True, True, False, False])
    assert judged(found)["limited_fraction"] == pytest.approx(0.5)


# ---- stable, success, lost


def test_a_completed_run_is_stable_and_a_success() -> None:
    found = judged(series(offsets([0.1] * 10)))
    assert found["stable"] is True
    assert found["success"] is True
    assert found["steps_completed"] == found["steps"] == 10


@pytest.mark.parametrize("status", [s for s in Status if s is not Status.COMPLETED])
def test_a_failed_run_is_neither(status: Status) -> None:
    found = judged(series(offsets([0.1] * 10)), status, steps=20)
    assert (found["stable"], found["success"]) == (False, False)
    assert (found["steps_completed"], found["steps"]) == (10, 20)
    assert found["rmse_commanded_mm"] == pytest.approx(0.1)  # of what was done


def test_a_run_that_did_not_reach_the_end_is_no_success() -> None:
    assert judged(series(offsets([0.1] * 10)), steps=11)["success"] is False


def test_a_tip_that_is_not_finite_is_not_stable() -> None:
    found = series(offsets([0.1] * 3))
    found["tip_m"][2, 1] = math.nan
    result = judged(found)
    assert (result["stable"], result["success"]) == (False, False)


@pytest.mark.parametrize(
    ("lost_steps", "dt", "success"),
    [(50, 0.01, True), (51, 0.01, False), (500, 0.001, True), (501, 0.001, False), (5, 0.1, True), (6, 0.1, False)],
)
def test_lost_is_above_two_millimetres_for_more_than_half_a_second(lost_steps: int, dt: float, success: bool) -> None:
    errors = [0.0] * 3 + [2.01] * lost_steps + [0.0] * 3
    found = judged(series(offsets(errors)), dt_s=dt)
    assert found["success"] is success
    assert found["stable"] is True


def test_two_millimetres_exactly_is_not_lost() -> None:
    assert longest_loss_s(np.full(1000, 2.0), 0.01) == 0.0
    assert longest_loss_s(np.full(1000, np.nextafter(2.0, 3.0)), 0.01) == pytest.approx(10.0)


def test_only_an_unbroken_loss_counts() -> None:
    broken = ([3.0] * 50 + [1.0]) * 6
    assert longest_loss_s(np.array(broken), 0.01) == pytest.approx(0.5)
    assert judged(series(offsets(broken)))["success"] is True
    assert longest_loss_s(np.array([]), 0.01) == 0.0


def test_a_loss_at_the_end_counts() -> None:
    assert judged(series(offsets([0.0] * 10 + [2.5] * 51)))["success"] is False


@pytest.mark.parametrize(("end_mm", "allowed_mm", "success"), [(1.9, 2.0, True), (2.1, 2.0, False), (0.3, 0.25, False)])
def test_success_needs_the_end_of_the_path(end_mm: float, allowed_mm: float, success: bool) -> None:
    """At the same time: a command that was followed may still have left the end far away, as at 1000 mm/s."""
    found = series([[0.0, 0.0, 0.0]] * 10 + [[end_mm, 0.0, 0.0]])
    assert judged(found, success_mm=allowed_mm)["success"] is success
    leap = series(offsets([0.0, 0.0]))
    leap["target_m"][-1] = [0.0, 0.0, 0.06]
    assert judged(leap)["rmse_commanded_mm"] == pytest.approx(0.0, abs=1e-12)
    assert judged(leap)["success"] is False


@pytest.mark.parametrize(("stress_pa", "success"), [(1029e6, True), (1030e6, False)])
def test_a_needle_that_would_yield_is_no_success(stress_pa: float, success: bool) -> None:
    found = judged(series(offsets([0.1] * 3), needle_stress_pa=[0.0, stress_pa, 0.0, 0.0]))
    assert (found["stable"], found["success"]) == (True, success)
    assert found["max_needle_stress_mpa"] == pytest.approx(1e-6 * stress_pa)


def test_both_families_of_errors_and_the_forces_beside_them() -> None:
    columns = {
        "base_force_n": [[9.0, 9.0, 9.0], [0.3, 0.4, 2.0], [0.0, 0.1, -1.0]],
        "insertion_force_n": [9.0, 2.0, -1.0],
        "entry_drag_m": [0.0, 3e-3, 1e-3],
        "max_strain": [0.0, 0.1, 0.2],
    }
    found = judged(series([[0.0, 0.0, 0.0], [3.0, 4.0, 0.0]], **columns))
    assert found["max_lateral_n"] == pytest.approx(0.5)  # row 0 is before the first step
    assert found["entry_drag_mm"] == pytest.approx(3.0)
    assert found["max_strain"] == 0.2
    assert found["max_same_time_mm"] == found["final_same_time_mm"] == pytest.approx(5.0)
    assert found["final_commanded_mm"] == found["max_commanded_mm"] == pytest.approx(math.hypot(5.0, 0.1))


# ---- the ratio of lateral forces


def test_lambda_ratio_is_the_median_over_loaded_steps() -> None:
    found = series(
        [[0.0, 0.0, 0.0]] * 4,
        lateral_sum_n=[0.0, 0.005, 1.0, 2.0, 6.0],
        lateral_resultant_n=[0.0, 0.001, 1.0, 1.0, 2.0],
    )
    assert lambda_ratio(found) == pytest.approx(2.0)  # of 1, 2 and 3; 5 mN is no load


def test_lambda_ratio_is_none_without_load() -> None:
    unloaded = series([[0.0, 0.0, 0.0]] * 2, lateral_sum_n=[0.0, 0.01, 0.009], lateral_resultant_n=[0.0, 0.01, 0.001])
    assert lambda_ratio(unloaded) is None
    cancelled = series([[0.0, 0.0, 0.0]], lateral_sum_n=[0.0, 5.0], lateral_resultant_n=[0.0, 0.0])
    assert lambda_ratio(cancelled) is None


# ---- no step at all


@pytest.mark.parametrize("status", list(Status))
def test_a_run_without_steps_measures_nothing(status: Status) -> None:
    found = judged(series([]), status, steps=7)
    assert found["success"] is False
    assert found["steps_completed"] == 0
    assert {name: found[name] for name in MEASURED} == dict.fromkeys(MEASURED)


def test_the_same_names_with_and_without_steps() -> None:
    some, none = judged(series(offsets([0.1]))), judged(series([]), Status.NOT_CONVERGED, steps=1)
    assert some.keys() == none.keys()
    assert all(isinstance(value, bool | int | float | None) for value in some.values())


def test_root_mean_square() -> None:
    assert root_mean_square(np.array([3.0, -4.0])) == pytest.approx(math.sqrt(12.5))
