"""Evidence of made-up insertions whose answer is known."""

from __future__ import annotations

from typing import TYPE_CHECKING

from benchmarks.paper.analysis import controller_contrasts, direction_contrasts, scores, young_contrasts
from benchmarks.paper.bands import Bands
from benchmarks.paper.claims import claims
from benchmarks.paper.evidence import Claim, Evidence
from benchmarks.paper.learning_studies import seed_scores, seed_shares
from benchmarks.paper.table import rows
from benchmarks.paper.timing import savings
from tests.benchmarks.paper.synthetic import (
    labelled,
    outcome,
)

if TYPE_CHECKING:
    from benchmarks.cases import Outcome

NARROW = Bands(named_mm=1e-4, named_difference_mm=1e-4)


def evidence_of(outcomes: list[Outcome], timing: list[Outcome] | None = None, bands: Bands = NARROW) -> Evidence:
    table = rows(outcomes)
    return Evidence(
        rows=table,
        scores=scores(table),
        contrasts=controller_contrasts(table),
        young=young_contrasts(table),
        directions=direction_contrasts(table),
        savings=savings(rows(timing or [])),
        seeds=seed_shares(seed_scores(table)),
        bands=bands,
    )


def verdicts(outcomes: list[Outcome], timing: list[Outcome] | None = None, bands: Bands = NARROW) -> dict[str, Claim]:
    return {claim.key: claim for claim in claims(evidence_of(outcomes, timing, bands))}


def pair(group: str, ifem: list[float], elm: list[float]) -> list[Outcome]:
    """I-FEM and ELM on as many end points, one path each."""
    direction = "+x" if group == "CUR" else ""
    return [
        outcome(f"{group}-{i:03}-{arm}", error, labelled(group, arm, i, direction))
        for arm, errors in (("ifem", ifem), ("elm", elm))
        for i, error in enumerate(errors)
    ]
