"""The settling experiment's analysis on hand-made tables: budget, failures, ties, Holm, band, families, page."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from benchmarks.paper import statistics
from benchmarks.paper.bands import Bands
from benchmarks.paper.evidence import NOT_REPRODUCED, REPRODUCED, UNDECIDED
from benchmarks.paper.table import rows
from benchmarks.settling.analysis import Planned, band_of, families, planned_comparisons, together
from benchmarks.settling.cells import AXIS, cells, planned_pairs
from benchmarks.settling.markdown import markdown
from benchmarks.settling.report import document, html, write
from benchmarks.settling.scale import SettlingScale
from benchmarks.settling.scores import BUDGET_MM, score, within_budget
from tests.benchmarks.paper.synthetic import DIRECTIONS, labelled, outcome

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from benchmarks.cases import Outcome
    from benchmarks.settling.cells import Cell

SCALE = SettlingScale(name="full", band_mm=0.001, band_difference_mm=0.001)
BESIDE_MM = 0.004  # of each insertion: its distance from the path
Measure = tuple[float, float | None]  # tip RMSE (infinite: failed), largest RCM error; mm


PAIR = ("elm-converged-0ms", "ifem-converged-0ms-rows-1")  # of the first planned comparison
ALL = tuple(cell.name for cell in cells(SCALE))


def made(measure: Any, *, end_points: int = 20, names: Sequence[str] = PAIR) -> list[Outcome]:
    """An insertion for each of these cells and each path, of which measure(cell, end point, number of the direction)
    tells both; None: none."""
    found = []
    for cell in [cell for cell in cells(SCALE) if cell.name in names]:
        for point in range(end_points):
            for number, direction in enumerate(DIRECTIONS):
                if (values := measure(cell, point, number)) is None:
                    continue
                labels = labelled("CUR", cell.arm, point, direction, cell=cell.name, plant=cell.plant.name)
                one = outcome(f"cur-{point:03}{direction}-{cell.name}", values[0], labels)
                one.result["metrics"] |= {"rcm_max_mm": values[1], "max_push_n": 2.0, "entry_drag_mm": 0.4}
                one.result["metrics"] |= {"cross_track_rmse_mm": BESIDE_MM}
                found.append(one)
    return found


def planned(outcomes: Sequence[Outcome], scale: SettlingScale = SCALE) -> list[Planned]:
    return planned_comparisons(rows(outcomes), scale)


def verdict(outcomes: Sequence[Outcome], scale: SettlingScale = SCALE) -> str:
    return planned(outcomes, scale)[0].claim.verdict


def elm_is(change_mm: float) -> Any:
    return lambda cell, point, number: (
        0.3 + 0.01 * point + 0.001 * number + (change_mm if cell.arm == "elm" else 0.0),
        0.5,
    )


# ---- Holm


def test_holm_by_hand() -> None:
    np.testing.assert_allclose(statistics.holm([0.01, 0.04, 0.03, 0.005]), [0.03, 0.06, 0.06, 0.02], rtol=1e-12)
    np.testing.assert_allclose(statistics.holm([0.5, 0.02, math.nan]), [1.0, 0.06, 1.0], rtol=1e-12)
    assert statistics.holm([]).size == 0


@pytest.mark.slow
def test_holm_counts_all_16_whether_they_could_be_made_or_not() -> None:
    def one_plant(cell: Cell, point: int, number: int) -> Measure | None:
        measured = elm_is(-0.1)(cell, point, number)
        return measured if cell.plant.name == "converged" and cell.rows in (None, 1.0) else None

    found = [one for one in planned(made(one_plant, end_points=10, names=ALL)) if one.budget]
    assert len(found) == 2
    for one in found:
        assert one.budget
        assert one.budget.p_primary == pytest.approx(2.0 * 0.5**10)  # below 0.01 alone ...
        assert one.p_holm == pytest.approx(16 * 2.0 * 0.5**10)  # ... and not among 16
        assert one.claim.verdict == UNDECIDED
        assert "not significantly over 10 end points" in one.claim.reason


# ---- verdicts


def test_each_verdict() -> None:
    assert verdict(made(elm_is(-0.2))) == REPRODUCED
    assert verdict(made(elm_is(+0.2))) == NOT_REPRODUCED
    assert verdict(made(elm_is(0.0))) == UNDECIDED
    assert {one.claim.verdict for one in planned([])} == {UNDECIDED}


@pytest.mark.slow
def test_ties_are_left_out_of_the_test_and_told() -> None:
    def half(cell: Cell, point: int, number: int) -> Measure:
        return elm_is(-0.2 if point < 9 else 0.0)(cell, point, number)

    (one, *_) = planned(made(half))
    assert one.budget
    assert (one.budget.clusters_below, one.budget.clusters_above, one.budget.clusters_tied) == (9, 0, 11)
    assert one.budget.p_primary == pytest.approx(2.0 * 0.5**9)
    assert one.claim.verdict == UNDECIDED  # the median end point is a tie
    (level, *_) = planned(made(elm_is(0.0)))
    assert level.p_holm == 1.0
    assert level.claim.reason.startswith("the two are level")


def test_an_end_point_is_one_trial_however_many_directions_it_has() -> None:
    def one_direction(cell: Cell, point: int, number: int) -> Measure:
        return elm_is(-0.2 if number == 0 else 0.02)(cell, point, number)

    (one, *_) = planned(made(one_direction))
    assert one.budget
    assert (one.budget.pairs, one.budget.clusters) == (80, 20)
    assert one.budget.difference_mm == pytest.approx(0.02)
    assert one.claim.verdict == NOT_REPRODUCED


def test_a_difference_below_the_margin_is_told_and_one_inside_the_band_is_undecided() -> None:
    (small, *_) = planned(made(elm_is(-0.03)))
    assert small.claim.verdict == REPRODUCED
    assert "by less than the margin of 0.05 mm" in small.claim.reason
    (large, *_) = planned(made(elm_is(-0.2)))
    assert "margin" not in large.claim.reason
    unknown = {"band_mm": None, "band_difference_mm": None, "element_size_mm": 5.0}
    for changes in ({"band_difference_mm": 0.25}, {"band_mm": 0.11, "band_difference_mm": None}, unknown):
        scale = SCALE.model_copy(update=changes)
        (one, *_) = planned(made(elm_is(-0.2)), scale)
        assert one.claim.verdict == UNDECIDED
        assert "not decided by this discretisation" in one.claim.reason


def test_each_comparison_has_the_band_of_its_treatment_of_the_remote_centre() -> None:
    bands = Bands({"CUR": {"elm minus ifem": 0.01, "elm minus ifem-axis": 0.02}})
    for cell in cells(SCALE):
        if cell.arm == "ifem":
            one = band_of(cell, bands)
            assert one.mm == 0.02
            assert ("the wider" in one.of) is (cell.rows != AXIS)
    axis = next(cell for cell in cells(SCALE) if cell.rows == AXIS)
    rows_of_weight_one = next(cell for cell in cells(SCALE) if cell.rows == 1.0)
    other = Bands({"CUR": {"elm minus ifem": 0.03, "elm minus ifem-axis": 0.02}})
    assert (band_of(axis, other).mm, band_of(rows_of_weight_one, other).mm) == (0.02, 0.03)
    unknown = Bands({"CUR": {"elm minus ifem": None, "elm minus ifem-axis": 0.02}})
    assert (band_of(axis, unknown).mm, band_of(rows_of_weight_one, unknown).mm) == (0.02, None)


# ---- budget and failures


def test_what_is_above_the_budget_is_counted_and_left_out() -> None:
    """The ELM is ahead by far where it drags the entry, and behind in the one direction in which it does not."""

    def dragging(cell: Cell, point: int, number: int) -> Measure:
        if cell.arm == "ifem":
            return 0.3, BUDGET_MM  # the budget itself is inside
        return (0.4, 2.4) if number == 2 else (0.05, 2.5001)

    (one, *_) = planned(made(dragging))
    assert one.budget
    assert one.unrestricted
    assert (one.budget.pairs, one.budget.clusters, one.unrestricted.pairs) == (20, 20, 80)
    assert one.outside == (60, 0)
    assert (one.claim.verdict, one.claim_unrestricted.verdict) == (NOT_REPRODUCED, REPRODUCED)
    assert "outside of the budget of 2.5 mm: 60 of 80 ELM, 0 of 80 I-FEM" in one.claim.reason


@pytest.mark.slow
def test_without_a_pair_inside_the_budget_nothing_is_decided() -> None:
    found = planned(made(lambda cell, *_: (0.1, 3.0) if cell.arm == "elm" else (0.3, 0.2), names=ALL))
    assert {one.claim.verdict for one in found} == {UNDECIDED}
    assert {one.budget for one in found} == {None}
    assert {one.p_holm for one in found} == {1.0}
    assert {one.outside for one in found} == {(80, 0)}


def test_a_failure_inside_the_budget_ranks_behind_everything_and_one_outside_is_outside() -> None:
    def failing(rcm_mm: float | None) -> list[Outcome]:
        return made(lambda cell, *_: (math.inf, rcm_mm) if cell.arm == "elm" else (5.0, 0.2))

    for rcm_mm in (0.3, None):
        (inside, *_) = planned(failing(rcm_mm))
        assert inside.budget
        assert (inside.claim.verdict, inside.failed, inside.outside) == (NOT_REPRODUCED, (80, 0), (0, 0))
        assert inside.budget.difference_mm == math.inf
    (outside, *_) = planned(failing(4.0))
    assert (outside.budget, outside.failed, outside.outside) == (None, (80, 0), (80, 0))
    assert outside.claim_unrestricted.verdict == NOT_REPRODUCED


def test_a_completed_insertion_without_a_measured_rcm_error_is_not_inside() -> None:
    (row, *_) = rows(made(lambda *_: (0.1, None), end_points=1))
    assert not within_budget(row)


# ---- cells and families


def test_a_cell_shows_what_its_error_was_paid_with() -> None:
    def measure(cell: Cell, point: int, number: int) -> Measure:
        return (math.inf, 0.5) if number == 3 else (0.1 * (number + 1), 3.0 if number == 2 else 0.5 + 0.01 * point)

    (cell, *_) = cells(SCALE)
    outcomes = made(measure, end_points=7)
    found = score(cell, [row for row in rows(outcomes) if row.labels["cell"] == cell.name])
    assert (found.insertions, found.end_points, found.failed, found.over_budget) == (28, 7, 7, 7)
    assert found.rmse_mm.median == pytest.approx(0.25)  # 0.1, 0.2, 0.3 and a failure
    assert found.rmse_inside_mm.median == pytest.approx(0.2)  # 0.1, 0.2 and a failure
    assert found.cross_track_mm.median == BESIDE_MM  # the same three times, and a failure
    assert found.beside["rcm_max_mm"].median == pytest.approx(0.53)  # of stable ones: 0.53, 0.53, 3
    assert found.beside["max_push_n"].median == 2.0
    assert found.beside["rcm_max_mm"].interval.low >= 0.5
    assert math.isnan(score(cell, []).rmse_mm.median)


@pytest.mark.slow
def test_a_family_has_a_verdict_if_all_of_it_has() -> None:
    def by_plant(cell: Cell, point: int, number: int) -> Measure:
        return elm_is(-0.2 if cell.plant.name == "converged" else 0.2)(cell, point, number)

    found = planned(made(by_plant, names=ALL))
    everything, converged, linearised, *others = families(found)
    assert (everything.verdict, everything.reproduced, everything.not_reproduced) == (UNDECIDED, 8, 8)
    assert (converged.verdict, linearised.verdict) == (REPRODUCED, NOT_REPRODUCED)
    assert {other.verdict for other in others} == {UNDECIDED}
    assert len(others) == 2 + 4  # delays, treatments of the remote centre
    assert together("alone", found[:1]).verdict == REPRODUCED


# ---- the report


@pytest.mark.slow
def test_the_report_holds_everything_and_the_page_shows_it(tmp_path: Path) -> None:
    measure = elm_is(-0.2)
    outcomes = made(lambda *where: (math.inf, 0.5) if where[2] == 3 else measure(*where), names=ALL)
    page = write(outcomes, SCALE, tmp_path, {"plan_sha256": "abc"})
    tables, picture = tmp_path / "settling.md", tmp_path / "pareto.svg"
    others = {"settling.json", "settling.html", "cases.csv"}
    assert {path.name for path in tmp_path.iterdir()} == {tables.name, picture.name, *others}
    report = json.loads((tmp_path / "settling.json").read_text())
    assert (len(report["cells"]), len(report["planned"]), report["counts"]["insertions"]) == (20, 16, 1600)
    assert report["rules"]["budget_mm"] == BUDGET_MM
    assert report["rules"]["margin_mm"] == 0.05
    assert len((tmp_path / "cases.csv").read_text().splitlines()) == 1601
    text = page.read_text()
    for first, second in planned_pairs(SCALE):
        assert first.name in text
        assert second.name in text
    assert "band, ELM minus I-FEM, axis on CUR: 0.001 mm" in text
    assert "Bands of this discretisation (named by the scale): RMSE of a controller: 0.001 mm" in text
    assert html(report) == text
    drawn = picture.read_text()
    assert drawn.count("<circle") == 20
    assert drawn in text
    lines = tables.read_text().splitlines()
    assert "| all planned comparisons | reproduced | 16 | 0 | 0 |" in lines
    assert "| converged | 0 | rows with weight 1 | reproduced | 80 | 0.230 | 0.430 | −0.200 | 3e-05 | 0 / 0 |" in lines
    assert sum(line.startswith(("| ELM | ", "| I-FEM | ")) for line in lines) == 20


@pytest.mark.slow
def test_a_part_of_the_plan_has_a_page_too() -> None:
    outcomes = made(lambda cell, *_: (0.1, 3.0) if cell.arm == "elm" else None, end_points=1, names=ALL)
    assert "no pair of insertions to compare" in html(json.loads(json.dumps(document(outcomes, SCALE))))
    coarse = SettlingScale(name="coarse", element_size_mm=12.0)
    assert "Bands of this discretisation: unknown, so that nothing is decided." in html(document(outcomes, coarse))
    assert document([], SCALE)["cells"][0]["rmse_mm"]["median"] is None
    tables = markdown(json.loads(json.dumps(document(outcomes, SCALE))), drawn=False)
    assert "| converged | 0 | rows with weight 1 | undecided | 0 | – | – | – | " in tables
    assert "pareto.svg" not in tables
