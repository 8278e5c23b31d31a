"""What a controller is made of, what it is asked, and what it answers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, TypeVar

import numpy as np

from simcore.episode.observation import Observation
from simcore.insertion.jacobian_fast import Linearisation

if TYPE_CHECKING:
    from simcore.arrays import Floats
    from simcore.insertion.state import Pose
    from simcore.scenario.scenario import Scenario

Settings = TypeVar("Settings")
SEED_STREAM = 3  # of the scenario's seed: beside those of `episode.sensing`


Model = Callable[[Observation], Linearisation]  # linearised about the step that led to the observation


class Controller(Protocol):
    """Answers an observation with the commanded pose T of the base, before the robot's limits."""

    limited: bool  # whether the robot's speed limits apply to its commands

    def command(self, observation: Observation) -> Pose:
        """T for this step."""


@dataclass(frozen=True)
class Setup:
    """What a controller can be made of: the scenario, the initial entry point (3,) m, and I-FEM's model."""

    scenario: Scenario
    entry_m: Floats
    needle_length_m: float
    model: Model | None

    def settings(self, block: type[Settings]) -> Settings:
        """The scenario's controller block, which is of this type."""
        found = self.scenario.controller
        assert isinstance(found, block)
        return found

    def asked_model(self) -> Model:
        """The model to linearise, for a controller that `make_model` makes one for."""
        assert self.model is not None
        return self.model


def seed_of_controller(seed: int) -> int:
    """For what a controller draws itself, from the scenario's seed and independent of it; below 2^32."""
    return int(np.random.SeedSequence([seed, SEED_STREAM]).generate_state(1)[0])
