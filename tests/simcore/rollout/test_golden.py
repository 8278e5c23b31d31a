"""What the built-in scenarios measured when golden.json was written: an unintended change of the results is seen here.

Digests are compared to the bit on one machine only; these numbers hold everywhere.
"""

from __future__ import annotations

import json

import pytest

from simcore.scenario.presets import preset_names
from tests.simcore.rollout.golden import FILE, MEASURES, machine, measured

GOLDEN = json.loads(FILE.read_text())
SAME_MACHINE = 1e-6  # mm, N: the solver's tolerances are 1e-5 mm and 1e-5 N a step, and repeat to the bit
OTHER_MACHINE = 1e-3  # mm, N: twice the worst that was seen between two kinds of x86-64 processors, 5e-4 mm


def test_every_built_in_scenario_has_golden_numbers() -> None:
    assert list(GOLDEN["scenarios"]) == list(preset_names())


@pytest.mark.parametrize("name", preset_names())
def test_golden_numbers(name: str) -> None:
    """Refresh them with `python -m tests.simcore.rollout.golden`, and say in the change log why they changed."""
    golden, found = GOLDEN["scenarios"][name], measured(name)
    tolerance = SAME_MACHINE if machine() == GOLDEN["cpu"] else OTHER_MACHINE
    apart = {measure: abs(found[measure] - golden[measure]) for measure in MEASURES}
    assert not {measure: gap for measure, gap in apart.items() if not gap <= tolerance}, (golden, found)
