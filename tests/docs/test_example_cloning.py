"""The program that clones I-FEM, in short: its policy steers, and is better than no feedback."""

from __future__ import annotations

import pytest

from tests.docs.sources import program


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:Stochastic Optimizer:UserWarning")
def test_a_cloned_policy_steers() -> None:
    cloning = program("example_cloning")
    found = cloning.compare(25.0, range(6), range(100, 102))
    errors = {name: cloning.rmse_mm(insertions) for name, insertions in found.items()}
    assert errors["I-FEM"] < errors["cloned policy"] < errors["open loop"]
    assert errors["cloned policy"] < 0.6
    assert cloning.figure(found).count("RMSE") == 3
