"""Every built-in scenario gives its golden numbers again: error, push and remote centre to 1e-6."""

from __future__ import annotations

import json

import pytest

from tests.benchmarks.golden import FILE, KEPT, SCHEMA, changes_of_cases, measure, origin

GOLDEN = json.loads(FILE.read_text())
TO_THE_NANOMETRE = ("rmse_commanded_mm", "rcm_mean_mm", "rcm_max_mm", "max_push_n")  # and to the micronewton
SAME_MACHINE = 1e-6  # mm, N
OTHER_MACHINE = 1e-3  # mm, N: twice the furthest that two kinds of x86-64 processors were seen apart


def test_the_file_has_every_built_in_scenario() -> None:
    assert GOLDEN["schema"] == SCHEMA
    assert list(GOLDEN["cases"]) == list(changes_of_cases())
    assert all(tuple(case["metrics"]) == KEPT for case in GOLDEN["cases"].values())


@pytest.mark.slow
@pytest.mark.parametrize("case", list(changes_of_cases()))
def test_a_built_in_scenario_gives_its_golden_numbers(case: str) -> None:
    """Another processor may differ in the last digits: its libraries take other instructions.

    Measure them again with `python -m tests.benchmarks.golden`, and say in the changelog why they changed.
    """
    golden, found = GOLDEN["cases"][case], measure(case)
    same = origin()["cpu"] == GOLDEN["provenance"]["cpu"]
    tolerance = SAME_MACHINE if same else OTHER_MACHINE
    assert found["status"] == golden["status"]
    for name, value in golden["metrics"].items():
        if name in TO_THE_NANOMETRE:
            assert found["metrics"][name] == pytest.approx(value, rel=0.0, abs=tolerance), name
        elif isinstance(value, float):
            assert found["metrics"][name] == pytest.approx(value, rel=1e-3, abs=tolerance), name
        else:
            assert found["metrics"][name] == value, name
