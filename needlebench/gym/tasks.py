"""What the environments ask for: a scenario by task, random generator and depth of its end points, mm; pure functions.

By default end points are where the paper's are (Perrusi et al. 2021): on the face z = 122 mm, 2 mm from its edges.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np

    Draw = Callable[[np.random.Generator, float], dict[str, Any]]

FACE_MM, MARGIN_MM, DEPTH_MM = (36.0, 62.0), 2.0, 122.0
LEAST_REACH = 0.5  # of the depth
YOUNG_KPA, FRICTION = (5.5, 7.1), (0.05, 0.2)  # 6.3 kPa and about 13 % to either side; a range, not a measurement
DIRECTIONS = ([1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0])


def _end_mm(rng: np.random.Generator, depth_mm: float) -> list[float]:
    x, y = (round(float(rng.uniform(MARGIN_MM, edge - MARGIN_MM)), 3) for edge in FACE_MM)
    return [x, y, depth_mm]


def line(rng: np.random.Generator, depth_mm: float) -> dict[str, Any]:
    """A straight line to a random end point."""
    return {"trajectory": {"kind": "line", "target_mm": _end_mm(rng, depth_mm)}}


def curve(rng: np.random.Generator, depth_mm: float) -> dict[str, Any]:
    """The same with a sine of 1 mm along +-x or +-y."""
    end, direction = _end_mm(rng, depth_mm), DIRECTIONS[int(rng.integers(len(DIRECTIONS)))]
    return {"trajectory": {"kind": "sine", "target_mm": end, "amplitude_mm": 1.0, "direction": direction}}


def breathing(rng: np.random.Generator, depth_mm: float) -> dict[str, Any]:
    """A straight line, fixed in space, while the held faces breathe along z at a random pace."""
    period = round(float(rng.uniform(3.0, 5.0)), 3)
    return {**line(rng, depth_mm), "motion": {"kind": "breathing", "period_s": period}}


def mismatch(rng: np.random.Generator, depth_mm: float) -> dict[str, Any]:
    """A curve in tissue of random stiffness and friction, a tip that is seen late and with noise, a noisy target."""
    return {
        **curve(rng, depth_mm),
        "noise_mm": 0.25,
        "tissue": {"young_kpa": round(float(rng.uniform(*YOUNG_KPA)), 3)},
        "interaction": {"friction": round(float(rng.uniform(*FRICTION)), 3)},
        "sensing": {"latency_s": 0.05, "noise_mm": 0.1},
    }


def reach(rng: np.random.Generator, depth_mm: float) -> dict[str, Any]:
    """A random point inside the tissue, to be reached in 15 s."""
    depth = round(float(rng.uniform(LEAST_REACH * depth_mm, depth_mm)), 3)
    return {"trajectory": {"kind": "reach", "target_mm": _end_mm(rng, depth)}}


TASKS: dict[str, Draw] = {"Line": line, "Curve": curve, "Breathing": breathing, "Mismatch": mismatch, "Reach": reach}
