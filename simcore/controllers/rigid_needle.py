"""A rigid needle through the remote centre of motion: its tip at the observed target, whatever the real tip does."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simcore.insertion.insertion import rotation_towards
from simcore.insertion.state import Pose
from simcore.linear_algebra.products import dot, norm

if TYPE_CHECKING:
    from simcore.arrays import Floats
    from simcore.episode.observation import Observation
    from simcore.scenario.scenario import RigidNeedle, Scenario


class RigidNeedleController:
    """The axis points from the entry to the target. Near the entry, where noise would turn it, it keeps the direction
    in which the needle waits."""

    limited = True

    def __init__(self, settings: RigidNeedle, scenario: Scenario, entry_m: Floats, needle_length_m: float) -> None:
        self.entry_m, self.needle_length_m = entry_m, needle_length_m
        self.first = scenario.path().first_tangent()
        self.straight_m = min(settings.straight_mm * 1e-3, 0.5 * scenario.path().length_m)

    def command(self, observation: Observation) -> Pose:
        """The base pose that puts a rigid needle's tip at the target."""
        towards = observation.target_m - self.entry_m
        distance = norm(towards)
        if distance < self.straight_m:
            axis, depth = self.first, dot(towards, self.first)
        else:
            axis, depth = towards / distance, distance
        return Pose(self.entry_m + (depth - self.needle_length_m) * axis, rotation_towards(axis))
