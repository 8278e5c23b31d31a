"""The points of a path from a table: x_mm, y_mm, z_mm, one row a point, for `trajectory.points_mm`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from simcore.errors import Problem, ScenarioError
from simcore.scenario.number_table import comma_separated
from simcore.scenario.trajectory_blocks import MAXIMUM_POINTS

if TYPE_CHECKING:
    from simcore.arrays import Floats

COLUMNS = 3
MAXIMUM_BYTES = 1_000_000
KEPT = ("entry_mm", "entry_snap_mm", "speed_mm_s", "frame")  # of the trajectory that the points replace


def read_waypoints(path: Path | str) -> Floats:
    """(n, 3) mm from a .csv file: three numbers a line, with or without a heading.

    Raises ScenarioError, which names the file, and the row where one is wrong.
    """
    try:
        data = Path(path).read_bytes()
        if len(data) > MAXIMUM_BYTES:
            raise _fault(path, f"holds {len(data) / 1e6:.1f} MB, at most {MAXIMUM_BYTES / 1e6:g} are allowed")
        points = comma_separated(data)
    except OSError as error:
        raise _fault(path, f"cannot be read: {error.strerror or error}") from None
    except ValueError as error:
        raise _fault(path, f"is no table of numbers: {str(error)[:200]}") from None
    if points.shape[1] != COLUMNS or not 1 <= len(points) <= MAXIMUM_POINTS:
        shape = " x ".join(map(str, points.shape))
        raise _fault(path, f"must be 1 to {MAXIMUM_POINTS} rows of x_mm, y_mm, z_mm, and is {shape}")
    if (wrong := np.flatnonzero(~np.isfinite(points).all(axis=1))).size:
        raise _fault(path, f"row {wrong[0] + 1} must be finite, and is {points[wrong[0]].tolist()}")
    return points


def with_waypoints(data: dict[str, Any], path: Path | str) -> dict[str, Any]:
    """Scenario JSON whose trajectory goes from its entry through the points of a file. Raises ScenarioError."""
    before = data.get("trajectory")
    kept = {name: before[name] for name in KEPT if name in before} if isinstance(before, dict) else {}
    return {**data, "trajectory": {"kind": "waypoints", **kept, "points_mm": read_waypoints(path).tolist()}}


def _fault(path: Path | str, message: str) -> ScenarioError:
    return ScenarioError([Problem("waypoints", str(path), message)])
