"""The time series of a run: gathered record by record, then arrays (SI units) and their summaries."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from simcore.linear_algebra.products import norm, times
from simcore.rollout.authority import authority_arrays
from simcore.rollout.result import DERIVED, FRAMES, TIMES

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from simcore.arrays import Floats
    from simcore.rollout.records import Scene, StepRecord

_COPIED = (
    "t_s",
    "base_position_m",
    "base_rotation",
    "tip_m",
    "tip_seen_m",
    "target_m",
    "target_noisy_m",
    "command_position_m",
    "command_rotation",
    "limited",
    "depth_m",
    "base_force_n",
    "base_torque_nm",
    "insertion_force_n",
    "rcm_error_m",
    "iterations",
    "residual_n",
    "violation_m",
    "min_det_f",
    "max_displacement_m",
    *DERIVED,
)


class SeriesBuilder:
    """Row 0 is the initial state, row i the state after step i."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.rows: dict[str, list[Any]] = {name: [] for name in (*_COPIED, *TIMES)}
        self.lateral_sum_n: list[float] = []
        self.lateral_resultant_n: list[float] = []
        self.frames: list[StepRecord] = []

    def add(self, record: StepRecord, recording_s: float) -> None:
        """Take one record; the records of a run own their arrays."""
        for name in _COPIED:
            self.rows[name].append(getattr(record, name))
        for name in TIMES[:-1]:
            self.rows[name].append(getattr(record.timing, name))
        self.rows["recording_s"].append(recording_s)
        lateral = lateral_forces(record)
        self.lateral_sum_n.append(float(np.linalg.norm(lateral, axis=1).sum()))
        self.lateral_resultant_n.append(norm(lateral.sum(axis=0)))
        if record.tissue_m is not None:
            self.frames.append(record)

    def arrays(self, last: StepRecord, authority: list[Floats]) -> dict[str, NDArray[Any]]:
        """The content of series.npz. last: the last good state as a frame, which is always the last one.

        authority: of each state that the controller was asked in, (2, 2), from row 0 on.
        """
        last_step = len(self.rows["t_s"]) - 1
        frames = self.frames if self.frames[-1].step == last_step else [*self.frames, last]
        return {
            **{name: np.array(values) for name, values in self.rows.items()},
            "lateral_sum_n": np.array(self.lateral_sum_n),
            "lateral_resultant_n": np.array(self.lateral_resultant_n),
            **authority_arrays(authority, last_step + 1),
            "tissue_rest_m": self.scene.tissue_rest_m,
            "tissue_tets": self.scene.tissue_tets,
            **frame_arrays(frames),
        }

    def timing(self, *, wall_s: float, simulated_s: float) -> dict[str, Any]:
        """Median, p95, p99 and maximum in ms of each part of a step, and the real-time factor of the loop."""
        parts = {name.removesuffix("_s"): summary_ms(self.rows[name][1:]) for name in TIMES}
        factor = simulated_s / wall_s if wall_s > 0.0 else None
        return {**parts, "loop_wall_s": wall_s, "simulated_s": simulated_s, "realtime_factor": factor}

    def solver(self) -> dict[str, Any]:
        """Iterations, residuals and violations over the steps; how many nodes were held."""
        iterations = self.rows["iterations"][1:] or [0]
        return {
            "iterations_mean": float(np.mean(iterations)),
            "iterations_max": int(np.max(iterations)),
            "residual_max_n": float(np.max(self.rows["residual_n"])),
            "violation_max_m": float(np.max(self.rows["violation_m"])),
            "held_nodes": len(self.scene.held_nodes),
        }


def frame_arrays(records: list[StepRecord]) -> dict[str, NDArray[Any]]:
    """The arrays of FRAMES; rows of contact points beyond those of a state are NaN."""
    values = (
        np.array([record.tissue_m for record in records]),
        np.array([record.step for record in records]),
        np.array([record.shaft_m for record in records]),
        _padded([record.points_m for record in records]),
        _padded([record.point_forces_n for record in records]),
        np.array([record.strain_energy_j for record in records]),
        np.array([record.max_von_mises_pa for record in records]),
    )
    return dict(zip(FRAMES, values, strict=True))


def _padded(parts: list[Floats]) -> Floats:
    """(frames, most, 3) of arrays (m, 3)."""
    out = np.full((len(parts), max((len(part) for part in parts), default=0), 3), np.nan)
    for row, part in zip(out, parts, strict=True):
        row[: len(part)] = part
    return out


def lateral_forces(record: StepRecord) -> Floats:
    """(a, 3) N: point forces across the straight line from base to tip."""
    axis = record.tip_m - record.base_position_m
    axis = axis / norm(axis)
    across: Floats = record.point_forces_n - np.outer(times(record.point_forces_n, axis), axis)
    return across


def summary_ms(seconds: list[float]) -> dict[str, float | None]:
    """Median, p95, p99, maximum in milliseconds; None where there was no step."""
    if not seconds:
        return dict.fromkeys(("median_ms", "p95_ms", "p99_ms", "max_ms"))
    values = 1e3 * np.array(seconds)
    p95, p99 = np.percentile(values, [95, 99])
    return {
        "median_ms": float(np.median(values)),
        "p95_ms": float(p95),
        "p99_ms": float(p99),
        "max_ms": float(values.max()),
    }
