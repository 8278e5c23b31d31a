"""The planned comparisons and their verdicts, fixed before the experiment was run.

Outcome: tip RMSE at an equal budget of the remote centre. Unit: the end point, by the median over its directions of
the paired differences. Test: exact sign test, Holm over all planned comparisons; the level is the paper's. Everything
else that is printed, the comparisons without a budget first of all, is description.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

from benchmarks.paper import statistics
from benchmarks.paper.bands import AXIS_ARM, bands_of
from benchmarks.paper.comparison import Comparison, compare
from benchmarks.paper.direction_claims import SIGNIFICANT
from benchmarks.paper.evidence import NOT_REPRODUCED, REPRODUCED, UNDECIDED, Claim, change_text, undecided_by_band
from benchmarks.paper.number_text import effect_text, millimetres, p_value
from benchmarks.settling.cells import AXIS, Cell, planned_pairs
from benchmarks.settling.plan import CELL
from benchmarks.settling.scores import BUDGET_MM, within_budget

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from benchmarks.paper.bands import Band, Bands
    from benchmarks.paper.table import Row
    from benchmarks.settling.scale import SettlingScale

CLAIM = "The ELM is the more precise on curved paths (CUR), p < 0.01"


@dataclass(frozen=True)
class Planned:
    """The undelayed ELM (first) against one cell of I-FEM (second) on the same plant. budget: pairs of which both are
    inside of it; unrestricted: all pairs; None without a pair. p_holm: of the sign tests, adjusted within each kind.
    outside, failed: insertions of the two, (ELM, I-FEM). claim: the paper's, judged at the budget."""

    first: Cell
    second: Cell
    budget: Comparison | None
    unrestricted: Comparison | None
    p_holm: float
    p_holm_unrestricted: float
    outside: tuple[int, int]
    failed: tuple[int, int]
    claim: Claim
    claim_unrestricted: Claim


@dataclass(frozen=True)
class FamilyVerdict:
    """What a family of planned comparisons says together: a verdict if all of them have it."""

    family: str
    verdict: str
    reproduced: int
    not_reproduced: int
    undecided: int


def planned_comparisons(table: Sequence[Row], scale: SettlingScale) -> list[Planned]:
    """All of them, also those without a pair: these count as tests that found nothing."""
    members: dict[str, list[Row]] = {}
    for row in table:
        members.setdefault(str(row.labels.get(CELL, "")), []).append(row)
    pairs, bands = planned_pairs(scale), bands_of(scale)
    inside = [_compared(members, pair, within_budget) for pair in pairs]
    everything = [_compared(members, pair, lambda _: True) for pair in pairs]
    adjusted, adjusted_everything = (_holm(found) for found in (inside, everything))
    planned = []
    for i, (first, second) in enumerate(pairs):
        mine, other = members.get(first.name, []), members.get(second.name, [])
        outside = (sum(not within_budget(r) for r in mine), sum(not within_budget(r) for r in other))
        where = (
            f"outside of the budget of {BUDGET_MM:g} mm: {_of(outside[0], mine)} ELM, {_of(outside[1], other)} I-FEM"
        )
        failed = (sum(r.failed for r in mine), sum(r.failed for r in other))
        planned.append(
            Planned(
                first=first,
                second=second,
                budget=inside[i],
                unrestricted=everything[i],
                p_holm=adjusted[i],
                p_holm_unrestricted=adjusted_everything[i],
                outside=outside,
                failed=failed,
                claim=judge(second, inside[i], adjusted[i], bands, where),
                claim_unrestricted=judge(second, everything[i], adjusted_everything[i], bands, where),
            )
        )
    return planned


def _of(count: int, mine: Sequence[Row]) -> str:
    return f"{count} of {len(mine)}"


def _compared(
    members: Mapping[str, Sequence[Row]], pair: tuple[Cell, Cell], keep: Callable[[Row], bool]
) -> Comparison | None:
    first, second = ([row for row in members.get(cell.name, []) if keep(row)] for cell in pair)
    return compare(first, second, group="CUR", names=(pair[0].name, pair[1].name))


def _holm(compared: Sequence[Comparison | None]) -> list[float]:
    return [float(p) for p in statistics.holm([c.p_primary if c else math.nan for c in compared])]


def judge(cell: Cell, comparison: Comparison | None, p_holm: float, bands: Bands, where: str) -> Claim:
    """The paper's claim against one cell of I-FEM. where: how many insertions were outside of the budget."""
    source = f"{cell.plant.title}; I-FEM {1e3 * cell.delay_s:g} ms late, {cell.rows_title}"
    if comparison is None:
        reason = f"no pair of insertions to compare; {where}"
        return Claim(cell.name, CLAIM, source, UNDECIDED, "", "", None, "", reason)
    verdict, reason = _verdict(comparison, p_holm)
    medians = f"{millimetres(comparison.median_first_mm)} ELM, {millimetres(comparison.median_second_mm)} I-FEM"
    claim = Claim(
        key=cell.name,
        claim=CLAIM,
        source=source,
        verdict=verdict,
        figure=f"median RMSE {medians}; ELM minus I-FEM {change_text(comparison)}",
        test=f"sign test over {comparison.clusters} end points, {comparison.pairs} pairs, adjusted by Holm",
        p=p_holm,
        effect=f"unadjusted p = {p_value(comparison.p_primary)}; Wilcoxon p = {p_value(comparison.p_wilcoxon)}; "
        f"rank-biserial {effect_text(comparison.rank_biserial)}",
        reason=f"{reason}; {where}",
    )
    return undecided_by_band(claim, band_of(cell, bands), comparison.difference_mm)


def band_of(cell: Cell, bands: Bands) -> Band:
    """Of the ELM minus one cell of I-FEM: measured undelayed on the converged plant, with the axis through the entry
    and with rows of the default weight. Rows of other weights, and left out, have the wider of the two; delays and the
    linearised plant were not measured and have the same."""
    if cell.rows == AXIS:
        return bands.difference("CUR", "elm", AXIS_ARM)
    return bands.widest_difference("CUR", "elm", ("ifem", AXIS_ARM))


def _verdict(comparison: Comparison, p_holm: float) -> tuple[str, str]:
    """By the sign of the median difference, where the adjusted sign test agrees; a tie is neither."""
    small = f", by less than the margin of {statistics.MARGIN_MM:g} mm" if comparison.equivalent else ""
    change = comparison.difference_mm
    which = "the direction holds" if change < 0.0 else "the opposite holds" if change > 0.0 else "the two are level"
    if p_holm >= SIGNIFICANT or change == 0.0:
        few = f"not significantly over {comparison.clusters} end points (adjusted p >= {SIGNIFICANT:g})"
        return UNDECIDED, f"{which}{small}, but {few}" if change else f"{which}{small}"
    return (REPRODUCED if change < 0.0 else NOT_REPRODUCED), f"{which}{small}"


# ---- together


def families(planned: Sequence[Planned]) -> list[FamilyVerdict]:
    """All comparisons at the budget, then those of each plant, of each delay, of each treatment of the remote centre:
    what the verdict hangs on."""
    ways: dict[str, Callable[[Planned], str]] = {
        "plant": lambda one: one.second.plant.title,
        "I-FEM’s delay": lambda one: f"{1e3 * one.second.delay_s:g} ms",
        "remote centre": lambda one: one.second.rows_title,
    }
    found = [together("all planned comparisons", planned)]
    for way, value in ways.items():
        for name in dict.fromkeys(value(one) for one in planned):
            found.append(together(f"{way}: {name}", [one for one in planned if value(one) == name]))
    return found


def together(family: str, planned: Sequence[Planned]) -> FamilyVerdict:
    """Reproduced, or not, only if every comparison of the family is; else undecided."""
    counts = Counter(one.claim.verdict for one in planned)
    verdict = next(iter(counts)) if len(counts) == 1 else UNDECIDED
    return FamilyVerdict(family, verdict, counts[REPRODUCED], counts[NOT_REPRODUCED], counts[UNDECIDED])
