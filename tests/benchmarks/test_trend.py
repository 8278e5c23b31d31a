"""Marks of a history: digests, paired errors, and times against the same machine."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from benchmarks.trend import Loss, Mark, Point, judge, judge_all, lasting_losses

CASES = [f"case-{i}" for i in range(12)]
BASE = Point(0.0, "a", "cpu", dict.fromkeys(CASES, 0.1), dict.fromkeys(CASES, "d"), 12, 2.0, {}, {"mine": "3f2a (1.0)"})


def shifted(by_mm: float, cases: list[str]) -> Point:
    errors = {case: 0.1 + (by_mm if case in cases else 0.0) for case in CASES}
    return replace(BASE, rmse_commanded_mm=errors, digests={c: "e" if c in cases else "d" for c in CASES})


def test_the_first_run_is_no_regression() -> None:
    found = judge(BASE, [])
    assert (found.accuracy, found.success, found.time) == (Mark.UNJUDGED,) * 3
    assert not found.regression


@pytest.mark.parametrize(
    ("by_mm", "cases", "mark"),
    [
        (0.0, CASES, Mark.SAME),  # other digests, same errors
        (0.02, CASES, Mark.WORSE),
        (-0.02, CASES, Mark.BETTER),
        (0.001, CASES, Mark.SAME),  # real, and not worth a mark
        (0.02, CASES[:3], Mark.SAME),  # 3 of 3 signs: p = 0.25
    ],
)
def test_accuracy_is_judged_by_pairs(by_mm: float, cases: list[str], mark: Mark) -> None:
    assert judge(shifted(by_mm, cases), [BASE]).accuracy is mark


@pytest.mark.parametrize(("cases", "mark"), [(7, Mark.UNJUDGED), (8, Mark.WORSE)])
def test_so_few_cases_that_no_difference_could_be_told_from_chance_are_not_judged(cases: int, mark: Mark) -> None:
    """Two-tailed p of seven alike signs: 0.016; of eight: 0.008."""
    few = CASES[:cases]
    before = replace(BASE, rmse_commanded_mm=dict.fromkeys(few, 0.1), digests=dict.fromkeys(few, "d"))
    now = replace(before, rmse_commanded_mm=dict.fromkeys(few, 0.2), digests=dict.fromkeys(few, "e"))
    found = judge(now, [before])
    assert found.accuracy is mark
    assert ("too few" in found.accuracy_why) == (mark is Mark.UNJUDGED)
    same = replace(now, rmse_commanded_mm=before.rmse_commanded_mm)
    assert judge(same, [before]).accuracy is Mark.SAME


def test_a_failure_is_worse_than_any_error_and_two_failures_are_a_tie() -> None:
    failed = replace(
        BASE, rmse_commanded_mm=dict.fromkeys(CASES, math.inf), digests=dict.fromkeys(CASES, "e"), successes=0
    )
    assert judge(failed, [BASE]).accuracy is Mark.WORSE
    assert judge(failed, [BASE]).success is Mark.WORSE
    assert judge(replace(failed, digests=dict.fromkeys(CASES, "f")), [failed]).accuracy is Mark.SAME


@pytest.mark.parametrize(("step_ms", "mark"), [(2.1, Mark.SAME), (2.5, Mark.WORSE), (1.5, Mark.BETTER)])
def test_time_is_judged_against_the_same_machine(step_ms: float, mark: Mark) -> None:
    history = [replace(BASE, step_ms=step) for step in (2.0, 2.02, 1.98, 9.0)]  # one outlier does not matter
    assert judge(replace(BASE, step_ms=step_ms), history).time is mark
    assert judge(replace(BASE, step_ms=step_ms, machine="other"), history).time is Mark.UNJUDGED


def test_a_noisy_machine_allows_more() -> None:
    history = [replace(BASE, step_ms=step) for step in (1.5, 2.0, 2.5)]
    assert judge(replace(BASE, step_ms=3.0), history).time is Mark.SAME
    assert judge(replace(BASE, step_ms=4.9), history).time is Mark.SAME  # four standard deviations are 4 x 1.4826 x 0.5
    assert judge(replace(BASE, step_ms=5.0), history).time is Mark.WORSE


def test_every_point_of_a_history_is_judged_by_those_before() -> None:
    marks = [found.accuracy for found in judge_all([BASE, BASE, shifted(0.02, CASES)])]
    assert marks == [Mark.UNJUDGED, Mark.SAME, Mark.WORSE]


def test_what_got_worse_stays_a_loss_until_it_is_mended() -> None:
    good, bad = BASE, replace(shifted(0.02, CASES), successes=10)
    assert lasting_losses([]) == lasting_losses([good, good]) == lasting_losses([bad, good]) == []
    found = lasting_losses([good, bad, bad, bad])
    assert [(loss.figure, loss.since) for loss in found] == [("accuracy", 1), ("success", 1)]
    assert "10 of 12 succeeded, 12 before" in found[1].why
    assert lasting_losses([good, bad, good]) == []


def test_half_of_a_loss_made_good_is_still_a_loss() -> None:
    steps = [12, 8, 10]
    history = [replace(BASE, successes=count) for count in steps]
    assert lasting_losses(history) == [Loss("success", 1, "10 of 12 succeeded, 12 before")]


@pytest.mark.parametrize("broken", [math.nan, math.inf, -math.inf])
def test_errors_that_are_no_numbers_never_win(broken: float) -> None:
    odd = replace(BASE, rmse_commanded_mm=dict.fromkeys(CASES, broken), digests=dict.fromkeys(CASES, "e"))
    assert judge(odd, [BASE]).accuracy is Mark.WORSE
    assert judge(BASE, [odd]).accuracy is Mark.BETTER
    assert judge(odd, [replace(odd, digests=dict.fromkeys(CASES, "f"))]).accuracy is Mark.SAME
    assert odd.median_rmse_mm == math.inf


def test_a_change_of_what_steers_is_named() -> None:
    now = replace(shifted(0.02, CASES), arms={"mine": "91bc (1.1)"})
    assert judge(now, [BASE]).accuracy_why.endswith("other arms: mine 3f2a (1.0) -> 91bc (1.1)")
