"""How an insertion is seen: images of the tip now and then, late, noisy, in a frame that is not quite the robot's."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from simcore.insertion.jacobian_fast import lateral_offset

if TYPE_CHECKING:
    from simcore.arrays import Floats
    from simcore.insertion.insertion import InsertionState
    from simcore.insertion.model import CoupledModel
    from simcore.scenario.scenario import Scenario

NOISE_STREAM, REGISTRATION_STREAM = 1, 2  # of the scenario's seed; the target's noise draws from the seed itself


class Image(NamedTuple):
    """What one image shows. step: when it was taken. tip_m: (3,). tip_direction: (3,) unit, along the needle.
    entry_offset_m: (2,) of the shaft from the entry. depth_m: inserted length. tissue_m: (n, 3) nodes of the tissue,
    which carry a path in its frame; nothing else is read from them."""

    step: int
    tip_m: Floats
    tip_direction: Floats
    entry_offset_m: Floats
    depth_m: float
    tissue_m: Floats


@dataclass(frozen=True)
class Camera:
    """Takes an image every `period` steps and shows it `latency` steps later.

    noise_m: (steps + 1, 3), of the tip in the image of each step; offset_m: (3,), of every image of a run.
    """

    period: int
    latency: int
    model: CoupledModel
    noise_m: Floats | None
    offset_m: Floats | None

    @classmethod
    def of(cls, scenario: Scenario, model: CoupledModel) -> Camera:
        """With the noise and the offset that the scenario's seed draws."""
        sensing, noise, offset = scenario.sensing, None, None
        if sensing.noise_mm > 0.0:
            draws = np.random.default_rng([scenario.seed, NOISE_STREAM])
            noise = draws.normal(0.0, 1e-3 * sensing.noise_mm, (scenario.steps + 1, 3))
        if sensing.tip == "registered":
            draws = np.random.default_rng([scenario.seed, REGISTRATION_STREAM])
            offset = draws.normal(0.0, 1e-3 * sensing.registration_mm, 3)
        return cls(*sensing.steps(scenario.dt_s), model, noise, offset)

    def take(self, step: int, state: InsertionState) -> Image:
        """The image of a state."""
        tip = state.tip_m.copy()
        for error in (self.offset_m, None if self.noise_m is None else self.noise_m[step]):
            if error is not None:
                tip += error
        offset = lateral_offset(self.model, state.bodies, state.inserted_m)[0]
        direction = state.bodies.needle_R[-1][:, 2].copy()
        return Image(step, tip, direction, offset, state.inserted_m, state.bodies.x)


class View:
    """The images of a run: the newest that is seen, and those on their way. The waiting needle is seen at once."""

    def __init__(self, camera: Camera, first: InsertionState) -> None:
        self.camera = camera
        self.seen = camera.take(0, first)
        self.coming: deque[Image] = deque()

    def look(self, step: int, state: InsertionState) -> None:
        """After each step: take an image if one is due, and see what was taken long enough ago."""
        if step % self.camera.period == 0:
            self.coming.append(self.camera.take(step, state))
        while self.coming and self.coming[0].step + self.camera.latency <= step:
            self.seen = self.coming.popleft()
