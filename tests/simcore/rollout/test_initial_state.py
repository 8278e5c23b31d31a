"""An initial state that is no equilibrium is a named failure wherever a run or a controller begins."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from simcore.arrays import Floats
from simcore.controllers import Observation
from simcore.controllers.frozen_jacobian import straight_jacobian
from simcore.controllers.plant_model import Separate
from simcore.errors import ModelFailureError, Status
from simcore.insertion.insertion import Insertion, InsertionState
from simcore.rollout.rollout import run
from simcore.scenario.scenario import FrozenJacobian, InverseFem, SeparateModel
from tests.simcore.short_run import short


@pytest.fixture
def unsettled(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every initial state says that it has not converged."""
    made = Insertion.initial_state

    def initial_state(self: Insertion, tangent: Floats) -> InsertionState:
        state = made(self, tangent)
        report = replace(state.report, status=Status.NOT_CONVERGED, message="no equilibrium at the start")
        return replace(state, report=report)

    monkeypatch.setattr(Insertion, "initial_state", initial_state)


@pytest.mark.usefixtures("unsettled")
def test_a_run_ends_before_its_first_step() -> None:
    rollout = run(short(controller={"kind": "open_loop"}))
    assert rollout.status is Status.NOT_CONVERGED
    assert rollout.message == "no equilibrium at the start"
    assert len(rollout.series["t_s"]) == 1
    assert not rollout.success


@pytest.mark.usefixtures("unsettled")
def test_a_frozen_jacobian_is_not_taken_from_there() -> None:
    with pytest.raises(ModelFailureError, match="insertion for the frozen Jacobian: no equilibrium at the start"):
        straight_jacobian(FrozenJacobian(depth_mm=5.0), short(controller={"kind": "frozen"}))


@pytest.mark.usefixtures("unsettled")
def test_a_separate_model_is_not_linearised_there() -> None:
    scenario = short(controller={"kind": "ifem", "model": {"kind": "separate", "element_size_mm": 10.0}})
    assert isinstance(scenario.controller, InverseFem)
    assert isinstance(scenario.controller.model, SeparateModel)
    model = Separate(scenario, scenario.controller, scenario.controller.model)
    with pytest.raises(ModelFailureError, match="no equilibrium at the start"):
        model(Observation(0, model.state.base, model.state.tip_m, model.state.tip_m))


def test_a_settled_start_is_none_of_this() -> None:
    assert np.isfinite(straight_jacobian(FrozenJacobian(depth_mm=5.0), short(controller={"kind": "frozen"}))).all()
