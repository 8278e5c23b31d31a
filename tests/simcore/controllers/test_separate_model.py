"""I-FEM with a model of its own: what it may know, how its scenario is made, and how its failure is told."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from simcore.controllers.plant_model import Separate, derivative, model_scenario
from simcore.errors import ScenarioError, Status
from simcore.rollout.rollout import run
from simcore.scenario.presets import preset, with_changes
from simcore.scenario.scenario import InverseFem, Scenario, SeparateModel, SharedModel
from tests.simcore.block import block_scenario
from tests.verification import verify

if TYPE_CHECKING:
    from simcore.rollout.records import StepRecord
    from simcore.rollout.result import Rollout

HARD = {"interaction": {"line_compliance": False}}
TWIN = {"kind": "separate", "young_kpa": 6.3, "element_size_mm": 10.0, "friction": 0.1, "spacing_mm": 10.0}


def scenario(model: dict[str, Any], **blocks: Any) -> Scenario:
    """10 mm along an oblique line, 52 steps."""
    data: dict[str, Any] = {
        "controller": {"kind": "ifem", "model": model},
        "trajectory": {"kind": "line", "target_mm": [14.0, 22.0, 10.0]},
        "dt_s": 0.02,
    }
    return block_scenario(**{**data, **blocks})


def ifem(s: Scenario) -> InverseFem:
    assert isinstance(s.controller, InverseFem)
    return s.controller


def rmse_commanded_mm(rollout: Rollout) -> float:
    assert rollout.status is Status.COMPLETED, rollout.message
    return float(rollout.metrics["rmse_commanded_mm"])


@pytest.mark.slow
def test_a_model_equal_to_the_plant_steers_as_the_shared_one() -> None:
    """Stepped with the executed poses, it is in the plant's state at every step, to the solver's tolerance."""
    own, shared = run(scenario(TWIN)).series, run(scenario({"kind": "shared"})).series
    assert len(own["tip_m"]) == 53
    apart, text = own["tip_m"] - shared["tip_m"], "separate model equal to the plant: tip against the shared model's"
    source = "one insertion stepped with the same poses twice"
    verify("control", text, expected=0, measured=apart, tolerance=1e-9, source=source, unit="m")


@pytest.mark.slow
@pytest.mark.parametrize("change", [{"young_kpa": 3.2}, {"poisson": 0.2}, {"friction": 0.3}, {"element_size_mm": 8.0}])
def test_every_difference_of_the_model_reaches_the_controller(change: dict[str, float]) -> None:
    """Another model gives other commands, and still tracks: the tip error is measured on the plant."""
    shared, other = run(scenario({"kind": "shared"})), run(scenario({**TWIN, **change}))
    assert other.digest != shared.digest
    (name, value), plain = next(iter(change.items())), rmse_commanded_mm(shared)
    text, source = (
        f"separate model with {name} = {value:g}: tip RMSE above the shared model's",
        "feedback from the plant",
    )
    worse, bound = max(rmse_commanded_mm(other) - plain, 0.0), plain + 0.02
    verify("control", text, expected=0, measured=worse, tolerance=bound, source=source, unit="mm")


@pytest.mark.slow
@pytest.mark.parametrize("controller", [{"derivative": "exact"}, {"jacobian": "perturbation"}])
def test_every_jacobian_works_on_a_separate_model(controller: dict[str, Any]) -> None:
    model = {**TWIN, "young_kpa": 5.0}
    blocks = {"controller": {"kind": "ifem", "model": model, **controller}, "trajectory": {"target_mm": [13, 21, 3]}}
    assert rmse_commanded_mm(run(scenario(model, **blocks))) < 0.5


def test_a_soft_plant_with_a_stiff_model_still_knows_the_plant_s_tip() -> None:
    """The plant alone decides the observation: with a gain of 0 the model's tip may go where it likes."""

    class Poses:
        def __init__(self) -> None:
            self.base: list[np.ndarray[Any, Any]] = []

        def begin(self, scene: object, first: StepRecord) -> None: ...
        def end(self, rollout: Rollout) -> None: ...
        def step(self, record: StepRecord) -> None:
            self.base.append(record.base_position_m)

    still = {"gain": 0.0, "rcm_gain": 0.0}
    poses = Poses()
    blocks = {"controller": {"kind": "ifem", "model": TWIN, **still}}
    run(scenario(TWIN, **blocks), poses)
    assert np.ptp(np.array(poses.base), axis=0).max() < 1e-12


def test_failure_of_the_model_is_named_as_the_model_s(monkeypatch: pytest.MonkeyPatch) -> None:
    """The plant converges where the model, kept to one iteration, does not."""
    made = Separate.__init__

    def hurried(self: Separate, *arguments: Any) -> None:
        made(self, *arguments)
        self.insertion = self.insertion.with_tolerances(replace(self.insertion.model.tolerances, max_iterations=1))
        self.state = self.insertion.initial_state(arguments[0].path().first_tangent())
        self.derivative = derivative(self.insertion, arguments[1])

    monkeypatch.setattr(Separate, "__init__", hurried)
    rollout = run(scenario(TWIN))
    assert rollout.status is Status.NOT_CONVERGED
    assert rollout.message.startswith("step 3 of 52, depth 0.0 mm: ")
    assert "the controller's model: residual" in rollout.message
    assert rollout.metrics["stable"] is False


def test_scenario_of_the_model_differs_in_its_own_fields_only() -> None:
    plant = scenario(
        {**TWIN, "young_kpa": 5.0, "poisson": 0.3, "friction": 0.2, "element_size_mm": 12.0, "spacing_mm": 13.0}
    )
    assert isinstance(ifem(plant).model, SeparateModel)
    own = model_scenario(plant, ifem(plant).model)  # type: ignore[arg-type]
    assert (own.tissue.young_kpa, own.tissue.poisson, own.tissue.element_size_mm) == (5.0, 0.3, 12.0)
    assert (own.interaction.friction, own.interaction.spacing_mm) == (0.2, 13.0)
    mine = {"tissue": {"young_kpa", "poisson", "element_size_mm"}, "interaction": {"friction", "spacing_mm"}}
    for block, value in plant:
        if block in mine:
            assert value.model_dump(exclude=mine[block]) == getattr(own, block).model_dump(exclude=mine[block])
        else:
            assert value == getattr(own, block)


def test_shared_is_the_default_and_the_resolved_scenario_is_complete() -> None:
    assert ifem(Scenario()).model == SharedModel()
    assert ifem(Scenario()).jacobian == "constraint"
    assert ifem(Scenario()).derivative == "fast"
    assert ifem(Scenario()).perturbation_mm == 0.05
    loaded = Scenario.load({"controller": {"model": {"kind": "separate", "element_size_mm": 8}}})
    assert ifem(loaded).model.spacing_mm == 3.0  # type: ignore[union-attr]
    assert Scenario.load(loaded.resolved()) == loaded
    hard = Scenario.load({"controller": {"model": {"kind": "separate", "element_size_mm": 8}}, **HARD})
    assert ifem(hard).model.spacing_mm == 8.0  # type: ignore[union-attr]


def test_setting_a_kind_replaces_the_block_by_the_defaults_of_the_new_kind() -> None:
    changed = with_changes(
        preset("line").resolved(), ["controller.model.kind=separate", "controller.model.young_kpa=5"]
    )
    assert changed["controller"]["model"] == {"kind": "separate", "young_kpa": 5}
    assert ifem(Scenario.load(changed)).model == SeparateModel(young_kpa=5.0, spacing_mm=3.0)
    back = with_changes(Scenario.load(changed).resolved(), ["controller.model.kind=shared"])
    assert back["controller"]["model"] == {"kind": "shared"}
    again = with_changes(Scenario.load(changed).resolved(), ["controller.model.kind=separate"])
    assert again["controller"]["model"]["young_kpa"] == 5.0


@pytest.mark.parametrize(
    ("controller", "field", "text"),
    [
        ({"model": {"kind": "other"}}, "controller.model.kind", "must be one of shared, separate"),
        ({"model": {"young_kpa": 5}}, "controller.model.young_kpa", "unknown field; known here: kind"),
        ({"model": {"kind": "separate", "yung": 5}}, "controller.model.yung", "element_size_mm, friction, kind"),
        ({"model": {"kind": "separate", "young_kpa": 0}}, "controller.model.young_kpa", "0.1 to 1000"),
        ({"model": {"kind": "separate", "spacing_mm": 0.4}}, "controller.model.spacing_mm", "0.5 to 50"),
        ({"model": {"kind": "separate", "element_size_mm": 1}}, "controller.model.element_size_mm", "272304 cells"),
        ({"perturbation_mm": 0.01}, "controller.perturbation_mm", "0.05 to 1"),
        ({"jacobian": "exact"}, "controller.jacobian", "'constraint' or 'perturbation'"),
    ],
)
def test_wrong_fields_are_named(controller: dict[str, Any], field: str, text: str) -> None:
    """Also where a block leaves out its kind: the default kind is no part of the field's name."""
    for kind in ({}, {"kind": "ifem"}):
        with pytest.raises(ScenarioError) as error:
            Scenario.load({"controller": {**kind, **controller}})
        assert [problem.field for problem in error.value.problems] == [field]
        assert text in str(error.value)


def test_a_rough_model_is_warned_about() -> None:
    loaded = Scenario.load({"controller": {"model": {"kind": "separate", "friction": 0.5}}})
    assert loaded.warnings() == ["controller.model.friction = 0.5: above 0.3 the friction law is far from associated"]
