"""A claim with its verdict, and what claims are judged by."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from benchmarks.paper.analysis import PRIMARY, Contrast, Score, under
from benchmarks.paper.bands import UNKNOWN, Band, Bands
from benchmarks.paper.number_text import signed_text
from benchmarks.paper.table import GROUPS, Row, main_rows

if TYPE_CHECKING:
    from collections.abc import Sequence

    from benchmarks.paper.comparison import Comparison
    from benchmarks.paper.learning_studies import SeedShare
    from benchmarks.paper.timing import Saving

REPRODUCED, NOT_REPRODUCED, UNDECIDED = "reproduced", "not reproduced under our assumptions", "undecided"
INSIDE_BAND = "not decided by this discretisation"
PAPER_END_POINTS = 100  # [paper] fewer do not say "all"
BOTH = ("ifem", "elm")


@dataclass(frozen=True)
class Claim:
    """One claim and its verdict. figure: the measured numbers in words; test, p and effect as far as there is
    one; reason: why this verdict; band: of the discretisation, which it was held against."""

    key: str
    claim: str
    source: str
    verdict: str
    figure: str
    test: str
    p: float | None
    effect: str
    reason: str
    band: str = ""


@dataclass(frozen=True)
class Evidence:
    """What claims are judged by. bands: how far errors and their differences may be off for the mesh, the spacing and
    the ball of these insertions, from a convergence study of closed loops."""

    rows: Sequence[Row]
    scores: Sequence[Score]
    contrasts: Sequence[Contrast]
    young: Sequence[Contrast]
    directions: Sequence[Contrast]
    savings: Sequence[Saving]
    seeds: Sequence[SeedShare]
    bands: Bands = UNKNOWN

    def score(self, group: str, arm: str, young: str = PRIMARY.young, noise: str = PRIMARY.noise) -> Score | None:
        """A controller's score, if it ran."""
        same = (s for s in self.scores if (s.group, s.arm, s.young, s.noise) == (group, arm, young, noise))
        return next(same, None)

    def contrast(
        self,
        group: str,
        noise: str = PRIMARY.noise,
        young: str = PRIMARY.young,
        arms: tuple[str, str] = BOTH,
    ) -> Comparison | None:
        """Two controllers against each other, I-FEM and ELM unless told otherwise."""
        for contrast in self.contrasts:
            compared = contrast.comparison
            names = (compared.first, compared.second)
            if (contrast.young, contrast.noise, compared.group, names) == (young, noise, group, arms):
                return compared
        return None


def judge_without_exception(known: Sequence[Score], exceptions: str) -> tuple[str, str]:
    """Verdict of a claim about all insertions, and why; exceptions: those that there are, in words."""
    if exceptions:
        return NOT_REPRODUCED, exceptions
    count, points = sum(score.insertions - score.failed for score in known), min(score.end_points for score in known)
    if points < PAPER_END_POINTS:
        return UNDECIDED, f"holds in all {count} insertions, but {points} end points are too few to say “all”"
    return REPRODUCED, f"holds in all {count} insertions"


def undecided_by_band(claim: Claim, band: Band, margin_mm: float) -> Claim:
    """The claim with its band; undecided where that is unknown or not smaller than margin_mm, the distance of what
    decided it from where the verdict would turn. One that is undecided keeps its reason."""
    claim = replace(claim, band=str(band))
    if claim.verdict == UNDECIDED:
        return claim
    if band.mm is None:
        reason = f"{INSIDE_BAND}, whose band of {band.of} is unknown; {claim.reason}"
        return replace(claim, verdict=UNDECIDED, reason=reason)
    if abs(margin_mm) > band.mm:
        return claim
    inside = f"{INSIDE_BAND}: {abs(margin_mm):.3g} mm lie inside its band of {band.mm:.3g} mm"
    return replace(claim, verdict=UNDECIDED, reason=f"{inside}; {claim.reason}")


def list_failures(evidence: Evidence, word: str) -> str:
    """How many insertions of both controllers failed under the primary condition, and how; empty if none did."""
    mine = [row for row in under(main_rows(evidence.rows), PRIMARY) if row.arm in BOTH and row.group in GROUPS]
    kinds = Counter(row.status.replace("_", " ") for row in mine if row.failed)
    how = ", ".join(f"{count} {kind}" for kind, count in kinds.most_common())
    return f"{kinds.total()} of {len(mine)} insertions {word} ({how})" if kinds else ""


def change_text(comparison: Comparison) -> str:
    """Median difference and its interval, mm; a single observation has none."""
    low, high = comparison.difference_interval_mm.low, comparison.difference_interval_mm.high
    if math.isnan(low):
        return f"{signed_text(comparison.difference_mm)} mm"
    return f"{signed_text(comparison.difference_mm)} mm [{signed_text(low)}, {signed_text(high)}]"
