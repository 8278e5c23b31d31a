"""Where the test insertions go, and through which tissue: pure functions of a seed.

Millimetres, rest space: x in [0, 36], y in [0, 62], every end point on the face z = 122 (Perrusi et al. 2021). The
training grid, from which they keep their distance, is that of the data set.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from benchmarks.learning.training_insertions import DEPTH_MM, ENTRY_MM, FACE_MM, grid_mm

Points = NDArray[np.float64]

__all__ = ["DIRECTIONS", "ENTRY_MM", "end_points_mm", "young_kpa"]

MARGIN_MM = 2.0  # between a test end point and the side faces
CLEARANCE_MM = 1.0  # between a test end point and the nearest training one
YOUNG_KPA = (5.5, 6.3)
TEST_SEED, YOUNG_SEED = 2021, 2022
DIRECTIONS = {
    "+x": (1.0, 0.0, 0.0),
    "-x": (-1.0, 0.0, 0.0),
    "+y": (0.0, 1.0, 0.0),
    "-y": (0.0, -1.0, 0.0),
}
_DECIMALS = 3  # of stored coordinates: a micrometre, so that scenarios stay readable


@cache
def _points(count: int, seed: int) -> tuple[tuple[float, float, float], ...]:
    rng = np.random.default_rng(seed)
    grid = grid_mm()[:, :2]
    low, high = np.full(2, MARGIN_MM), np.array(FACE_MM) - MARGIN_MM
    points: list[tuple[float, float, float]] = []
    while len(points) < count:
        point = np.round(rng.uniform(low, high), _DECIMALS)
        if np.linalg.norm(grid - point, axis=1).min() >= CLEARANCE_MM:
            points.append((float(point[0]), float(point[1]), DEPTH_MM))
    return tuple(points)


def end_points_mm(count: int = 100, *, seed: int = TEST_SEED) -> Points:
    """Test end points (count, 3) mm, uniform over the face without a margin of 2 mm, none within 1 mm of a training
    one. The first ones are the same whatever the count."""
    return np.array(_points(count, seed)).reshape(-1, 3)


def young_kpa(end_point: int, direction: str, *, seed: int = YOUNG_SEED) -> float:
    """Young's modulus of one trajectory, uniform in 5.5 to 6.3 kPa; the same for every controller that follows it.

    direction: "" for the straight path, else a key of DIRECTIONS. Raises ValueError for another.
    """
    known = ["", *DIRECTIONS]
    if direction not in known:
        raise ValueError(f"direction = {direction!r}: must be '' or one of {', '.join(DIRECTIONS)}")
    rng = np.random.default_rng([seed, end_point, known.index(direction)])
    return round(float(rng.uniform(*YOUNG_KPA)), 4)
