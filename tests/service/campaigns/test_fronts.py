"""Which arms are beaten, and by which."""

from __future__ import annotations

from service.campaigns.cases import Score
from service.campaigns.fronts import fronts


def score(arm: str, error_mm: float | None, rcm_mm: float | None, push_n: float | None, group: str = "ALL") -> Score:
    return Score(
        group=group,
        arm=arm,
        insertions=3,
        stable=3,
        successful=3,
        median_rmse_mm=error_mm,
        worst_rmse_mm=error_mm,
        beside={"rcm_max_mm": rcm_mm, "max_push_n": push_n},
        yielded=0,
    )


def test_an_arm_is_beaten_by_those_that_are_no_worse_in_both_and_better_in_one() -> None:
    rcm, push = fronts(
        [score("a", 0.2, 1.0, 2.0), score("b", 0.4, 0.5, 2.0), score("c", 0.4, 1.0, 1.0), score("d", 0.2, 1.0, 3.0)]
    )
    assert [(place.arm, place.beaten_by) for place in rcm.places] == [
        ("b", ()),
        ("a", ()),
        ("d", ()),
        ("c", ("a", "b", "d")),
    ]
    assert [place.arm for place in push.best] == ["c", "a"]
    assert {place.arm: place.beaten_by for place in push.beaten} == {"b": ("a", "c"), "d": ("a",)}


def test_the_last_group_counts_and_what_has_no_number_has_no_place() -> None:
    scores = [score("a", 0.1, 9.0, 9.0, "LIN"), score("a", 0.2, 1.0, None), score("b", 0.3, 0.5, None)]
    (rcm,) = fronts([*scores, score("c", None, 0.1, None)])
    assert [place.arm for place in rcm.places] == ["b", "a"]
    assert rcm.absent == ["c"]
    assert fronts([]) == []
