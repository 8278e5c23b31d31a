"""Every built-in scenario gives its golden numbers again: error, push and remote centre to 1e-6."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

import pytest

from tests.benchmarks import golden
from tests.benchmarks.golden import FILE, KEPT, SCHEMA, changes_of_cases, origin, scenario_of

GOLDEN = json.loads(FILE.read_text())
TO_THE_NANOMETRE = ("rmse_commanded_mm", "rcm_mean_mm", "rcm_max_mm", "max_push_n")  # and to the micronewton
SAME_MACHINE = 1e-6  # mm, N
OTHER_MACHINE = 1e-3  # mm, N: for processors that are no x86-64, on which nobody has tried it


@cache
def measure(case: str) -> dict[str, Any]:
    return golden.measure(case)


def test_the_file_has_every_built_in_scenario() -> None:
    assert GOLDEN["schema"] == SCHEMA
    assert list(GOLDEN["cases"]) == list(changes_of_cases())
    assert all(tuple(case["metrics"]) == KEPT for case in GOLDEN["cases"].values())


@pytest.mark.slow
@pytest.mark.parametrize("case", list(changes_of_cases()))
def test_a_built_in_scenario_gives_its_golden_numbers(case: str) -> None:
    """Every x86-64 processor gives the same bits; what others may differ by is a guess.

    Measure them again with `make golden`, and say in the changelog why they changed.
    """
    pinned, found = GOLDEN["cases"][case], measure(case)
    same = origin()["cpu"] == GOLDEN["provenance"]["cpu"]
    tolerance = SAME_MACHINE if same else OTHER_MACHINE
    assert found["status"] == pinned["status"]
    for name, value in pinned["metrics"].items():
        if name in TO_THE_NANOMETRE:
            assert found["metrics"][name] == pytest.approx(value, rel=0.0, abs=tolerance), name
        elif isinstance(value, float):
            assert found["metrics"][name] == pytest.approx(value, rel=1e-3, abs=tolerance), name
        else:
            assert found["metrics"][name] == value, name


@pytest.mark.slow
@pytest.mark.parametrize("case", [name for name in changes_of_cases() if "open loop" not in name])
def test_the_needle_of_a_built_in_scenario_stays_below_half_of_its_yield_stress(case: str) -> None:
    found = measure(case)
    assert found["metrics"]["success"]
    assert 0.0 < found["metrics"]["max_needle_stress_mpa"] < 0.5 * scenario_of(case).needle.yield_mpa
