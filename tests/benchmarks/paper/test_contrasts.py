"""Verdicts on stiffness, noise, direction and time, from made-up insertions."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from benchmarks.paper.evidence import NOT_REPRODUCED, REPRODUCED, UNDECIDED
from benchmarks.paper.table import rows
from benchmarks.paper.timing import costs, savings
from tests.benchmarks.paper.made_up_evidence import pair, verdicts
from tests.benchmarks.paper.synthetic import (
    labelled,
    outcome,
    timings,
)

if TYPE_CHECKING:
    from benchmarks.cases import Outcome


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
