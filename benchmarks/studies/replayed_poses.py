"""Base poses taken from one run and replayed in others, at the same time step or another."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


def replay_block(series: dict[str, NDArray[Any]], *, dt_s: float, new_dt_s: float) -> dict[str, Any]:
    """A `replay` controller that moves the base as in `series` (row 0 = initial pose), sampled every `new_dt_s`.

    Positions are interpolated linearly, rotations along the great circle; the last pose is held to the end of a step
    that passes it. At the same time step the poses are those of the run.
    """
    position_m, quaternion = series["base_position_m"], series["base_rotation"]
    if new_dt_s == dt_s:
        rows = np.hstack([1e3 * position_m[1:], quaternion[1:]])
        return {"kind": "replay", "poses": rows.tolist()}
    last = len(position_m) - 1
    count = math.ceil(last * dt_s / new_dt_s - 1e-9)
    at = np.minimum(np.arange(1, count + 1) * new_dt_s / dt_s, last)
    before = np.minimum(at.astype(int), last - 1)
    share = at - before
    moved = position_m[before] + share[:, None] * (position_m[before + 1] - position_m[before])
    turned = slerp(quaternion[before], quaternion[before + 1], share)
    return {"kind": "replay", "poses": np.hstack([1e3 * moved, turned]).tolist()}


def slerp(start: Vector, end: Vector, share: Vector) -> Vector:
    """(n, 4) unit quaternions at `share` (n,) of the shorter way from start to end, both (n, 4) (Shoemake 1985)."""
    cosine = (start * end).sum(axis=1)
    end = np.where(cosine[:, None] < 0.0, -end, end)
    angle = 2.0 * np.arcsin(np.clip(0.5 * np.linalg.norm(end - start, axis=1), 0.0, 1.0))
    sine = np.sin(angle)
    tiny = sine < 1e-9
    safe = np.where(tiny, 1.0, sine)
    first = np.where(tiny, 1.0 - share, np.sin((1.0 - share) * angle) / safe)
    second = np.where(tiny, share, np.sin(share * angle) / safe)
    mixed: Vector = first[:, None] * start + second[:, None] * end
    mixed /= np.linalg.norm(mixed, axis=1, keepdims=True)
    return mixed
