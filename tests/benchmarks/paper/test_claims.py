"""Tables and verdicts, from made-up insertions whose answer is known."""

from __future__ import annotations

import csv
import io
import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from benchmarks.cases import Case, Outcome
from benchmarks.paper import comparison
from benchmarks.paper.analysis import box, controller_contrasts, direction_contrasts, scores, young_contrasts
from benchmarks.paper.bands import UNKNOWN, Bands, bands_of
from benchmarks.paper.claims import assumptions, claims
from benchmarks.paper.comparison import as_json, compare
from benchmarks.paper.evidence import NOT_REPRODUCED, REPRODUCED, UNDECIDED, Claim, Evidence
from benchmarks.paper.failure_places import border_mm, face_mm, notable_cases, spots
from benchmarks.paper.learning_studies import LearningPoint, learning_steps, seed_scores, seed_shares, variants
from benchmarks.paper.scale import SCALES, Scale
from benchmarks.paper.statistics import Interval
from benchmarks.paper.table import Row, by_group, insertions_csv, only, rows
from benchmarks.paper.timing import costs, savings
from tests.benchmarks.paper.synthetic import (
    MEDIANS_MM,
    experiments,
    labelled,
    outcome,
    scenario,
    seeds,
    sensitivity,
    timings,
)

if TYPE_CHECKING:
    from collections.abc import Iterable

NARROW = Bands(named_mm=1e-4, named_difference_mm=1e-4)


def evidence_of(outcomes: list[Outcome], timing: list[Outcome] | None = None, bands: Bands = NARROW) -> Evidence:
    table = rows(outcomes)
    return Evidence(
        rows=table,
        scores=scores(table),
        contrasts=controller_contrasts(table),
        young=young_contrasts(table),
        directions=direction_contrasts(table),
        savings=savings(rows(timing or [])),
        seeds=seed_shares(seed_scores(table)),
        bands=bands,
    )


def verdicts(outcomes: list[Outcome], timing: list[Outcome] | None = None, bands: Bands = NARROW) -> dict[str, Claim]:
    return {claim.key: claim for claim in claims(evidence_of(outcomes, timing, bands))}


def pair(group: str, ifem: list[float], elm: list[float]) -> list[Outcome]:
    """I-FEM and ELM on as many end points, one path each."""
    direction = "+x" if group == "CUR" else ""
    return [
        outcome(f"{group}-{i:03}-{arm}", error, labelled(group, arm, i, direction))
        for arm, errors in (("ifem", ifem), ("elm", elm))
        for i, error in enumerate(errors)
    ]


# ---- rows


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


# ---- scores and comparisons


def test_scores_of_a_hand_worked_group() -> None:
    outcomes = pair("CUR", [0.1, 0.2, 0.3, math.inf], [0.4, 0.4, 0.4, 0.4])
    outcomes += [outcome(f"o{i}", 0.8, labelled("CUR", "open_loop", i, "+x")) for i in range(4)]
    found = {s.arm: s for s in scores(rows(outcomes))}
    ifem = found["ifem"]
    assert (ifem.insertions, ifem.failed, ifem.stable) == (4, 1, 0.75)
    assert ifem.median_mm == pytest.approx(0.25)
    assert ifem.q3_mm == math.inf  # between 0.3 and a failure
    assert ifem.mean_mm == pytest.approx(0.2)
    assert ifem.max_mm == 0.3
    assert ifem.ratio == pytest.approx(0.3125)
    assert ifem.ratio_met is True
    assert found["elm"].ratio == 0.5
    assert found["elm"].ratio_met is False
    assert found["open_loop"].ratio == 1.0
    assert found["open_loop"].ratio_met is None
    assert found["open_loop"].within_1mm == 0.0  # 0.8 mm RMSE, 1.7 mm at worst
    assert ifem.box is not None
    assert (ifem.box.median, ifem.box.q3) == (ifem.median_mm, math.inf)  # the box says what the table says
    assert (ifem.box.low, ifem.box.high, ifem.box.beyond) == (0.1, math.inf, ())


def test_whiskers_never_end_inside_the_box() -> None:
    """An interpolated quartile can lie above every error within its reach."""
    found = box(np.array([0.0, 0.0, 0.0, 9.0]))
    assert found is not None
    assert (found.q3, found.high, found.beyond) == (2.25, 2.25, (9.0,))


def test_a_box_counts_failures_as_worst_and_draws_the_rest() -> None:
    found = box(np.array([1.0, 2.0, 3.0, 4.0, 5.0, 30.0, math.inf]))
    assert found is not None
    assert (found.q1, found.median, found.q3) == (2.5, 4.0, 17.5)
    assert (found.low, found.high, found.beyond) == (1.0, 30.0, ())
    lost = box(np.array([1.0, math.inf, math.inf]))
    assert lost is not None
    assert (lost.low, lost.q1, lost.median) == (1.0, math.inf, math.inf)
    assert box(np.array([math.inf])) is None


def test_all_groups_together_only_for_who_ran_in_all() -> None:
    outcomes = [*experiments(3), outcome("mlp", 0.1, labelled("LIN", "mlp", 0, ""))]
    found = {(s.group, s.arm) for s in scores(rows(outcomes)) if s.young == "constant" and s.noise == "off"}
    assert {("ALL", "ifem"), ("ALL", "rigid"), ("LIN", "mlp")} <= found
    assert ("ALL", "mlp") not in found


def test_pairs_are_matched_by_path_and_clusters_by_end_point() -> None:
    table = rows(experiments(5))
    curved = only(table, group="CUR", young="constant")
    found = compare(only(curved, arm="ifem"), only(curved, arm="elm"), group="CUR", names=("ifem", "elm"))
    assert found is not None
    assert (found.pairs, found.clusters, found.unpaired) == (20, 5, 0)
    fewer = compare(only(curved, arm="ifem")[3:], only(curved, arm="elm"), group="CUR", names=("ifem", "elm"))
    assert fewer is not None
    assert (fewer.pairs, fewer.unpaired) == (17, 3)


def test_what_an_error_was_paid_with_is_told_of_the_pairs_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[list[Row]] = []

    def noted(found: Iterable[Row]) -> dict[str, float | None]:
        told.append(list(found))
        return {}

    monkeypatch.setattr(comparison, "beside", noted)
    curved = only(rows(experiments(2)), group="CUR", young="constant")
    first, second = only(curved, arm="ifem"), only(curved, arm="elm")
    compare(first[3:], second[:-1], group="CUR", names=("ifem", "elm"))
    assert told == [first[3:-1], second[3:-1]]


def test_a_comparison_turned_round() -> None:
    table = rows(pair("LIN", [0.1, 0.5, 0.2, math.inf], [0.2, 0.3, 0.7, 0.1]))
    one, other = (only(table, arm=arm) for arm in ("ifem", "elm"))
    there, back = (compare(a, b, group="LIN", names=("a", "b")) for a, b in ((one, other), (other, one)))
    assert there is not None
    assert back is not None
    assert there.difference_mm == pytest.approx(-back.difference_mm)
    assert there.p_primary == back.p_primary
    assert there.superiority == pytest.approx(1.0 - back.superiority)


def test_comparisons_need_a_pair() -> None:
    assert compare([], rows([outcome("a", 0.1)]), group="LIN", names=("a", "b")) is None


@pytest.mark.slow
@pytest.mark.parametrize(("open_loop", "rigid", "floor"), [(0.04, 0.01, True), (0.04, 0.06, False)])
def test_floor_needs_every_reference_below(open_loop: float, rigid: float, floor: bool) -> None:
    outcomes = pair("LIN", [0.001] * 10, [0.002] * 10)
    outcomes += [outcome("o", open_loop, labelled("LIN", "open_loop", 0, ""))]
    outcomes += [outcome("r", rigid, labelled("LIN", "rigid", 0, ""))]
    found = evidence_of(outcomes).contrast("LIN")
    assert found is not None
    assert found.floor is floor
    claim = verdicts(outcomes)["lin"]
    assert claim.verdict == (UNDECIDED if floor else REPRODUCED)
    assert ("floor" in claim.reason) is floor


def test_directions_of_the_sine_are_compared_one_by_one() -> None:
    errors = {"+x": (0.01, 0.05), "-y": (0.11, 0.06)}
    outcomes = [
        outcome(f"cur-{i:03}{direction}-{arm}", error * (1 + 0.01 * i), labelled("CUR", arm, i, direction))
        for direction, both in errors.items()
        for arm, error in zip(("ifem", "elm"), both, strict=True)
        for i in range(9)
    ]
    outcomes[0] = outcome("cur-000+x-ifem", math.inf, labelled("CUR", "ifem", 0, "+x"))
    one, other = direction_contrasts(rows([*outcomes, *pair("LIN", [0.1] * 9, [0.2] * 9)]))
    assert (one.varied, one.comparison.clusters_below, one.comparison.clusters_above) == ("+x", 8, 1)
    assert (other.varied, other.comparison.clusters_below, other.comparison.clusters_above) == ("-y", 0, 9)
    assert one.comparison.median_first_mm == pytest.approx(0.01 * 1.05)
    assert "by direction of the sine, I-FEM against ELM: +x" in verdicts(outcomes)["cur"].reason
    assert direction_contrasts(rows(pair("CUR", [0.1] * 3, [0.2] * 3))) == []


def test_nothing_at_all_breaks_nothing() -> None:
    found = verdicts([])
    assert {claim.verdict for claim in found.values()} == {UNDECIDED}
    assert all(claim.reason for claim in found.values())
    assert not notable_cases([])
    assert not spots([])
    assert not variants([])
    assert not costs([])
    assert face_mm([]) is None


@pytest.mark.slow
def test_nothing_but_failures_breaks_nothing() -> None:
    failed = [Outcome(o.case, {"status": "not_converged"}) for o in [*experiments(3), *seeds(2), *sensitivity()]]
    found = verdicts(failed)
    assert found["stability"].verdict == NOT_REPRODUCED
    assert found["submillimetric"].verdict == UNDECIDED
    assert found["lin"].verdict == UNDECIDED
    assert as_json(scores(rows(failed)))[0]["median_mm"] is None


# ---- verdicts


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
        made.case.scenario["controller"] |= {"rcm_weight": 0.1} if made.case.labels["arm"] == "ifem" else {}
    found = assumptions(rows(outcomes))
    assert found == [
        "mesh, edge of a cell: 8.0 mm",
        "held faces: [y_min, y_max]",
        "weight of the remote-centre rows: 0.1",
    ]


# ---- precision under variable stiffness, and what noise is good for


@pytest.mark.slow
@pytest.mark.parametrize(
    ("ifem_mm", "elm_mm", "count", "verdict"),
    [(0.2, 0.1, 12, REPRODUCED), (0.1, 0.2, 12, NOT_REPRODUCED), (0.1, 0.2, 4, UNDECIDED)],
)
def test_the_elm_under_variable_stiffness(ifem_mm: float, elm_mm: float, count: int, verdict: str) -> None:
    outcomes = [
        outcome(f"{arm}-{i}", error, labelled("CUR", arm, i, "+x", young="variable"))
        for arm, error in (("ifem", ifem_mm), ("elm", elm_mm))
        for i in range(count)
    ]
    assert verdicts(outcomes)["young-cur"].verdict == verdict
    assert verdicts(outcomes[:count])["young-cur"].reason.startswith("I-FEM and ELM did not both run")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("noisy_mm", "quiet_mm", "count", "verdict"),
    [(0.1, 0.3, 12, REPRODUCED), (0.3, 0.1, 12, NOT_REPRODUCED), (0.1, 0.3, 5, UNDECIDED)],
)
def test_noise_in_training(noisy_mm: float, quiet_mm: float, count: int, verdict: str) -> None:
    """Paths that neither ELM has seen, straight and curved."""
    outcomes = [
        outcome(f"{group}-{arm}-{i}", error, labelled(group, arm, i, "+x" if group == "CUR" else ""))
        for group in ("LIN", "CUR")
        for arm, error in (("elm", noisy_mm), ("elm_quiet", quiet_mm))
        for i in range(count)
    ]
    claim = verdicts(outcomes)["overfitting"]
    assert claim.verdict == verdict
    assert "on LIN" in claim.reason
    assert "ELM trained without noise" in claim.figure
    assert verdicts([o for o in outcomes if o.case.labels["arm"] == "elm"])["overfitting"].verdict == UNDECIDED


def test_a_failure_counts_once() -> None:
    """Under stability, and not again as an error of a millimetre or more."""
    outcomes = [*pair("LIN", [0.1, 0.2, math.inf], [0.1] * 3), *pair("CUR", [0.1] * 3, [0.1, 0.5, 0.1])]
    found = verdicts(outcomes)
    assert found["stability"].verdict == NOT_REPRODUCED
    assert found["stability"].reason == "1 of 12 insertions failed (1 not converged)"
    assert found["submillimetric"].verdict == UNDECIDED  # of three end points
    assert "holds in all 11 insertions" in found["submillimetric"].reason
    assert "1 failed, which counts under stability" in found["submillimetric"].reason
    worse = [*outcomes, *pair("CUR", [1.5], [0.1])]
    assert verdicts(worse)["submillimetric"].verdict == NOT_REPRODUCED
    assert "1 of the 13 that did not fail have an RMSE of 1 mm or more" in verdicts(worse)["submillimetric"].reason


@pytest.mark.slow
def test_errors_are_compared_apart_from_failures() -> None:
    """Failures decide the test over all; beside it stands what the others say."""
    claim = verdicts(pair("CUR", [0.1] * 12, [0.2] * 3 + [math.inf] * 9))["cur"]
    assert claim.verdict == NOT_REPRODUCED
    assert "in the 3 pairs without a failure" in claim.reason


@pytest.mark.slow
def test_a_direction_that_is_turned_round_is_not_reproduced() -> None:
    found = verdicts([*pair("LIN", [0.2] * 12, [0.1] * 12), *pair("CUR", [0.1] * 12, [0.2] * 12)])
    assert found["lin"].verdict == found["cur"].verdict == NOT_REPRODUCED
    assert "opposite" in found["lin"].reason


@pytest.mark.slow
@pytest.mark.parametrize("count", [6, 100])
def test_a_direction_without_significance(count: int) -> None:
    """Half better, half worse: undecided, by few and by as many as the paper had."""
    found = verdicts(pair("CUR", [0.2, 0.1] * (count // 2), [0.1, 0.2] * (count // 2)))["cur"]
    assert found.p == 1.0
    assert found.verdict == UNDECIDED


def test_a_tiny_but_sure_difference_says_that_it_is_tiny() -> None:
    claim = verdicts(pair("LIN", [0.100] * 20, [0.101] * 20))["lin"]
    assert claim.verdict == REPRODUCED
    assert "less than the margin of 0.05 mm" in claim.reason


def test_failures_count_against_a_controller() -> None:
    claim = verdicts(pair("LIN", [math.inf] * 10, [0.9] * 10))["lin"]
    assert claim.verdict == NOT_REPRODUCED


@pytest.mark.slow
@pytest.mark.parametrize(
    ("near", "far", "verdict"),
    [(10, 0, REPRODUCED), (0, 10, NOT_REPRODUCED), (2, 0, UNDECIDED), (0, 0, NOT_REPRODUCED), (60, 0, NOT_REPRODUCED)],
)
def test_stability_under_variable_stiffness(near: int, far: int, verdict: str) -> None:
    """500 insertions, of which some fail near a face or far from it; the paper has ten failures, near it."""
    count = 100 if near == 2 else 500
    outcomes = []
    for i in range(count):
        close = i % 2 == 0
        failed = i // 2 < (near if close else far)
        labels = labelled("LIN", "elm", i, "", young="variable")
        end = (2.5, 31.0) if close else (18.0, 31.0)
        outcomes.append(outcome(f"{i:03}", math.inf if failed else 0.1, labels, end_mm=end))
    assert verdicts(outcomes)["variable"].verdict == verdict


def both_stiffnesses(constant: list[float], variable: list[float]) -> list[Outcome]:
    return [
        outcome(f"{young}-{i:03}", error, labelled("LIN", "elm", i, "", young=young))
        for young, errors in (("constant", constant), ("variable", variable))
        for i, error in enumerate(errors)
    ]


@pytest.mark.parametrize(
    ("shift", "spread", "count", "verdict", "said"),
    [
        (0.001, 0.3, 60, REPRODUCED, "path by path there is a difference, but it is shown to be smaller"),
        (0.0, 0.3, 60, REPRODUCED, "the difference is shown to be smaller"),
        (0.08, 0.01, 60, NOT_REPRODUCED, "own test"),
        (0.08, 0.9, 60, NOT_REPRODUCED, "path by path"),
        (0.08, 0.9, 4, UNDECIDED, "too few"),
    ],
)
def test_constant_against_variable_stiffness(shift: float, spread: float, count: int, verdict: str, said: str) -> None:
    constant = [0.2 + spread * i / count for i in range(count)]
    claim = verdicts(both_stiffnesses(constant, [error + shift for error in constant]))["young"]
    assert (claim.verdict, said in claim.reason) == (verdict, True)


def test_time_that_depends_on_the_form_of_ifem_is_not_testable() -> None:
    found = verdicts([], timings(5))
    assert found["time-text"].verdict == UNDECIDED
    assert "does not hold against I-FEM, constraint; which form" in found["time-text"].reason
    assert "holds against I-FEM, perturbation" in found["time-text"].reason
    only_slow = [o for o in timings(5) if o.case.labels["jacobian"] != "constraint"]
    assert verdicts([], only_slow)["time-abstract"].verdict == REPRODUCED
    only_fast = [o for o in timings(5) if o.case.labels["jacobian"] != "perturbation"]
    assert verdicts([], only_fast)["time-earlier-paper"].verdict == NOT_REPRODUCED


def test_times_worked_by_hand() -> None:
    table = rows(timings(1))
    found = {(s.way, s.part): s.saved for s in savings(table)}
    assert found["I-FEM, constraint", "total"] == pytest.approx(1.0 - 1.82 / 2.65)
    assert found["I-FEM, constraint", "controller"] == pytest.approx(1.0 - 0.02 / 0.75)
    assert found["I-FEM, perturbation", "total"] == pytest.approx(1.0 - 1.82 / 11.05)
    assert [cost.way for cost in costs(table)] == ["I-FEM, constraint", "I-FEM, perturbation", "ELM"]


# ---- studies


def test_seeds_are_compared_on_their_own_paths() -> None:
    errors = {0: 0.05, 1: 0.2, 2: math.inf}
    outcomes = pair("CUR", [0.1] * 4, [0.1] * 4)
    for seed, error in errors.items():
        labels = labelled("CUR", "elm", 1, "+x", purpose="seeds", model_seed=seed)
        outcomes.append(outcome(f"seed{seed}", error, labels))
    outcomes.append(outcome("o", 0.7, labelled("CUR", "open_loop", 1, "+x")))
    outcomes.append(outcome("elsewhere", 0.9, labelled("CUR", "open_loop", 2, "+x")))
    (share,) = seed_shares(seed_scores(rows(outcomes)), rows(outcomes))
    assert (share.seeds, share.paths, share.failed) == (3, 1, 1)
    assert share.references == {"ifem": 0.1, "open_loop": 0.7}
    assert (share.elm_better, share.ifem_better) == (1, 2)
    assert (share.low_mm, share.median_mm, share.high_mm) == (0.05, 0.2, math.inf)


def test_learning_curves_have_median_and_range() -> None:
    points = [LearningPoint("nodes", 25, seed, "split by sample", error) for seed, error in enumerate((0.3, 0.1, 0.2))]
    (step,) = learning_steps(points)
    assert (step.seeds, step.low_mm, step.median_mm, step.high_mm) == (3, 0.1, 0.2, 0.3)


def test_a_controllers_own_setting_is_held_against_the_nominal_others() -> None:
    found = {(v.parameter, v.value, v.group): v for v in variants(rows(sensitivity()))}
    nominal, gain = found["nominal", "defaults", "CUR"], found["gain", "0.5", "CUR"]
    assert gain.nominal == ("elm", "open_loop")
    assert (gain.elm_mm, gain.open_loop_mm) == (nominal.elm_mm, nominal.open_loop_mm)
    assert gain.ifem_mm != nominal.ifem_mm
    assert gain.insertions == 1
    assert (gain.better, gain.ran) == ("elm", ("ifem", "elm", "open_loop"))
    failed = [Outcome(o.case, {}) if o.case.labels["arm"] == "ifem" else o for o in sensitivity()]
    assert {v.better for v in variants(rows(failed))} == {"elm"}
    assert all(v.difference_mm == -math.inf and v.paths == 1 for v in variants(rows(failed)))
    lost = variants(rows([Outcome(o.case, {}) for o in sensitivity()]))
    assert all(math.isnan(v.difference_mm) and not v.better for v in lost)
    assert next(iter(found)) == ("nominal", "defaults", "LIN")


# ---- places


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
