"""What the tip is asked to follow: the moving target and those to come, fixed in space or carried by the tissue."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from simcore.scenario.controller_blocks import LOOK_AHEAD
from simcore.trajectory import held_noise

if TYPE_CHECKING:
    from simcore.arrays import Floats, Ints
    from simcore.insertion.insertion import Insertion
    from simcore.scenario.scenario import Scenario

NOISE_HOLD_S = 0.01  # where the scenario names none


class Targets:
    """Of one scenario. rest_m: (steps + 1, 3) m, at rest; noise_m: (steps + 1, 3) m, of the scenario's seed."""

    def __init__(self, scenario: Scenario, insertion: Insertion) -> None:
        self.insertion, self.carried = insertion, scenario.trajectory.frame == "tissue"
        self.rest_m = scenario.trajectory.targets_m(scenario.dt_s, scenario.steps)
        self._carriers: list[tuple[Ints, Floats]] = []  # nodes and weights of the first targets
        self.draw(scenario)

    def draw(self, scenario: Scenario) -> None:
        """The noise of the scenario's seed."""
        self.noise_m = held_noise(
            np.random.default_rng(scenario.seed),
            amplitude_m=scenario.noise_mm * 1e-3,
            hold_s=scenario.noise_hold_s or NOISE_HOLD_S,
            dt_s=scenario.dt_s,
            steps=len(self.rest_m) - 1,
        )

    def clean(self, step: int, x: Floats) -> Floats:
        """n_traj(t_step) (3,) m, world; a path in the tissue frame is carried by the tissue, whose nodes are at x."""
        rest: Floats = self.rest_m[step]
        return self.insertion.material_point_position(x, rest) if self.carried else rest

    def coming(self, step: int, x: Floats) -> Floats:
        """(n, 3) m, world: the targets of this step and of at most LOOK_AHEAD more with the tissue's nodes at x,
        without noise."""
        last = min(step + LOOK_AHEAD + 1, len(self.rest_m))
        rest = self.rest_m[step:last]
        if not self.carried:
            return rest
        mesh = self.insertion.tissue.mesh
        self._carriers += [mesh.locate(point) for point in self.rest_m[len(self._carriers) : last]]
        nodes, weights = (np.array(part) for part in zip(*self._carriers[step:last], strict=True))
        moved: Floats = rest + np.einsum("ka,kai->ki", weights, (x - mesh.nodes_m)[nodes])
        return moved
