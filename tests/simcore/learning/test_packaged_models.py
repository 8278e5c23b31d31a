"""The models that come along: whole, small, of the paper's size, trained at the defaults, and they steer."""

from __future__ import annotations

from typing import Any

import pytest

from simcore.learning import ExtremeLearningMachine, load_model
from simcore.learning.trained import PACKAGED
from simcore.rollout.rollout import run
from simcore.scenario.scenario import Learned, Scenario

KINDS = ["elm", "linear", "mlp"]
CURVE = {"kind": "sine", "target_mm": [13.0, 22.0, 122.0], "amplitude_mm": 1.0, "direction": [0.0, -1.0, 0.0]}


def scenario(kind: str, **fields: Any) -> Scenario:
    return Scenario.load({"controller": {"kind": kind}, "recording": {"enabled": False}, **fields})


@pytest.mark.parametrize("kind", KINDS)
def test_it_is_there_small_and_trained_at_the_defaults(kind: str) -> None:
    assert (PACKAGED / f"{kind}.json").stat().st_size < 100_000
    asked = scenario(kind)
    assert asked.warnings() == []
    block = asked.controller
    assert isinstance(block, Learned)
    assert block.model == "default"
    assert block.model_sha256
    told = load_model(kind, "default", block.model_sha256).provenance
    assert (told["insertions"], told["split"], told["trained_on"]["noise_mm"]) == (105, "sample", 0.25)
    assert told["train_rows"] + told["test_rows"] == 10_000
    assert max(told["test_rmse_mm"]) < 0.5


def test_the_elm_is_the_papers() -> None:
    block = scenario("elm").controller
    assert isinstance(block, Learned)
    assert block.model_sha256
    machine = load_model("elm", "default", block.model_sha256).regressor
    assert isinstance(machine, ExtremeLearningMachine)
    assert machine.arrays["w"].shape == (25, 6)
    assert machine.arrays["beta"].shape == (25, 3)


def test_nothing_else_lies_there() -> None:
    assert sorted(path.name for path in PACKAGED.iterdir()) == sorted(f"{kind}.json" for kind in KINDS)


@pytest.mark.parametrize("kind", KINDS)
def test_softer_tissue_or_another_step_is_a_warning(kind: str) -> None:
    told = scenario(kind, tissue={"young_kpa": 5.5}, dt_s=0.02).warnings()
    assert [text.split(" = ")[0] for text in told] == ["dt_s", "tissue.young_kpa"]


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_it_steers_along_a_curve_that_it_never_saw(kind: str) -> None:
    """Sub-millimetric, and at most 0.4 of what the same path is without steering."""
    steered, open_loop = (run(scenario(k, trajectory=CURVE)) for k in (kind, "open_loop"))
    assert steered.success, steered.message
    assert steered.metrics["rmse_commanded_mm"] < 0.4 * open_loop.metrics["rmse_commanded_mm"] < 0.4
    assert steered.metrics["max_commanded_mm"] < 1.0
