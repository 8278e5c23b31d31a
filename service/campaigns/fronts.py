"""Arms by what they reach and what they pay for it: which of them another one beats."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from benchmarks.paper.table import BESIDE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from service.campaigns.cases import Score

PAID = {"rcm_max_mm": BESIDE["rcm_max_mm"][0], "max_push_n": BESIDE["max_push_n"][0]}  # metric -> heading


@dataclass(frozen=True, kw_only=True)
class ArmPlace:
    """An arm in the plane of a front. error_mm: median RMSE; paid: median of the metric over the stable insertions.
    beaten_by: the arms that are no worse in either and better in one; none of an arm on the front."""

    arm: str
    error_mm: float
    paid: float
    beaten_by: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Front:
    """metric, heading: of what is paid. places: the arms that have both numbers, the cheapest first. absent: those that
    failed in the median, or of which the metric was not measured."""

    metric: str
    heading: str
    group: str
    places: list[ArmPlace]
    absent: list[str]

    @property
    def best(self) -> list[ArmPlace]:
        """Those that no other arm beats, the cheapest first."""
        return [place for place in self.places if not place.beaten_by]

    @property
    def beaten(self) -> list[ArmPlace]:
        """Those that another arm beats."""
        return [place for place in self.places if place.beaten_by]


def fronts(scores: Sequence[Score]) -> list[Front]:
    """A front for each metric of `PAID`, over the last group of the scores, all insertions together; none where fewer
    than two arms have both numbers."""
    mine = [score for score in scores if score.group == scores[-1].group]  # nothing of a campaign that has just begun
    found = [_front(mine, metric, heading) for metric, heading in PAID.items()] if mine else []
    return [front for front in found if len(front.places) > 1]


def _front(scores: Sequence[Score], metric: str, heading: str) -> Front:
    known = {
        score.arm: (score.median_rmse_mm, paid)
        for score in scores
        if score.median_rmse_mm is not None and (paid := score.beside.get(metric)) is not None
    }
    places = [
        ArmPlace(
            arm=arm,
            error_mm=error,
            paid=paid,
            beaten_by=tuple(other for other, theirs in known.items() if _beats(theirs, (error, paid))),
        )
        for arm, (error, paid) in sorted(known.items(), key=lambda one: (one[1][1], one[1][0]))
    ]
    absent = [score.arm for score in scores if score.arm not in known]
    return Front(metric=metric, heading=heading, group=scores[-1].group, places=places, absent=absent)


def _beats(one: tuple[float, float], other: tuple[float, float]) -> bool:
    """Whether it is no worse in either number, and better in one."""
    return one[0] <= other[0] and one[1] <= other[1] and one != other
