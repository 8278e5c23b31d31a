"""The moving target on a path, how long it moves, and the noise of what is seen of it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from simcore.arrays import Floats
    from simcore.trajectory.path import Path


def polyline_distance_m(point: Floats, line: Floats) -> float:
    """Distance, m, of a point (3,) m from the polyline through line (k, 3) m, k at least 2."""
    start, along = line[:-1], np.diff(line, axis=0)
    length = np.maximum(np.sum(along**2, axis=1), np.finfo(float).tiny)
    share = np.clip(np.sum((point - start) * along, axis=1) / length, 0.0, 1.0)
    gaps = start + share[:, None] * along - point
    return float(np.sqrt(np.sum(gaps**2, axis=1).min()))


def step_count(path_length_m: float, speed_m_s: float, dt_s: float) -> int:
    """ceil(path length / (speed dt)); a quotient within 1e-9 of a whole number counts as whole."""
    steps = path_length_m / (speed_m_s * dt_s)
    return max(1, math.ceil(steps - 1e-9 * max(1.0, steps)))


def targets(path: Path, *, speed_m_s: float, dt_s: float, steps: int) -> Floats:
    """n_traj(t_i), (steps + 1, 3) m: row 0 the entry, row i at arc length speed * i * dt, clipped to the end."""
    return path.point(speed_m_s * dt_s * np.arange(steps + 1, dtype=np.float64))


def held_noise(rng: np.random.Generator, *, amplitude_m: float, hold_s: float, dt_s: float, steps: int) -> Floats:
    """Uniform noise (steps + 1, 3) m in +-amplitude per axis, redrawn every `hold_s` and held between.

    Redrawing by time and not by step makes the noise mean the same at every dt.
    """
    if amplitude_m == 0.0:
        return np.zeros((steps + 1, 3))
    window = np.floor(np.arange(steps + 1) * (dt_s / hold_s) + 1e-9).astype(int)
    draws = rng.uniform(-amplitude_m, amplitude_m, (int(window[-1]) + 1, 3))
    held: Floats = draws[window]
    return held
