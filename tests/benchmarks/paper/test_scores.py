"""Scores and comparisons of made-up insertions, worked by hand."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest

from benchmarks.cases import Outcome
from benchmarks.paper import comparison
from benchmarks.paper.analysis import box, direction_contrasts, scores
from benchmarks.paper.comparison import as_json, compare
from benchmarks.paper.evidence import NOT_REPRODUCED, REPRODUCED, UNDECIDED
from benchmarks.paper.failure_places import face_mm, notable_cases, spots
from benchmarks.paper.learning_studies import LearningPoint, learning_steps, seed_scores, seed_shares, variants
from benchmarks.paper.table import Row, only, rows
from benchmarks.paper.timing import costs
from tests.benchmarks.paper.made_up_evidence import evidence_of, pair, verdicts
from tests.benchmarks.paper.synthetic import (
    experiments,
    labelled,
    outcome,
    seeds,
    sensitivity,
)

if TYPE_CHECKING:
    from collections.abc import Iterable


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
