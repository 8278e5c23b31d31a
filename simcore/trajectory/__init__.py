"""The path that the tip is asked to follow, and the moving target on it (simcore/README.md)."""

from simcore.trajectory.curves import ArcPath, SinePath, SplinePath
from simcore.trajectory.path import Path
from simcore.trajectory.targets import held_noise, polyline_distance_m, step_count, targets

__all__ = ["ArcPath", "Path", "SinePath", "SplinePath", "held_noise", "polyline_distance_m", "step_count", "targets"]
