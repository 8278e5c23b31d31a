"""A stand-in for the simulation with the shape of a real result: smooth series, quick, as long as its name says."""

from __future__ import annotations

import json
import time
from typing import TYPE_CHECKING, Any

import numpy as np

from service.files.replace_text import replace_text

if TYPE_CHECKING:
    from pathlib import Path

STEPS = 200
SECONDS = {
    "slow": 24.0,
    "lasting": 24.0,
    "brisk": 2.0,
}  # by the first word of the scenario's name; all others take none
STAYS_S = 300.0  # of a lasting one before its last step: until it is cancelled, however busy the machine is


def run_job(spec: dict[str, Any], artefact_dir: Path) -> dict[str, Any]:
    """Pretend to push in along z, with progress, series and a result."""
    scenario = spec["scenario"]
    if scenario["name"] == "broken":
        raise ValueError("asked to break, <b>with tags</b>")
    pause_s = SECONDS.get(scenario["name"].split()[0], 0.0) / STEPS
    soft = scenario["tissue"]["young_kpa"]
    series = _series(scenario["seed"], soft)
    error_mm = 1e3 * np.linalg.norm(series["tip_m"] - series["target_m"], axis=1)
    for step in range(0, STEPS + 1, 10):
        progress = {
            "fraction": step / STEPS,
            "step": step,
            "steps": STEPS,
            "depth_mm": round(1e3 * float(series["depth_m"][step]), 3),
            "tip_error_mm": round(float(error_mm[step]), 4),
            "cross_track_mm": round(0.8 * float(error_mm[step]), 4),
            "insertion_force_n": round(float(series["insertion_force_n"][step]), 4),
            "eta_s": (STEPS - step) * pause_s,
        }
        replace_text(artefact_dir / "progress.json", json.dumps(progress))
        time.sleep(STAYS_S if scenario["name"].startswith("lasting") and step == STEPS - 10 else 10 * pause_s)
    np.savez(artefact_dir / "series.npz", **series)
    if scenario["name"] == "recorded":
        _record(artefact_dir / "recording.rrd", error_mm)
    result = _result(scenario, error_mm)
    (artefact_dir / "result.json").write_text(json.dumps(result))
    return result


def _series(seed: int, soft: float) -> dict[str, Any]:
    along = np.linspace(0.0, 1.0, STEPS + 1)
    wave = 0.3 * np.sin(14 * along + seed) * along / soft + 0.02 * np.cos(90 * along)
    target = np.stack([0.018 + 0 * along, 0.031 + 0 * along, 0.03 * along], axis=1)
    return {
        "t_s": 3.0 * along,
        "depth_m": target[:, 2],
        "target_m": target,
        "tip_m": target + 1e-3 * np.stack([wave, 0.4 * wave, 0 * along], axis=1),
        "insertion_force_n": 0.1 + 1.2 * along + 0.05 * np.sin(40 * along),
        "rcm_error_m": 1e-4 * np.abs(wave),
        "entry_drag_m": 5e-4 * along,
        "shaft_m": np.stack([[0.018, 0.031, z] for z in np.linspace(-0.1, 0.03, 14)])[None],
        "tissue_rest_m": np.array([[0.0, 0.0, 0.0], [0.036, 0.062, 0.127]]),
    }


def _record(path: Path, error_mm: Any) -> None:
    import rerun as rr

    recording = rr.RecordingStream("needle-bench", recording_id="recorded")
    recording.save(path)
    for step, error in enumerate(error_mm):
        recording.set_time("step", sequence=step)
        recording.log("metrics/error", rr.Scalars(error))
    recording.disconnect()


def _result(scenario: dict[str, Any], error_mm: Any) -> dict[str, Any]:
    rmse = float(np.sqrt(np.mean(error_mm**2)))
    part = {"median_ms": 2.1, "p95_ms": 2.9, "p99_ms": 3.4, "max_ms": 7.7}
    metrics = {
        "stable": True,
        "success": rmse < 2.0,
        "rmse_commanded_mm": rmse,
        "max_commanded_mm": float(error_mm.max()),
    }
    return {
        "status": "completed",
        "message": "",
        "metrics": {**metrics, "final_same_time_mm": float(error_mm[-1]), "steps_completed": STEPS},
        "timing": {"plant": part, "jacobian": part, "command": part, "loop_wall_s": 0.9, "realtime_factor": 3.3},
        "solver": {"iterations_mean": 3.4, "iterations_max": 9},
        "digest": f"{abs(hash(str(error_mm))):064x}",
        "warnings": [],
        "provenance": {"scenario": scenario, "seed": scenario["seed"], "commit": "0" * 40, "cpu": "a processor"},
    }


def warm_up() -> None:
    """Nothing to compile."""
