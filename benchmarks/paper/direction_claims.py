"""The claims about which controller is the more precise, on straight and on curved paths."""

from __future__ import annotations

from benchmarks.paper import statistics
from benchmarks.paper.comparison import Comparison
from benchmarks.paper.evidence import (
    CONTRADICTED,
    NOT_TESTABLE,
    PAPER_END_POINTS,
    REPRODUCED,
    Claim,
    Evidence,
    change_text,
)
from benchmarks.paper.number_text import effect_text, millimetres, p_value

SIGNIFICANT = 0.01  # [paper] of the two directions


def direction_claim(evidence: Evidence, key: str, text: str, group: str, better: str) -> Claim:
    """One controller is the more precise: the median difference says so and the clustered sign test agrees."""
    comparison = evidence.contrast(group)
    if not comparison:
        return Claim(key, text, "results", NOT_TESTABLE, "", "", None, "", f"I-FEM and ELM did not both run on {group}")
    sign = 1.0 if better == "ifem" else -1.0
    holds = sign * comparison.difference_mm < 0.0
    ifem, elm = millimetres(comparison.median_first_mm), millimetres(comparison.median_second_mm)
    figure = f"median RMSE {ifem} I-FEM, {elm} ELM; I-FEM minus ELM {change_text(comparison)}"
    verdict, reason = _direction_verdict(comparison, holds)
    notes = [reason, *_seeds(evidence, group, better), *_noise(evidence, group), *_directions(evidence, group)]
    effect = (
        f"rank-biserial {effect_text(comparison.rank_biserial)}; "
        f"I-FEM is the better in {100 * comparison.superiority:.0f} % of pairs; "
        f"the paper’s tests over all {comparison.pairs} pairs: sign p = {p_value(comparison.p_sign)}, "
        f"Mann-Whitney p = {p_value(comparison.p_mann_whitney)}"
    )
    test = f"sign test over {comparison.clusters} end points"
    return Claim(key, text, "results", verdict, figure, test, comparison.p_primary, effect, "; ".join(notes))


def _direction_verdict(comparison: Comparison, holds: bool) -> tuple[str, str]:
    if comparison.floor:
        low = statistics.FLOOR_MM
        return (
            NOT_TESTABLE,
            f"floor: without any feedback the error is below {low:g} mm, so precision says nothing here",
        )
    small = f", by less than the margin of {statistics.MARGIN_MM:g} mm" if comparison.equivalent else ""
    if comparison.p_primary < SIGNIFICANT:
        return (REPRODUCED, f"the direction holds{small}") if holds else (CONTRADICTED, f"the opposite holds{small}")
    which = "the direction holds" if holds else "the opposite holds"
    if comparison.clusters >= PAPER_END_POINTS:
        few = f"not significantly (p >= {SIGNIFICANT:g}), with as many end points as in the paper"
        return CONTRADICTED, f"{which}, but {few}"
    return NOT_TESTABLE, f"{which}, but {comparison.clusters} end points are too few to decide (p >= {SIGNIFICANT:g})"


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
