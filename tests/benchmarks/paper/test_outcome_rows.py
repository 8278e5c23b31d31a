"""The table of insertions: a row each, failures by name, places of failures, chosen cases."""

from __future__ import annotations

import csv
import io
import math
from typing import Any

import pytest

from benchmarks.cases import Case, Outcome
from benchmarks.paper.analysis import scores
from benchmarks.paper.comparison import as_json
from benchmarks.paper.failure_places import border_mm, face_mm, notable_cases, spots
from benchmarks.paper.statistics import Interval
from benchmarks.paper.table import Row, by_group, insertions_csv, only, rows
from tests.benchmarks.paper.made_up_evidence import pair
from tests.benchmarks.paper.synthetic import (
    MEDIANS_MM,
    experiments,
    labelled,
    outcome,
    scenario,
)


def test_a_row_keeps_what_was_measured() -> None:
    row = rows([outcome("a", 0.25, labelled("CUR", "elm", 7, "-y"), end_mm=(10.0, 60.0))])[0]
    assert (row.group, row.arm, row.end_point, row.direction) == ("CUR", "elm", "7", "-y")
    assert (row.rmse_commanded_mm, row.stable, row.failed) == (0.25, True, False)
    assert row.end_mm == (10.0, 60.0)
    assert row.timing_ms["mean_step"] == pytest.approx(1.1 * 2.65)
    assert border_mm(row) == 2.0


def test_a_failure_ranks_worst_and_keeps_its_name() -> None:
    row = rows([outcome("a", math.inf)])[0]
    assert row.rmse_commanded_mm == math.inf
    assert row.status == "not_converged"
    assert row.metrics["rmse_commanded_mm"] == 0.5  # of the steps before it


@pytest.mark.parametrize("result", [{}, {"status": "crashed", "metrics": None, "timing": None}])
def test_a_crash_without_any_result_is_a_failure(result: dict[str, Any]) -> None:
    crashed = Outcome(Case("c", scenario((18.0, 31.0)), {}), result)
    row = rows([crashed])[0]
    assert row.failed
    assert "c," in insertions_csv([row])
    assert scores([row])[0].failed == 1


def test_labels_that_are_missing_follow_from_the_scenario() -> None:
    plain = Case("x", {**scenario((10.0, 20.0), kind="rigid"), "noise_mm": 0.25}, {})
    row = rows([Outcome(plain, {})])[0]
    assert (row.arm, row.noise, row.young, row.end_point) == ("rigid", "on", "", "10 20")


def test_the_csv_has_a_line_for_each_insertion_at_full_precision() -> None:
    table = rows(experiments(2))
    read = list(csv.DictReader(io.StringIO(insertions_csv(table))))
    assert [line["id"] for line in read] == [row.id for row in table]
    for line, row in zip(read, table, strict=True):
        assert float(line["rmse_commanded_mm"]) == row.metrics["rmse_commanded_mm"]
        assert line["arm"] == row.arm
        assert float(line["plant_median_ms"]) == 1.9
        assert line["stable"] == ("yes" if row.stable else "no")
    assert "" not in read[0]


def test_spots_count_failures_by_end_point() -> None:
    table = rows(experiments(8))
    found = [s for s in spots(table) if s.young == "variable"]
    assert sum(s.failed for s in found) == sum(row.failed for row in only(table, young="variable"))
    assert all(s.insertions == 5 for s in found)
    assert face_mm(table) == (36.0, 62.0)


def test_chosen_cases_are_best_median_worst_and_failed() -> None:
    table = rows(pair("CUR", [0.3, 0.1, math.inf, 0.2, 0.5], []))
    assert notable_cases(table) == [
        ("CUR-001-ifem", "best"),
        ("CUR-000-ifem", "median"),
        ("CUR-004-ifem", "worst"),
        ("CUR-002-ifem", "failed"),
    ]


def test_not_finite_becomes_null() -> None:
    assert as_json({"a": Interval(0.0, math.inf), "b": (math.nan, 1)}) == {"a": [0.0, None], "b": [None, 1]}


def test_groups_other_than_the_papers_are_welcome() -> None:
    table: list[Row] = rows([outcome(str(i), 0.1, {"group": name}) for i, name in enumerate(("soft", "LIN", "DATA"))])
    assert list(by_group(table)) == ["LIN", "soft", "ALL"]


@pytest.mark.slow
def test_medians_of_the_synthetic_experiments() -> None:
    """What the other tests rest on."""
    found = {(s.group, s.arm): s.median_mm for s in scores(rows(experiments(40))) if s.young == "constant"}
    assert found["CUR", "elm"] == pytest.approx(MEDIANS_MM["CUR", "elm"], rel=0.1)
