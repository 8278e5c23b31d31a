"""The unit of analysis: what counts as one observation, and why there are fewer of them than pairs."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from benchmarks.cautions import cautions
from benchmarks.grid.design import between_arms
from benchmarks.grid.profiles import interquartile_mean, profiles
from benchmarks.grid.report import arm_comparisons, compare_arms
from benchmarks.paper import statistics
from benchmarks.paper.comparison import Comparison, as_json, corrected
from benchmarks.paper.table import Row, only, rows
from tests.benchmarks.paper.synthetic import outcome


def table(points: list[dict[str, Any]], *, better_mm: float = 0.1, arms: tuple[str, ...] = ("a", "b")) -> list[Row]:
    """Each arm at each point; every next one errs by 0.1 mm more."""
    found = []
    for number, point in enumerate(points):
        for rank, arm in enumerate(arms):
            labels = {"arm": arm, "controller": arm, "end_point": "18 31 60", **point}
            found.append(outcome(f"{arm} {number:03}", 0.3 + 0.01 * number + better_mm * rank, labels))
    return rows(found)


def compared(known: list[Row]) -> Comparison:
    found = compare_arms(known, "a", "b", group="insertions")
    assert found is not None
    return found


def test_a_hundred_cases_to_one_end_point_are_a_hundred_cases() -> None:
    one = compared(table([{"tissue.young_kpa": 4 + 0.01 * i} for i in range(100)]))
    assert (one.unit, one.pairs, one.clusters) == ("case", 100, 100)
    assert one.p_primary < 1e-20
    assert one.notes == ()


def test_end_points_are_the_unit_where_there_are_enough() -> None:
    points = [{"end_point": f"{i} 31 60", "tissue.young_kpa": e} for i in range(8) for e in (4, 5, 6)]
    one = compared(table(points))
    assert (one.unit, one.pairs, one.clusters) == ("end point", 24, 8)
    assert one.notes == ("24 pairs are 8 end points: cases with the same one count once",)
    assert one.p_primary == pytest.approx(2 * 0.5**8)
    few = compared(table(points[:9]))
    assert (few.unit, few.clusters) == ("case", 9)
    assert "3 end points are too few" in few.notes[0]


def test_seeds_repeat_a_case_where_there_are_enough_cases_and_are_cases_else() -> None:
    many = compared(table([{"tissue.young_kpa": e, "seed": s} for e in range(6) for s in range(4)]))
    assert (many.pairs, many.clusters) == (24, 6)
    assert "differ in their seed alone count once" in many.notes[0]
    alone = compared(table([{"seed": s} for s in range(24)]))
    assert (alone.pairs, alone.clusters, alone.notes) == (24, 24, ())


def test_seeds_that_gave_the_same_bits_count_once() -> None:
    known = [replace(row, digest=f"{row.arm} {i // 8}") for i, row in enumerate(table([{"seed": s} for s in range(8)]))]
    same = [replace(row, digest=row.arm) for row in known]
    one = compared(same)
    assert (one.pairs, one.clusters) == (8, 1)
    assert "seeds that gave the same result to the bit count once" in one.notes[0]
    assert math.isnan(one.p_primary)


def test_one_pair_is_not_tested() -> None:
    one = as_json(compared(table([{"tissue.young_kpa": 4}])))
    assert [one[name] for name in ("p_primary", "p_sign", "p_wilcoxon", "p_mann_whitney", "p_holm")] == [None] * 5
    assert one["difference_interval_mm"] == [None, None]
    assert one["difference_mm"] == pytest.approx(-0.1)


def test_a_case_without_a_partner_leaves_and_is_said() -> None:
    known = [row for row in table([{"tissue.young_kpa": e} for e in range(8)]) if row.id != "b 003"]
    one = compared(known)
    assert (one.pairs, one.unpaired) == (7, 1)
    assert one.notes == ("1 case has no partner and left the test",)


def test_a_failure_stays_with_its_case_even_without_a_result() -> None:
    known = table([{"tissue.young_kpa": e} for e in range(8)])
    lost = [replace(row, scenario={}, stable=False) if row.id == "a 000" else row for row in known]
    one = compared(lost)
    assert (one.pairs, one.unpaired, one.clusters_above) == (8, 0, 1)


def test_many_comparisons_are_corrected_together() -> None:
    known = table([{"tissue.young_kpa": e} for e in range(8)], arms=("a", "b", "c"))
    found = arm_comparisons(known)
    assert len(found) == 3
    assert [one.p_holm for one in found] == pytest.approx([3 * one.p_primary for one in found])
    assert [(one.family, one.fewest) for one in found] == [(3, 7)] * 3
    alone = corrected(found[:1])
    assert [(one.p_holm, one.family, one.fewest) for one in alone] == [(found[0].p_primary, 1, 6)]


@pytest.mark.slow
def test_effects_have_intervals() -> None:
    one = compared(table([{"tissue.young_kpa": e} for e in range(12)]))
    assert one.ratio_interval.low <= one.ratio <= one.ratio_interval.high < 1.0
    assert (one.superiority, one.superiority_interval.low) == (1.0, 1.0)
    mixed = statistics.bootstrap_superiority([-1.0] * 6 + [1.0] * 2, range(8))
    assert 0.3 < mixed.low < 0.75 < mixed.high <= 1.0


def test_pairs_differ_in_the_arm_alone() -> None:
    known = table([{"tissue.young_kpa": e, "noise_mm": n} for e in range(3) for n in (0.0, 0.1)])
    design = between_arms(only(known, arm="a"), only(known, arm="b"))
    keys = [design.key(row) for row in known]
    assert len(set(keys)) == 6
    delayed = table([{"controller.delay_s": d, "controller.gain": 1.0} for d in (0.0, 0.1)])
    assert len({row.place for row in delayed}) == 2


def test_an_interquartile_mean_is_that_of_the_middle_half() -> None:
    assert interquartile_mean(np.arange(8.0)) == pytest.approx(3.5)
    assert interquartile_mean(np.array([0.0, 1.0, 2.0, 3.0, 100.0])) == pytest.approx((0.75 + 2.0 + 0.75 * 3.0) / 2.5)
    assert interquartile_mean(np.array([1.0, 1.0, 1.0, math.inf])) == 1.0
    assert math.isinf(interquartile_mean(np.array([1.0, 1.0, math.inf, math.inf])))


def test_profiles_are_over_the_cases_that_all_arms_ran() -> None:
    known = table([{"tissue.young_kpa": e} for e in range(10)], arms=("a", "b", "c"))
    found = profiles([row for row in known if row.id != "c 009"])
    assert found is not None
    assert (found.cases, found.places, [one.arm for one in found.aggregates]) == (9, 10, ["a", "b", "c"])
    for one in found.aggregates:
        assert one.share == tuple(sorted(one.share))
        assert one.share[0] == 0.0 or one.arm == "a"
        assert one.share[-1] == 1.0
        assert one.iqm_interval_mm.low <= one.iqm_mm <= one.iqm_interval_mm.high
        assert all(
            low <= share <= high for low, share, high in zip(one.share_low, one.share, one.share_high, strict=True)
        )
    assert profiles(only(known, arm="a")) is None


def test_an_arm_whose_code_changed_is_two_arms() -> None:
    arm = {"kind": "plugin", "controller": "mine", "settings": {}, "version": "1.0", "files": {}}
    outcomes = [outcome(f"mine {i}", 0.1, {"arm": "mine", "seed": i}) for i in range(2)]
    for i, one in enumerate(outcomes):
        one.result["provenance"] = {"arm": {**arm, "code_sha256": f"{i}" * 64}}
    assert [row.arm for row in rows(outcomes)] == ["mine (1.0, code 00000000)", "mine (1.0, code 11111111)"]
    outcomes[1].result["provenance"]["arm"]["code_sha256"] = "0" * 64
    assert [row.arm for row in rows(outcomes)] == ["mine", "mine"]


def test_a_warning_is_said_once_with_how_many_have_it() -> None:
    texts = [("a", ["buckled at 3.1 mm", "odd"]), ("b", ["buckled at 7 mm"]), ("c", [])]
    found = cautions(texts)
    assert [(one.text, one.cases, one.first) for one in found] == [
        ("buckled at 3.1 mm", 2, ("a", "b")),
        ("odd", 1, ("a",)),
    ]
