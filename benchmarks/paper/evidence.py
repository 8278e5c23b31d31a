"""A claim with its verdict, and what claims are judged by."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from benchmarks.paper.analysis import PRIMARY, Contrast, Score, under
from benchmarks.paper.comparison import Comparison
from benchmarks.paper.learning_studies import SeedShare
from benchmarks.paper.number_text import signed_text
from benchmarks.paper.table import GROUPS, Row, main_rows
from benchmarks.paper.timing import Saving

REPRODUCED, CONTRADICTED, NOT_TESTABLE = "reproduced", "contradicted", "not testable"
PAPER_END_POINTS = 100  # [paper] a sample that large and still nothing: the claim does not hold
BOTH = ("ifem", "elm")


@dataclass(frozen=True)
class Claim:
    """One claim and its verdict. figure: the measured numbers in words; test, p and effect as far as there is
    one; reason: why this verdict."""

    key: str
    claim: str
    source: str
    verdict: str
    figure: str
    test: str
    p: float | None
    effect: str
    reason: str


@dataclass(frozen=True)
class Evidence:
    """What claims are judged by."""

    rows: Sequence[Row]
    scores: Sequence[Score]
    contrasts: Sequence[Contrast]
    young: Sequence[Contrast]
    directions: Sequence[Contrast]
    savings: Sequence[Saving]
    seeds: Sequence[SeedShare]

    def score(self, group: str, arm: str, young: str = PRIMARY.young, noise: str = PRIMARY.noise) -> Score | None:
        """A controller's score, if it ran."""
        same = (s for s in self.scores if (s.group, s.arm, s.young, s.noise) == (group, arm, young, noise))
        return next(same, None)

    def contrast(self, group: str, noise: str = PRIMARY.noise) -> Comparison | None:
        """I-FEM against ELM at constant Young's modulus."""
        for contrast in self.contrasts:
            compared = contrast.comparison
            names = (compared.first, compared.second)
            if (contrast.young, contrast.noise, compared.group, names) == (PRIMARY.young, noise, group, BOTH):
                return compared
        return None


def judge_without_exception(known: Sequence[Score], exceptions: str) -> tuple[str, str]:
    """Verdict of a claim about all insertions, and why; exceptions: those that there are, in words."""
    if exceptions:
        return CONTRADICTED, exceptions
    count, points = sum(score.insertions for score in known), min(score.end_points for score in known)
    if points < PAPER_END_POINTS:
        return NOT_TESTABLE, f"holds in all {count} insertions, but {points} end points are too few to say “all”"
    return REPRODUCED, f"holds in all {count} insertions"


def list_failures(evidence: Evidence, word: str) -> str:
    """How many insertions of both controllers failed under the primary condition, and how; empty if none did."""
    mine = [row for row in under(main_rows(evidence.rows), PRIMARY) if row.arm in BOTH and row.group in GROUPS]
    kinds = Counter(row.status.replace("_", " ") for row in mine if row.failed)
    how = ", ".join(f"{count} {kind}" for kind, count in kinds.most_common())
    return f"{kinds.total()} of {len(mine)} insertions {word} ({how})" if kinds else ""


def change_text(comparison: Comparison) -> str:
    """Median difference and its interval, mm."""
    low, high = comparison.difference_interval_mm.low, comparison.difference_interval_mm.high
    return f"{signed_text(comparison.difference_mm)} mm [{signed_text(low)}, {signed_text(high)}]"
