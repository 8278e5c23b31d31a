"""From a scenario's block to its controller. A new kind is a block in `controller_blocks` and a line here."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simcore.controllers.base import Controller, Model, Setup
from simcore.controllers.frozen_jacobian import FrozenJacobianController
from simcore.controllers.ifem import inverse_fem
from simcore.controllers.learned import LearnedController
from simcore.controllers.open_loop import OpenLoopController
from simcore.controllers.plugin import PluginController
from simcore.controllers.remote import RemoteController
from simcore.controllers.replay import ReplayController
from simcore.controllers.rigid_needle import RigidNeedleController
from simcore.scenario.scenario import FrozenJacobian, InverseFem, Learned, Plugin, Remote, Replay, RigidNeedle, Scenario

if TYPE_CHECKING:
    from collections.abc import Callable

    from simcore.arrays import Floats

FACTORIES: dict[str, Callable[[Setup], Controller]] = {
    "ifem": lambda s: inverse_fem(s.settings(InverseFem), s.asked_model(), s.entry_m, s.scenario.dt_s),
    "elm": lambda s: LearnedController.load("elm", s.settings(Learned), s.entry_m),
    "rigid": lambda s: RigidNeedleController(s.settings(RigidNeedle), s.scenario, s.entry_m, s.needle_length_m),
    "frozen": lambda s: FrozenJacobianController(s.settings(FrozenJacobian), s.scenario, s.entry_m),
    "linear": lambda s: LearnedController.load("linear", s.settings(Learned), s.entry_m),
    "neighbours": lambda s: LearnedController.load("neighbours", s.settings(Learned), s.entry_m),
    "mlp": lambda s: LearnedController.load("mlp", s.settings(Learned), s.entry_m),
    "open_loop": lambda s: OpenLoopController(s.scenario, s.entry_m, s.needle_length_m),
    "replay": lambda s: ReplayController(s.settings(Replay)),
    "remote": lambda s: RemoteController(s.settings(Remote), s.scenario, s.entry_m, s.needle_length_m),
    "plugin": lambda s: PluginController.load(s.settings(Plugin), s.scenario, s.entry_m, s.needle_length_m),
}


def make_controller(scenario: Scenario, *, entry_m: Floats, needle_length_m: float, model: Model | None) -> Controller:
    """The controller of a scenario. model: from `make_model`; only I-FEM asks it.

    Raises ScenarioError for a model file that cannot be used any more, ControllerError for a plug-in that cannot be
    made and a remote controller that cannot be waited for.
    """
    return FACTORIES[scenario.controller.kind](Setup(scenario, entry_m, needle_length_m, model))
