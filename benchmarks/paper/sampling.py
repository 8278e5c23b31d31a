"""Where the insertions of the experiments go, and through which tissue: pure functions of a seed.

Millimetres, rest space: x in [0, 36], y in [0, 62], every end point on the face z = 122 (Perrusi et al. 2021).
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]

WIDTH_MM, HEIGHT_MM, DEPTH_MM = 36.0, 62.0, 122.0
ENTRY_MM = (18.0, 31.0, 0.0)
COLUMNS, ROWS = 7, 15
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


def training_grid_mm() -> Points:
    """The 105 training end points (105, 3) mm: centres of 7 x 15 cells, x slowest."""
    x = (np.arange(COLUMNS) + 0.5) * WIDTH_MM / COLUMNS
    y = (np.arange(ROWS) + 0.5) * HEIGHT_MM / ROWS
    grid = np.array([(cx, cy, DEPTH_MM) for cx in x for cy in y])
    return np.round(grid, _DECIMALS)


def training_subset(count: int) -> list[int]:
    """Indices (count,) of grid points that cover the face evenly, ascending.

    Greedy: the centre first, then always the point that is farthest from those taken. Smaller sets are within larger
    ones. Raises ValueError outside 1 to 105.
    """
    grid = training_grid_mm()
    if not 1 <= count <= len(grid):
        raise ValueError(f"count = {count}: must be 1 to {len(grid)}")
    taken = [len(grid) // 2]
    gap = np.linalg.norm(grid - grid[taken[0]], axis=1)
    while len(taken) < count:
        taken.append(int(np.argmax(gap)))
        gap = np.minimum(gap, np.linalg.norm(grid - grid[taken[-1]], axis=1))
    return sorted(taken)


@cache
def _points(count: int, seed: int) -> tuple[tuple[float, float, float], ...]:
    rng = np.random.default_rng(seed)
    grid = training_grid_mm()[:, :2]
    low, high = np.full(2, MARGIN_MM), np.array([WIDTH_MM, HEIGHT_MM]) - MARGIN_MM
    found: list[tuple[float, float, float]] = []
    while len(found) < count:
        point = np.round(rng.uniform(low, high), _DECIMALS)
        if np.linalg.norm(grid - point, axis=1).min() >= CLEARANCE_MM:
            found.append((float(point[0]), float(point[1]), DEPTH_MM))
    return tuple(found)


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
