"""Open loop: a rigid needle's motion along the straight line from entry to target; what steering must beat."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simcore.insertion.insertion import rotation_towards
from simcore.insertion.state import Pose
from simcore.linear_algebra.products import norm

if TYPE_CHECKING:
    from simcore.arrays import Floats
    from simcore.episode.observation import Observation
    from simcore.scenario.scenario import Scenario


class OpenLoopController:
    """Feeds the straight needle along the chord at the path's pace: the same share of the length at the same time."""

    limited = True

    def __init__(self, scenario: Scenario, entry_m: Floats, needle_length_m: float) -> None:
        path = scenario.path()
        chord = path.end_m - path.entry_m
        self.entry_m, self.needle_length_m = entry_m, needle_length_m
        self.chord_m = norm(chord)
        self.rotation = rotation_towards(chord / self.chord_m)
        self.share_per_step = scenario.trajectory.share_per_step(scenario.dt_s)

    def command(self, observation: Observation) -> Pose:
        """The base pose that would put a rigid needle's tip at the chord's point for this step."""
        along = self.chord_m * min(1.0, observation.step * self.share_per_step)
        return Pose(self.entry_m + (along - self.needle_length_m) * self.rotation[:, 2], self.rotation)
