"""Made-up outcomes of the paper's experiments, with errors that are chosen and not simulated."""

from __future__ import annotations

import hashlib
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.cases import Case, Label, Outcome
from benchmarks.paper.learning_studies import LearningPoint

if TYPE_CHECKING:
    from collections.abc import Iterator

DIRECTIONS = ("+x", "-x", "+y", "-y")
MEDIANS_MM = {  # (group, arm) -> median of the log-normal errors
    ("LIN", "ifem"): 0.011,
    ("LIN", "elm"): 0.034,
    ("LIN", "open_loop"): 0.21,
    ("LIN", "rigid"): 0.33,
    ("CUR", "ifem"): 0.090,
    ("CUR", "elm"): 0.062,
    ("CUR", "open_loop"): 0.71,
    ("CUR", "rigid"): 0.96,
}
STEP_MS = {"constraint": (1.9, 0.6, 0.15), "perturbation": (1.9, 9.0, 0.15), "elm": (1.8, 0.0, 0.02)}


def scenario(
    end_mm: tuple[float, float], *, kind: str = "ifem", young_kpa: float = 6.3, **controller: Any
) -> dict[str, Any]:
    """The fields of a resolved scenario that analyses look at."""
    return {
        "noise_mm": 0.0,
        "tissue": {"size_mm": [36.0, 62.0, 122.0], "young_kpa": young_kpa, "mesh_file": None},
        "trajectory": {"kind": "line", "entry_mm": [18.0, 31.0, 0.0], "target_mm": [*end_mm, 122.0]},
        "controller": {"kind": kind, **controller},
    }


def outcome(
    case_id: str,
    rmse_commanded_mm: float,
    labels: dict[str, Label] | None = None,
    *,
    end_mm: tuple[float, float] = (18.0, 31.0),
    step_ms: tuple[float, float, float] = (1.9, 0.6, 0.15),
    young_kpa: float = 6.3,
    **controller: Any,
) -> Outcome:
    """An insertion with this error; an infinite one is a failure."""
    stable = math.isfinite(rmse_commanded_mm)
    labels = labels or {}
    kind = str(labels.get("arm", "ifem"))
    metrics = {
        "stable": stable,
        "success": stable and rmse_commanded_mm < 1.5,
        "steps_completed": 1226 if stable else 431,
        "steps": 1226,
        "rmse_commanded_mm": rmse_commanded_mm if stable else 0.5,
        "max_commanded_mm": 2.1 * rmse_commanded_mm if stable else 3.0,
        "limited_fraction": 0.02,
    }
    plant, jacobian, command = step_ms
    timing = {
        "plant": {"median_ms": plant},
        "jacobian": {"median_ms": jacobian},
        "command": {"median_ms": command},
        "recording": {"median_ms": 0.002},
        "loop_wall_s": 1.1e-3 * (plant + jacobian + command) * 1226,
    }
    return Outcome(
        Case(case_id, scenario(end_mm, kind=kind, young_kpa=young_kpa, **controller), labels),
        {
            "status": "completed" if stable else "not_converged",
            "message": "" if stable else "step 432 of 1226: no convergence",
            "metrics": metrics,
            "timing": timing,
            "digest": hashlib.sha256(case_id.encode()).hexdigest(),
        },
    )


def end_points(count: int) -> list[tuple[float, float]]:
    rng = np.random.default_rng(2021)
    return [(float(x), float(y)) for x, y in rng.uniform((2.0, 2.0), (34.0, 60.0), (count, 2))]


def experiments(count: int = 12, *, seed: int = 1, medians: dict[tuple[str, str], float] = MEDIANS_MM) -> list[Outcome]:
    """LIN, CUR, noise on, variable Young's modulus with failures near the borders: `count` end points."""
    rng = np.random.default_rng(seed)
    return [*_constant(count, rng, medians), *_noisy(count, rng, medians), *_variable(count, rng, medians)]


def _paths(count: int) -> Iterator[tuple[int, tuple[float, float], str, str]]:
    for i, end in enumerate(end_points(count)):
        for direction in ("", *DIRECTIONS):
            yield i, end, "CUR" if direction else "LIN", direction


def _constant(count: int, rng: np.random.Generator, medians: dict[tuple[str, str], float]) -> Iterator[Outcome]:
    for i, end, group, direction in _paths(count):
        for arm in ("ifem", "elm", "open_loop", "rigid"):
            error = float(medians[group, arm] * rng.lognormal(0.0, 0.25))
            labels = labelled(group, arm, i, direction)
            yield outcome(f"{group.lower()}-{i:03}{direction}-{arm}", error, labels, end_mm=end)


def _noisy(count: int, rng: np.random.Generator, medians: dict[tuple[str, str], float]) -> Iterator[Outcome]:
    for i, end in enumerate(end_points(max(1, count // 4))):
        for arm in ("ifem", "elm", "open_loop", "rigid"):
            error = float(math.hypot(0.17, medians["LIN", arm]) * rng.lognormal(0.0, 0.05))
            yield outcome(f"lin-noise-{i:03}-{arm}", error, labelled("LIN", arm, i, "", noise="on"), end_mm=end)


def _variable(count: int, rng: np.random.Generator, medians: dict[tuple[str, str], float]) -> Iterator[Outcome]:
    for i, end, group, direction in _paths(count):
        near = min(end[0], 36.0 - end[0]) < 3.5 and direction in ("+x", "-x")
        error = math.inf if near else float(medians[group, "elm"] * rng.lognormal(0.02, 0.25))
        labels = labelled(group, "elm", i, direction, young="variable")
        yield outcome(f"young-{group.lower()}-{i:03}{direction}-elm", error, labels, end_mm=end, young_kpa=5.9)


def labelled(group: str, arm: str, end_point: int, direction: str, **more: Label) -> dict[str, Label]:
    path: dict[str, Label] = {"group": group, "arm": arm, "end_point": end_point, "direction": direction}
    return {"purpose": "main", "young": "constant", "noise": "off", **path, **more}


def timings(paths: int = 3) -> list[Outcome]:
    """The interleaved pass: I-FEM in both ways, and the ELM."""
    found = []
    for i in range(paths):
        for way, step in STEP_MS.items():
            arm = "elm" if way == "elm" else "ifem"
            labels = labelled("LIN", arm, i, "", purpose="timing", jacobian=way)
            scaled = tuple(part * (1.0 + 0.02 * i) for part in step)
            controller: dict[str, Any] = {} if way == "elm" else {"jacobian": way}
            found.append(
                outcome(f"timing-{i}-{way}", 0.01, labels, step_ms=(scaled[0], scaled[1], scaled[2]), **controller)
            )
    return found


def seeds(count: int = 20, paths: int = 5) -> list[Outcome]:
    """ELM seeds along the first paths of the experiments, LIN and CUR in turn."""
    rng = np.random.default_rng(3)
    found = []
    for seed in range(count):
        for i in range(paths):
            direction = "" if i % 2 == 0 else DIRECTIONS[i // 2 % 4]
            group = "CUR" if direction else "LIN"
            labels = labelled(group, "elm", i, direction, purpose="seeds", model_seed=seed)
            error = float(MEDIANS_MM[group, "elm"] * rng.lognormal(0.0, 0.3))
            found.append(outcome(f"seed-{seed:02}-{i}", error, labels))
    return found


def sensitivity() -> list[Outcome]:
    """Three settings, one of them the controller's own, on one LIN and one CUR path."""
    rng = np.random.default_rng(4)
    found = []
    settings = (
        ("nominal", "defaults", False),
        ("gain", "0.5", True),
        ("friction", "0", False),
        ("friction", "0.3", False),
    )
    for parameter, value, own in settings:
        for group, direction in (("LIN", ""), ("CUR", "+x")):
            for arm in ("ifem",) if own else ("ifem", "elm", "open_loop"):
                more = {"parameter": parameter, "value": value}
                labels = labelled(group, arm, 0, direction, purpose="sensitivity", **more)
                error = float(MEDIANS_MM[group, arm] * rng.lognormal(0.0, 0.2))
                found.append(outcome(f"sens-{parameter}-{value}-{group}-{arm}", error, labels))
    return found


def learning() -> list[LearningPoint]:
    """Errors that fall with nodes and samples."""
    rng = np.random.default_rng(5)
    values = {"nodes": (5, 10, 15, 25, 50, 100, 200), "samples": (100, 300, 1000, 3000, 10_000)}
    return [
        LearningPoint(curve, value, seed, measure, float(floor + scale / math.sqrt(value) * rng.lognormal(0.0, 0.15)))
        for curve, scale in (("nodes", 0.2), ("samples", 0.7))
        for value in values[curve]
        for seed in range(5)
        for measure, floor in (("split by sample", 0.015), ("split by trajectory", 0.022))
    ]
