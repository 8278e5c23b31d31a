"""A controller that looks ahead: it tries moves of the base on an insertion of its own and takes the best.

A baseline, and an example of a plug-in that uses `Episode` as its model. Installed with needlebench:

    needlebench run sine --out out/mpc --set controller.kind=plugin --set controller.name=mpc

Settings: horizon (steps that a move is held), samples (moves tried in a round), rounds (each around the best so far),
spread_mm (standard deviation of the first round's moves), drag (cost of the base's way across the needle, share of the
tip's error). Cross-entropy method with one elite (Rubinstein and Kroese 2004); the axis passes through the entry.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from needlebench import Episode, Observation, Pose, Scenario, pose_through

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Vector = NDArray[np.float64]

SETTINGS = {"horizon": 3, "samples": 8, "rounds": 2, "spread_mm": 0.2, "drag": 0.01}
SHRINKS = 0.4  # the spread, from round to round


class SamplingController:
    """Of the scenario's tissue, needle and interaction; it sees the tip as all do and corrects its model by it."""

    limited = True  # the robot's speed limits apply

    def __init__(self, scenario: Scenario, entry_m: Vector, needle_length_m: float, settings: dict[str, Any]) -> None:
        """Raises ValueError for a setting that is unknown or not positive."""
        chosen = {**SETTINGS, **settings}
        if unknown := sorted(set(chosen) - set(SETTINGS)):
            raise ValueError(f"unknown settings {unknown}; known are {sorted(SETTINGS)}")
        if wrong := {name: value for name, value in chosen.items() if not 0 < value < 1000}:
            raise ValueError(f"settings {wrong} must be above 0 and below 1000")
        self.horizon, self.samples, self.rounds = (int(chosen[name]) for name in ("horizon", "samples", "rounds"))
        self.spread_m, self.drag = 1e-3 * chosen["spread_mm"], float(chosen["drag"])
        self.entry_m, self.length_m = entry_m, needle_length_m
        data = scenario.resolved()
        data |= {"controller": {"kind": "open_loop"}, "noise_mm": 0.0, "recording": {"enabled": False}}
        data.pop("sensing", None)  # the model sees its own tip as it is
        self.model = Episode(Scenario.load(data))
        self.move_m = np.zeros(3)

    def reset(self, seed: int) -> None:
        """Draw from here on from this seed."""
        self.random = np.random.default_rng(seed)

    def command(self, seen: Observation) -> Pose:
        """The best move of all that were tried, from where the base is."""
        if seen.step and not self.model.done:
            self.model.step(seen.base, limited=False)  # what the robot did
        if self.model.done:  # its model has failed: go on as before
            return self._pose(seen, self.move_m)
        now, off_m = self.model.snapshot(), seen.tip_m - self.model.state.tip_m
        best, least = self.move_m, np.inf
        for number in range(self.rounds):
            spread = self.spread_m * SHRINKS**number
            moves = best + spread * self.random.standard_normal((self.samples, 3))
            for move in (best, *moves):
                cost = self._cost(seen, move, off_m)
                self.model.restore(now)
                if cost < least:
                    best, least = move, cost
        self.move_m = best
        return self._pose(seen, best)

    def _cost(self, seen: Observation, move: Vector, off_m: Vector) -> float:
        """m2: mean square distance of the model's tip from the coming targets, and of the base's way across."""
        wanted, errors, base = seen.targets_m, list[float](), seen.base
        for ahead in range(self.horizon):
            base = self._pose_from(base, move)
            self.model.step(base, limited=False)
            if self.model.status != "completed":
                return float("inf")
            error = self.model.state.tip_m + off_m - wanted[min(ahead, len(wanted) - 1)]
            errors.append(float(error @ error))
            if self.model.done:
                break
        axis = seen.base.rotation[:, 2]
        across = move - (move @ axis) * axis
        return float(np.mean(errors)) + self.drag * float(across @ across)

    def _pose(self, seen: Observation, move: Vector) -> Pose:
        return self._pose_from(seen.base, move)

    def _pose_from(self, base: Pose, move: Vector) -> Pose:
        """Moved, its axis through the entry."""
        return pose_through(self.entry_m, base.position_m + move, base.rotation)
