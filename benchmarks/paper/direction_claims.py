"""The claims about which controller is the more precise: on straight and on curved paths, trained with noise or not."""

from __future__ import annotations

from typing import TYPE_CHECKING

from benchmarks.paper import statistics
from benchmarks.paper.analysis import PRIMARY, Condition, under
from benchmarks.paper.comparison import compare
from benchmarks.paper.evidence import (
    NOT_REPRODUCED,
    REPRODUCED,
    UNDECIDED,
    Claim,
    Evidence,
    change_text,
    undecided_by_band,
)
from benchmarks.paper.number_text import effect_text, millimetres, p_value
from benchmarks.paper.table import ALL, GROUPS, QUIET_ARM, arm_name, main_rows, only

if TYPE_CHECKING:
    from collections.abc import Sequence

    from benchmarks.paper.comparison import Comparison

SIGNIFICANT = 0.01  # [paper] of the two directions


def direction_claim(evidence: Evidence, key: str, text: str, group: str, better: str) -> Claim:
    """One controller is the more precise: the median difference says so and the clustered sign test agrees."""
    comparison = evidence.contrast(group)
    if not comparison:
        return _not_run(key, text, f"I-FEM and ELM did not both run on {group}")
    notes = [*_seeds(evidence, group, better), *_noise(evidence, group), *_directions(evidence, group)]
    return _judged(evidence, key, text, comparison, better, [*_without_failures(evidence, comparison), *notes])


def variable_direction_claim(evidence: Evidence) -> Claim:
    """Under variable Young's modulus the ELM is the more precise on curved paths."""
    text = "Under variable Young’s modulus the ELM outperforms I-FEM on CUR"
    comparison = evidence.contrast("CUR", young="variable")
    if not comparison:
        return _not_run("young-cur", text, "I-FEM and ELM did not both run on CUR at variable Young’s modulus")
    notes = _without_failures(evidence, comparison, young="variable")
    return _judged(evidence, "young-cur", text, comparison, "elm", notes)


def overfitting_claim(evidence: Evidence) -> Claim:
    """The ELM that was trained with target noise is more precise on paths it has not seen than one trained without."""
    text, key = "Target noise in training prevents over-fitting", "overfitting"
    both = ("elm", QUIET_ARM)
    known = (evidence.contrast(group, arms=both) for group in (ALL, *GROUPS))
    comparison = next((found for found in known if found), None)
    if not comparison:
        return _not_run(key, text, "no ELM was trained without noise, or it did not run along the same paths")
    parts = [found for group in GROUPS if (found := evidence.contrast(group, arms=both))]
    notes = [f"on {found.group} {change_text(found)}, p = {p_value(found.p_primary)}" for found in parts]
    return _judged(evidence, key, text, comparison, "elm", [*_without_failures(evidence, comparison), *notes])


def _not_run(key: str, text: str, reason: str) -> Claim:
    return Claim(key, text, "results", UNDECIDED, "", "", None, "", reason)


def _judged(
    evidence: Evidence, key: str, text: str, comparison: Comparison, better: str, notes: Sequence[str]
) -> Claim:
    """The claim that `better`, one of the two compared, is the more precise."""
    sign = 1.0 if better == comparison.first else -1.0
    holds = sign * comparison.difference_mm < 0.0
    first, second = arm_name(comparison.first), arm_name(comparison.second)
    medians = f"{millimetres(comparison.median_first_mm)} {first}, {millimetres(comparison.median_second_mm)} {second}"
    verdict, reason = _direction_verdict(comparison, holds)
    effect = (
        f"rank-biserial {effect_text(comparison.rank_biserial)}; "
        f"{first} is the better in {100 * comparison.superiority:.0f} % of pairs; "
        f"the paper’s tests over all {comparison.pairs} pairs: sign p = {p_value(comparison.p_sign)}, "
        f"Mann-Whitney p = {p_value(comparison.p_mann_whitney)}"
    )
    claim = Claim(
        key=key,
        claim=text,
        source="results",
        verdict=verdict,
        figure=f"median RMSE {medians}; {first} minus {second} {change_text(comparison)}",
        test=f"sign test over {comparison.clusters} end points",
        p=comparison.p_primary,
        effect=effect,
        reason="; ".join([reason, *notes]),
    )
    band = evidence.bands.difference(comparison.group, comparison.first, comparison.second)
    return undecided_by_band(claim, band, comparison.difference_mm)


def _direction_verdict(comparison: Comparison, holds: bool) -> tuple[str, str]:
    if comparison.floor:
        low = statistics.FLOOR_MM
        return UNDECIDED, f"floor: without any feedback the error is below {low:g} mm, so precision says nothing here"
    small = f", by less than the margin of {statistics.MARGIN_MM:g} mm" if comparison.equivalent else ""
    if comparison.p_primary < SIGNIFICANT:
        return (REPRODUCED, f"the direction holds{small}") if holds else (NOT_REPRODUCED, f"the opposite holds{small}")
    which = "the direction holds" if holds else "the opposite holds"
    return UNDECIDED, f"{which}, but not significantly over {comparison.clusters} end points (p >= {SIGNIFICANT:g})"


def _without_failures(evidence: Evidence, comparison: Comparison, young: str = PRIMARY.young) -> list[str]:
    """The same comparison where neither of a pair failed: a failure counts under stability."""
    mine = under(main_rows(evidence.rows), Condition(young, PRIMARY.noise))
    mine = [row for row in mine if comparison.group in (ALL, row.group)]
    first, second = (only(mine, arm=arm) for arm in (comparison.first, comparison.second))
    if not any(row.failed for row in (*first, *second)):
        return []
    kept = [[row for row in rows if row.stable] for rows in (first, second)]
    names = (comparison.first, comparison.second)
    apart = compare(*kept, group=comparison.group, names=names)
    if apart is None:
        return ["no pair is without a failure"]
    return [f"in the {apart.pairs} pairs without a failure {change_text(apart)}, p = {p_value(apart.p_primary)}"]


def _seeds(evidence: Evidence, group: str, better: str) -> list[str]:
    for share in evidence.seeds:
        if share.group == group:
            hits = share.ifem_better if better == "ifem" else share.elm_better
            paths = "1 path" if share.paths == 1 else f"{share.paths} paths"
            return [f"holds for {hits} of {share.seeds} ELM seeds, along {paths} each"]
    return ["ELM seeds were not compared"]


def _noise(evidence: Evidence, group: str) -> list[str]:
    comparison = evidence.contrast(group, noise="on")
    return [f"with target noise {change_text(comparison)}, p = {p_value(comparison.p_primary)}"] if comparison else []


def _directions(evidence: Evidence, group: str) -> list[str]:
    """Medians of I-FEM and ELM along each direction of the group's paths."""
    mine = [
        (contrast.varied, contrast.comparison) for contrast in evidence.directions if contrast.comparison.group == group
    ]
    texts = [f"{name} {millimetres(c.median_first_mm)} against {millimetres(c.median_second_mm)}" for name, c in mine]
    return [f"by direction of the sine, I-FEM against ELM: {', '.join(texts)}"] if texts else []
