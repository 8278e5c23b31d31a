"""Verdicts on the paper's claims, from made-up insertions whose answer is known."""

from __future__ import annotations

from typing import Any

import pytest

from benchmarks.paper.bands import UNKNOWN, Bands, bands_of
from benchmarks.paper.claims import assumptions
from benchmarks.paper.evidence import NOT_REPRODUCED, REPRODUCED, UNDECIDED
from benchmarks.paper.scale import SCALES, Scale
from benchmarks.paper.table import rows
from tests.benchmarks.paper.made_up_evidence import pair, verdicts
from tests.benchmarks.paper.synthetic import (
    experiments,
    seeds,
    timings,
)


@pytest.mark.slow
def test_the_papers_results_would_be_reproduced() -> None:
    found = verdicts([*experiments(100), *seeds()], timings(5))
    assert found["stability"].verdict == REPRODUCED
    assert found["lin"].verdict == REPRODUCED
    assert found["cur"].verdict == REPRODUCED
    assert found["submillimetric"].verdict == REPRODUCED
    assert found["lin"].p is not None
    assert found["lin"].p < 0.01
    assert "of 20 ELM seeds, along 3 paths each" in found["lin"].reason
    assert "the paper’s tests over all 400 pairs: sign p = " in found["cur"].effect
    assert "with target noise" in found["lin"].reason


@pytest.mark.slow
def test_few_insertions_do_not_show_that_all_are_so() -> None:
    found = verdicts(experiments(12), timings(2))
    assert found["stability"].verdict == found["submillimetric"].verdict == UNDECIDED
    assert "12 end points are too few" in found["stability"].reason
    assert found["time-text"].verdict == UNDECIDED
    assert "2 paths are too few" in found["time-text"].reason


@pytest.mark.slow
def test_an_unknown_band_decides_nothing_that_the_mesh_may_change() -> None:
    found = verdicts([*experiments(100), *seeds()], timings(5), bands=UNKNOWN)
    assert found["young"].band == "ELM at two Young’s moduli on ALL: unknown"
    times = {key for key in found if key.startswith("time")}
    assert {found[key].verdict for key in found.keys() - times} == {UNDECIDED}
    assert "not decided by this discretisation, whose band of I-FEM minus ELM on CUR is unknown" in found["cur"].reason
    assert "not decided by this discretisation" not in found["time-text"].reason


@pytest.mark.slow
@pytest.mark.parametrize(("band_mm", "verdict"), [(0.0, REPRODUCED), (0.09, REPRODUCED), (0.11, UNDECIDED)])
def test_a_difference_inside_the_band_is_not_decided(band_mm: float, verdict: str) -> None:
    """0.1 mm between the two, at every end point."""
    bands = Bands(named_mm=9.0, named_difference_mm=band_mm)
    claim = verdicts(pair("LIN", [0.1] * 12, [0.2] * 12), bands=bands)["lin"]
    assert claim.verdict == verdict
    assert claim.band == f"I-FEM minus ELM on LIN: {band_mm:.3g} mm"
    assert ("not decided by this discretisation: 0.1 mm lie inside its band of 0.11 mm" in claim.reason) == (
        verdict == UNDECIDED
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("worst_mm", "band_mm", "verdict"),
    [
        (0.8, 0.1, REPRODUCED),
        (0.8, 0.3, UNDECIDED),
        (1.5, 0.3, NOT_REPRODUCED),
        (1.2, 0.3, UNDECIDED),
    ],
)
def test_how_near_a_millimetre_the_worst_may_be_depends_on_the_band(
    worst_mm: float, band_mm: float, verdict: str
) -> None:
    errors = [*([0.1] * 99), worst_mm]
    outcomes = [*pair("LIN", errors, [0.1] * 100), *pair("CUR", [0.1] * 100, [0.2] * 100)]
    bands = Bands(named_mm=band_mm, named_difference_mm=9.0)
    assert verdicts(outcomes, bands=bands)["submillimetric"].verdict == verdict


def measured_bands(**changes: dict[str, float | None]) -> Bands:
    """All narrow but for these suites' quantities."""
    known: dict[str, float | None] = dict.fromkeys(("ifem", "elm", "elm minus ifem"), 1e-4)
    return Bands({suite: {**known, **changes.get(suite, {})} for suite in ("LIN", "CUR")}, source="a study")


@pytest.mark.slow
def test_each_claim_is_held_against_the_band_of_what_it_compares() -> None:
    """A wide band of one suite's difference leaves the other suite's claim, and those about one controller."""
    outcomes = [*pair("LIN", [0.1] * 100, [0.2] * 100), *pair("CUR", [0.2] * 100, [0.1] * 100)]
    decided = {"lin", "cur", "submillimetric", "stability"}
    cases: tuple[tuple[dict[str, Any], set[str]], ...] = (
        ({}, set()),
        ({"CUR": {"elm minus ifem": 0.3}}, {"cur"}),
        ({"LIN": {"elm minus ifem": 0.3}}, {"lin"}),
        ({"LIN": {"elm": 0.85}}, {"submillimetric"}),
        ({"LIN": {"elm": 0.3}, "CUR": {"ifem": 0.3}}, set()),
        ({"CUR": {"elm": None}}, {"submillimetric", "stability"}),
    )
    for changes, undecided in cases:
        found = verdicts(outcomes, bands=measured_bands(**changes))
        assert {key for key in decided if found[key].verdict == UNDECIDED} == undecided
    assert found["cur"].band == "I-FEM minus ELM on CUR: 0.0001 mm"
    assert found["stability"].band == "RMSE of I-FEM and ELM on ALL: unknown"


def test_a_pair_that_was_not_measured_has_both_bands_together() -> None:
    bands = measured_bands(LIN={"elm": 0.02, "ifem": 0.01})
    assert bands.difference("LIN", "ifem", "elm").mm == bands.difference("LIN", "elm", "ifem").mm == 1e-4
    assert bands.difference("LIN", "elm", "elm_quiet").mm == pytest.approx(0.04)
    assert bands.difference("ALL", "elm", "elm").mm == pytest.approx(0.04)
    assert bands.difference("LIN", "elm", "mlp").mm is None
    assert Bands(named_mm=0.1).difference("CUR", "elm", "ifem").mm == pytest.approx(0.2)
    assert Bands(named_difference_mm=0.1).rmse("CUR", "elm").mm is None
    assert UNKNOWN.rmse("ALL", "ifem", "elm").mm is None


def test_only_the_discretisation_that_was_measured_has_the_measured_bands(monkeypatch: pytest.MonkeyPatch) -> None:
    measured = measured_bands()
    monkeypatch.setattr("benchmarks.paper.bands.MEASURED", measured)
    assert bands_of(SCALES["full"]) == bands_of(SCALES["extended"]) == measured
    assert bands_of(Scale(name="mine", lin=3)) == measured
    for other in (
        SCALES["quick"],
        SCALES["smoke"],
        Scale(name="mine", dt_s=0.02),
        Scale(name="mine", element_size_mm=5),
    ):
        assert bands_of(other) == UNKNOWN
    named = bands_of(Scale(name="mine", element_size_mm=5.0, band_mm=0.1))
    assert (named.rmse("LIN", "elm").mm, named.difference("LIN", "elm", "ifem").mm) == (0.1, 0.2)
    assert bands_of(Scale(name="full", band_difference_mm=0.1)).rmse("LIN", "elm").mm is None


def test_assumptions_are_those_of_the_insertions() -> None:
    outcomes = pair("LIN", [0.1] * 2, [0.1] * 2)
    for made in outcomes:
        made.case.scenario["tissue"] |= {"element_size_mm": 8.0, "fixed_faces": ["y_min", "y_max"]}
        ifem = made.case.labels["arm"] == "ifem"
        made.case.scenario["controller"] |= {"rcm_weight": 0.1, "delay_s": 0.02} if ifem else {"delay_s": 0.0}
    found = assumptions(rows(outcomes))
    assert found == [
        "mesh, edge of a cell: 8.0 mm",
        "held faces: [y_min, y_max]",
        "weight of the remote-centre rows: 0.1",
        "delay of a controller: 0.0, 0.02 s",
    ]
