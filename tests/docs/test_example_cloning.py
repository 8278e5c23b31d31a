"""The program that clones I-FEM: its policy steers, and the page has its numbers."""

from __future__ import annotations

import pytest

from tests.docs.sources import program


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:Stochastic Optimizer:UserWarning")
def test_a_cloned_policy_steers() -> None:
    cloning = program("example_cloning")
    found = cloning.compare(cloning.DEPTH_MM, cloning.TRAINING, cloning.TEST)
    errors = {name: cloning.rmse_mm(insertions) for name, insertions in found.items()}
    assert errors["I-FEM"] == pytest.approx(0.005, abs=0.001)
    assert errors["open loop"] == pytest.approx(0.841, abs=0.01)
    assert errors["I-FEM"] < errors["cloned policy"] < 0.5 * errors["open loop"]  # as trained elsewhere it may differ
    assert cloning.figure(found).count("RMSE") == 3
