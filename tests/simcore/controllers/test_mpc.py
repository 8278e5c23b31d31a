"""The controller that looks ahead: better than not looking, the same every time, honest when its model fails."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from needlebench import Observation, Pose
from needlebench.mpc import SamplingController
from simcore.plugins import register_controller
from simcore.rollout.rollout import run
from tests.simcore.short_run import short

SETTINGS = {"horizon": 2, "samples": 4, "rounds": 2, "spread_mm": 0.5}


@pytest.fixture(autouse=True)
def known() -> None:
    register_controller("mpc", SamplingController)


def plugin(**settings: Any) -> dict[str, Any]:
    return {"kind": "plugin", "name": "mpc", "settings": {**SETTINGS, **settings}}


@pytest.mark.slow
def test_it_steers_better_than_an_open_loop_and_twice_the_same() -> None:
    steered, again, blind = (
        run(short(noise_mm=0.0, controller=block)) for block in (plugin(), plugin(), {"kind": "open_loop"})
    )
    assert steered.digest == again.digest
    error, without = (one.metrics["rmse_commanded_mm"] for one in (steered, blind))
    assert error < 0.7 * without  # in steps of a millimetre
    assert run(short(noise_mm=0.0, seed=12, controller=plugin())).digest != steered.digest  # other samples


@pytest.mark.parametrize(
    ("settings", "told"), [({"samples": 0}, "'samples': 0"), ({"Horizon": 2}, r"unknown settings \['Horizon'\]")]
)
def test_settings_that_make_no_sense_are_named(settings: dict[str, Any], told: str) -> None:
    with pytest.raises(ValueError, match=told):
        SamplingController(short(), np.zeros(3), 0.08, settings)


def test_a_model_that_has_ended_leaves_the_last_move() -> None:
    controller = SamplingController(short(noise_mm=0.0), 1e-3 * np.array([12.0, 20.0, 0.0]), 0.08, SETTINGS)
    controller.reset(0)
    controller.move_m = np.array([0.0, 0.0, 1e-3])
    while not controller.model.done:
        controller.model.step(controller.model.state.base)
    base = controller.model.state.base
    seen = Observation(step=3, base=base, tip_m=np.zeros(3), target_m=np.zeros(3))
    commanded = controller.command(seen)
    assert isinstance(commanded, Pose)
    np.testing.assert_allclose(commanded.position_m, base.position_m + controller.move_m)
