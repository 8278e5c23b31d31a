"""What a controller sees, what it answers, and how a scenario's block becomes one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from simcore.errors import Problem, ScenarioError
from simcore.insertion import Pose
from simcore.linearisation import Linearisation
from simcore.scenario import Scenario

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Observation:
    """All that a controller may know at the beginning of step `step`; metres, world frame."""

    step: int
    base: Pose
    tip_m: Vector  # (3,)
    target_m: Vector  # (3,) with noise


Model = Callable[[Observation], Linearisation]  # linearised about the step that led to the observation


class Controller(Protocol):
    """Answers an observation with the commanded pose T of the base, before the robot's limits."""

    limited: bool  # whether the robot's speed limits apply to its commands

    def command(self, observation: Observation) -> Pose:
        """T for this step."""


def make_controller(scenario: Scenario, *, entry_m: Vector, needle_length_m: float, model: Model | None) -> Controller:
    """The controller of a scenario. model: from `make_model`; only I-FEM asks it."""
    from simcore.controllers.ifem import InverseFemController
    from simcore.controllers.open_loop import OpenLoopController
    from simcore.controllers.replay import ReplayController
    from simcore.scenario import InverseFem, OpenLoop, Replay

    block = scenario.controller
    if isinstance(block, InverseFem):
        assert model is not None
        return InverseFemController(block, model)
    if isinstance(block, OpenLoop):
        return OpenLoopController(scenario, entry_m, needle_length_m)
    if isinstance(block, Replay):
        return ReplayController(block)
    raise ScenarioError([Problem("controller.kind", block.kind, "has no controller")])
