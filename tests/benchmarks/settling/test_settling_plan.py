"""The settling experiment's plan: counts, paths, what each cell varies, and that it never changes unnoticed."""

from __future__ import annotations

import re
from collections import Counter
from typing import Any

import pytest

from benchmarks.paper.sampling import end_points_mm
from benchmarks.paper.scale import scale_of
from benchmarks.paper.suites import AMPLITUDE_MM
from benchmarks.settling.cells import cells, elm_cells, ifem_cells, planned_pairs
from benchmarks.settling.plan import CELL, SettlingPlan, paths
from benchmarks.settling.plants import PLANTS
from benchmarks.settling.scale import END_POINTS, EXPLORED, SCALES, SettlingScale
from simcore.errors import ScenarioError
from simcore.scenario.scenario import Scenario

FULL = SettlingPlan(SCALES["full"])
# Of scale, ids, labels, scenarios, the data sets' defaults included: may change only before the experiment is run, or
# where a new block leaves every insertion as it was (`sensing`, whose defaults hide nothing, came after settling-1).
FULL_SHA256 = "ae27cc07f1f144ab1af1e5b5a12f3c1b567907304cc83af39d19b48ca0e27e5c"


def test_the_plan_is_the_one_that_was_fixed() -> None:
    assert FULL.sha256 == FULL_SHA256


def test_there_are_20_cells_of_80_paths_each() -> None:
    data_one, data_other, tests = FULL.stages
    assert [len(stage.cases) for stage in FULL.stages] == [105, 105, 1600]
    assert (data_one.trains, data_other.trains, tests.trains) == (True, True, False)
    counts = Counter(case.labels[CELL] for case in tests.cases)
    assert len(counts) == 20
    assert set(counts.values()) == {80}
    everything = {(case.labels["end_point"], case.labels["direction"]) for case in tests.cases}
    assert len(everything) == 80
    assert Counter(point for point, _ in everything) == dict.fromkeys(END_POINTS, 4)
    for cell in counts:
        mine = {(c.labels["end_point"], c.labels["direction"]) for c in tests.cases if c.labels[CELL] == cell}
        assert mine == everything


def test_ids_are_unique_and_good_as_file_names() -> None:
    ids = [case.id for stage in FULL.stages for case in stage.cases]
    assert len(set(map(str.lower, ids))) == len(ids) == FULL.insertions
    assert not [case_id for case_id in ids if not re.fullmatch(r"[A-Za-z0-9._+-]{1,80}", case_id)]


def test_the_end_points_are_spread_by_a_rule_that_knows_no_result() -> None:
    """The first of CUR's in each of 4 x 5 equal parts of the face between its margins of 2 mm, explored ones apart."""
    first: dict[tuple[int, int], int] = {}
    for number, (x, y, _) in enumerate(end_points_mm()):
        if number not in EXPLORED:
            first.setdefault((int((x - 2.0) / 32.0 * 4), int((y - 2.0) / 58.0 * 5)), number)
    assert len(first) == 20
    assert tuple(sorted(first.values())) == END_POINTS


def test_what_the_cells_vary() -> None:
    scale = SCALES["full"]
    assert (len(ifem_cells(scale)), len(elm_cells(scale)), len({cell.name for cell in cells(scale)})) == (16, 4, 20)
    rows = [cell for cell in ifem_cells(scale) if cell.rows != "axis"]
    assert {(c.plant.name, c.delay_s, c.rows) for c in rows} == {
        (plant.name, delay, weight) for plant in PLANTS for delay in (0.0, 0.02) for weight in (1.0, 0.1, 0.0)
    }
    assert {(c.plant.name, c.delay_s) for c in elm_cells(scale)} == {
        (plant.name, delay) for plant in PLANTS for delay in (0.0, 0.01)
    }


def resolved(name: str) -> dict[str, Any]:
    (case,) = (case for case in FULL.stages[-1].cases if case.id == name)
    return Scenario.load(case.scenario).resolved()


def test_what_a_cell_is_as_a_scenario() -> None:
    plain = resolved("cur-003+y-ifem-converged-0ms-rows-0")
    assert (plain["dt_s"], plain["noise_mm"], plain["solver"]["mode"]) == (0.01, 0.0, "converged")
    assert (plain["tissue"]["element_size_mm"], plain["tissue"]["density_kg_m3"]) == (6.0, 0.0)
    assert (plain["trajectory"]["amplitude_mm"], plain["trajectory"]["direction"]) == (AMPLITUDE_MM, [0.0, 1.0, 0.0])
    assert AMPLITUDE_MM == 1.0
    assert (plain["controller"]["rcm_weight"], plain["controller"]["orientation"]) == (0.0, "rcm")
    other = resolved("cur-003+y-ifem-linearised-20ms-axis")
    assert (other["tissue"]["density_kg_m3"], other["solver"]["mode"]) == (1000.0, "linearised")
    assert (other["controller"]["delay_s"], other["controller"]["orientation"]) == (0.02, "axis")


def test_each_elm_is_trained_on_the_plant_that_it_steers_and_compared_on_it_undelayed() -> None:
    tests = {case.id: case for case in FULL.stages[-1].cases}
    for plant in PLANTS:
        assert tests[f"cur-000+x-elm-{plant.name}-10ms"].scenario["controller"] == {
            "kind": "elm",
            "delay_s": 0.01,
            "model": f"models/elm-{plant.name}.json",
        }
        (data,) = (stage for stage in FULL.stages if stage.title.endswith(plant.name))
        for case in data.cases:
            assert case.scenario["solver"]["mode"] == plant.mode
            assert case.scenario["tissue"]["density_kg_m3"] == plant.density_kg_m3
    pairs = planned_pairs(SCALES["full"])
    assert len(pairs) == 16
    assert all(elm.delay_s == 0.0 and elm.plant == ifem.plant and elm.arm == "elm" for elm, ifem in pairs)
    assert [ifem for _, ifem in pairs] == ifem_cells(SCALES["full"])


def test_a_smaller_scale_is_part_of_the_plan() -> None:
    small = SettlingScale(name="small", end_points=3, directions=2)
    assert [path.name for path in paths(small)] == [
        *("cur-000+x", "cur-000-x", "cur-001-x", "cur-001+y", "cur-003+y", "cur-003-y")
    ]
    known = {case.id: case for case in FULL.stages[-1].cases}
    assert all(known[case.id] == case for case in SettlingPlan(small).stages[-1].cases)


@pytest.mark.slow
def test_a_named_model_needs_no_data_set() -> None:
    plan = SettlingPlan(SettlingScale(name="mine", converged_model="mine.json"))
    assert [stage.title for stage in plan.stages] == ["data, linearised", "cells"]
    models = {c.scenario["controller"]["model"] for c in plan.stages[-1].cases if c.labels["arm"] == "elm"}
    assert models == {"mine.json", "models/elm-linearised.json"}


def test_budget_and_margin_are_no_fields() -> None:
    with pytest.raises(ScenarioError, match=r"end_points = 21.*\n.*budget_mm"):
        scale_of({"name": "mine", "end_points": 21, "budget_mm": 2.0}, SettlingScale, field="--scale")
    assert scale_of({"name": "mine", "band_mm": 0.1}, SettlingScale, field="--scale").band_mm == 0.1
    assert SettlingPlan(SettlingScale(name="full", band_mm=0.1, band_difference_mm=0.2)).sha256 == FULL.sha256
