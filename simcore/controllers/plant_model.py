"""What I-FEM linearises: the plant itself (shared, as in the paper), or an insertion of the controller's own."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from simcore.errors import ModelFailureError, Status
from simcore.insertion.insertion import Insertion, InsertionState
from simcore.insertion.jacobian_exact import linearise_exactly
from simcore.insertion.jacobian_fast import Linearisation, linearise
from simcore.insertion.jacobian_perturbation import Perturbation
from simcore.scenario.build import insertion_of
from simcore.scenario.controller_rules import needs_tissue
from simcore.scenario.scenario import InverseFem, Scenario, SeparateModel

if TYPE_CHECKING:
    from simcore.controllers.base import Model
    from simcore.episode.observation import Observation

LastStep = Callable[[], tuple[InsertionState, InsertionState]]
Derivative = Callable[[InsertionState, InsertionState], Linearisation]


def derivative(insertion: Insertion, settings: InverseFem) -> Derivative:
    """The Jacobian that the settings ask for, as a function of the last step: states before and after it."""
    if settings.jacobian == "perturbation":
        shift, lever = settings.perturbation_mm * 1e-3, settings.lever_arm_mm * 1e-3
        return Perturbation(insertion, shift_m=shift, lever_arm_m=lever).linearise
    form = linearise_exactly if settings.derivative == "exact" else linearise
    return lambda _, state: form(insertion.model, state.solved)


class Shared:
    """The model is the plant. The only place where a controller comes by the plant's state."""

    def __init__(self, settings: InverseFem, plant: Insertion, last_step: LastStep) -> None:
        self.derivative, self.last_step = derivative(plant, settings), last_step

    def __call__(self, _: Observation) -> Linearisation:
        """About the plant's last step. Raises ModelFailureError."""
        return self.derivative(*self.last_step())


class Separate:
    """Steps its own insertion to every base pose that the robot has executed; it knows nothing else of the plant."""

    def __init__(self, scenario: Scenario, settings: InverseFem, model: SeparateModel) -> None:
        scenario = model_scenario(scenario, model)
        self.insertion = insertion_of(scenario, keeps_tissue=needs_tissue(settings))
        self.derivative = derivative(self.insertion, settings)
        self.state = self.insertion.initial_state(scenario.path().first_tangent())

    def __call__(self, observation: Observation) -> Linearisation:
        """About the model's step to the observed base. Raises ModelFailureError."""
        before = self.state
        if observation.step > 0:
            self.state = self.insertion.step(before, observation.base)
        if self.state.report.status is not Status.COMPLETED:
            raise ModelFailureError(self.state.report.status, self.state.report.message)
        return self.derivative(before, self.state)


def model_scenario(scenario: Scenario, model: SeparateModel) -> Scenario:
    """The plant's scenario with the elasticity, the mesh and the friction of the controller's model."""
    tissue = {"young_kpa": model.young_kpa, "poisson": model.poisson, "element_size_mm": model.element_size_mm}
    interaction = {"friction": model.friction, "spacing_mm": model.spacing_mm}
    return scenario.model_copy(
        update={
            "tissue": scenario.tissue.model_copy(update=tissue),
            "interaction": scenario.interaction.model_copy(update=interaction),
        }
    )


def make_model(scenario: Scenario, plant: Insertion, last_step: LastStep) -> Model | None:
    """The model that the scenario's controller linearises; None for controllers without one."""
    settings = scenario.controller
    if not isinstance(settings, InverseFem):
        return None
    if isinstance(settings.model, SeparateModel):
        return Separate(scenario, settings, settings.model)
    return Shared(settings, plant, last_step)
