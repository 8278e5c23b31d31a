"""What a run is judged by. All errors use the clean target; definitions after Perrusi et al. 2021 where tagged [paper].

`stable` (finite, every step converged, no inversion: the paper's S) and `success` are two things. Success is stable,
reached the last step, never more than 2 mm from the target of a path for more than 0.5 s, within `success_mm` of the
end after the last step, and a needle that stays below its yield stress.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from simcore.errors import Status

if TYPE_CHECKING:
    from simcore.arrays import Floats
    from simcore.trajectory import Path

Series = Mapping[str, NDArray[Any]]

LOST_ERROR_MM = 2.0
LOST_TIME_S = 0.5
FORCE_FLOOR_N = 0.01  # below it the ratio of summed to resultant lateral force says nothing
MEASURED = (
    "rmse_commanded_mm",
    "p95_commanded_mm",
    "max_commanded_mm",
    "final_commanded_mm",
    "rmse_same_time_mm",
    "p95_same_time_mm",
    "max_same_time_mm",
    "final_same_time_mm",
    "cross_track_rmse_mm",
    "rcm_mean_mm",
    "rcm_max_mm",
    "entry_drag_mm",
    "max_push_n",
    "max_lateral_n",
    "max_tissue_displacement_mm",
    "max_strain",
    "min_det_f",
    "max_needle_stress_mpa",
    "lambda_ratio",
    "limited_fraction",
)


def root_mean_square(values: Floats) -> float:
    """sqrt(mean(v^2))."""
    return float(np.sqrt(np.mean(np.square(values))))


def commanded_errors_mm(series: Series) -> Floats:
    """|e_i| (Np,) mm with e_i = n_tip(t_i+1) - n_traj(t_i), i = 0 ... Np - 1 [paper]: each step against the target that
    was used for the command executed in it."""
    errors: Floats = 1e3 * np.linalg.norm(series["tip_m"][1:] - series["target_m"][:-1], axis=1)
    return errors


def same_time_errors_mm(series: Series) -> Floats:
    """|n_tip(t_i) - n_traj(t_i)| (Np,) mm, i = 1 ... Np: contains the lag of one step."""
    errors: Floats = 1e3 * np.linalg.norm(series["tip_m"][1:] - series["target_m"][1:], axis=1)
    return errors


def longest_loss_s(errors_mm: Floats, dt_s: float) -> float:
    """Longest unbroken time with an error above 2 mm."""
    longest = run = 0
    for lost in errors_mm > LOST_ERROR_MM:
        run = run + 1 if lost else 0
        longest = max(longest, run)
    return longest * dt_s


def lateral_push_n(series: Series) -> Floats:
    """(Np,) N: magnitude of the robot's force across the base's axis, that along it being `insertion_force_n`."""
    whole = np.square(series["base_force_n"][1:]).sum(axis=1)
    across: Floats = np.sqrt(np.maximum(whole - np.square(series["insertion_force_n"][1:]), 0.0))
    return across


def lambda_ratio(series: Series) -> float | None:
    """Median over steps of sum |lambda_n| / |sum lambda_n|: large where neighbouring rows fight (locking); None if the
    lateral load never exceeds 0.01 N."""
    total, resultant = series["lateral_sum_n"], series["lateral_resultant_n"]
    loaded = (total > FORCE_FLOOR_N) & (resultant > 0.0)
    return float(np.median(total[loaded] / resultant[loaded])) if loaded.any() else None


def metrics(
    status: Status,
    series: Series,
    path: Path | None,
    *,
    dt_s: float,
    steps: int,
    success_mm: float,
    yield_mpa: float,
    cross_track_m: Floats | None = None,
) -> dict[str, Any]:
    """The metrics block of a result; every measure is None if not one step was completed.

    path: None = there is a target only, which has no cross-track error and is lost at no time.
    success_mm: how near the tip must end to the end of the path. yield_mpa: stress that the needle must stay below.
    cross_track_m: (done,) m, distance of the tip from the path after each step where the tissue carries the path; None
    = the path is fixed in space, and the distances follow from it.
    """
    done = len(series["t_s"]) - 1
    stable = status is Status.COMPLETED and bool(np.isfinite(series["tip_m"]).all())
    values: dict[str, Any] = {"stable": stable, "success": False, "steps_completed": done, "steps": steps}
    if done == 0:
        return {**values, **dict.fromkeys(MEASURED)}
    commanded, same_time = commanded_errors_mm(series), same_time_errors_mm(series)
    if cross_track_m is None and path is not None:
        cross_track_m = path.distance_m(series["tip_m"][1:])
    rcm = 1e3 * series["rcm_error_m"][1:]
    stress_mpa = float(1e-6 * series["needle_stress_pa"].max())
    kept = path is None or longest_loss_s(commanded, dt_s) <= LOST_TIME_S
    followed = done == steps and kept and same_time[-1] <= success_mm
    return {
        **values,
        "success": bool(stable and followed and stress_mpa < yield_mpa),
        **_family(commanded, "commanded"),
        **_family(same_time, "same_time"),
        "cross_track_rmse_mm": None if cross_track_m is None else root_mean_square(1e3 * cross_track_m),
        "rcm_mean_mm": float(rcm.mean()),
        "rcm_max_mm": float(rcm.max()),
        "entry_drag_mm": float(1e3 * series["entry_drag_m"].max()),
        "max_push_n": float(series["insertion_force_n"].max()),
        "max_lateral_n": float(lateral_push_n(series).max()),
        "max_tissue_displacement_mm": float(1e3 * series["max_displacement_m"].max()),
        "max_strain": float(series["max_strain"].max()),
        "min_det_f": float(series["min_det_f"].min()),
        "max_needle_stress_mpa": stress_mpa,
        "lambda_ratio": lambda_ratio(series),
        "limited_fraction": float(series["limited"][1:].mean()),
    }


def _family(errors_mm: Floats, name: str) -> dict[str, float]:
    return {
        f"rmse_{name}_mm": root_mean_square(errors_mm),
        f"p95_{name}_mm": float(np.percentile(errors_mm, 95)),
        f"max_{name}_mm": float(errors_mm.max()),
        f"final_{name}_mm": float(errors_mm[-1]),
    }
