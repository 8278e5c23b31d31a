"""The claims of Perrusi et al. 2021, each held against what was measured here.

A claim is reproduced only if what it says holds, and holds by the primary test; one about all insertions needs as many
end points as the paper's for that. It is not reproduced under our assumptions, which `assumptions` lists, if the
opposite holds by the same test. Everything else is undecided: also the opposite without significance, and what lies
inside the band of the discretisation (`Evidence.bands`): of the paired difference where two controllers are compared,
of the controller where one is judged; or whatever the mesh may change where that is unknown. A failure counts once,
under stability; errors are scored over the others.
"""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from benchmarks.paper import statistics
from benchmarks.paper.direction_claims import direction_claim, overfitting_claim, variable_direction_claim
from benchmarks.paper.evidence import (
    BOTH,
    NOT_REPRODUCED,
    PAPER_END_POINTS,
    REPRODUCED,
    UNDECIDED,
    Claim,
    Evidence,
    change_text,
    judge_without_exception,
    list_failures,
    undecided_by_band,
)
from benchmarks.paper.failure_places import border_mm
from benchmarks.paper.number_text import effect_text, millimetres, p_value, share_text
from benchmarks.paper.table import ALL, Row, arm_name, main_rows
from benchmarks.paper.timing import PAPER_REDUCTIONS, Saving
from simcore.scenario.held_parts import held_faces_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from benchmarks.paper.analysis import Score
    from benchmarks.paper.bands import Band

DIFFERENT = 0.05  # [paper] of constant against variable Young's modulus
PAPER_STABLE = 0.98  # [paper] under variable Young's modulus
MOST_VALUES = 5  # of an assumption that are listed
ASSUMED = (
    ("mesh, edge of a cell", "tissue", "element_size_mm", " mm"),
    ("held faces", "tissue", "fixed_faces", ""),
    ("friction", "interaction", "friction", ""),
    ("cutting force", "interaction", "cutting_n", " N"),
    ("needle, outer diameter", "needle", "outer_diameter_mm", " mm"),
    ("needle, inner diameter", "needle", "inner_diameter_mm", " mm"),
    ("damping of the inverse, speed of a direction", "controller", "direction_speed_mm_s", " mm/s"),
    ("weight of the remote-centre rows", "controller", "rcm_weight", ""),
    ("delay of a controller", "controller", "delay_s", " s"),
    ("solution of a step", "solver", "mode", ""),
)
FEW_FAILURES = 3  # fewer have no place that could be compared


def claims(evidence: Evidence) -> list[Claim]:
    """All of them, in the paper's order."""
    return [
        stability(evidence),
        direction_claim(evidence, "lin", "I-FEM is the more precise on straight paths (LIN)", "LIN", "ifem"),
        direction_claim(evidence, "cur", "The ELM is the more precise on curved paths (CUR), p < 0.01", "CUR", "elm"),
        submillimetric(evidence),
        variable_stability(evidence),
        no_difference(evidence),
        variable_direction_claim(evidence),
        overfitting_claim(evidence),
        *(time_saved(evidence, name, share) for name, share in PAPER_REDUCTIONS.items()),
    ]


def assumptions(table: Sequence[Row]) -> list[str]:
    """What the paper leaves open and these insertions settle, one line each: what a verdict may hang on."""
    mine = main_rows(table)
    found = []
    for text, block, field, unit in ASSUMED:
        values = [_assumed(row.scenario.get(block, {}), field) for row in mine]
        known = list(dict.fromkeys(json.dumps(value) for value in values if value is not None))
        if known:
            found.append(f"{text}: {', '.join(sorted(known)[:MOST_VALUES])}{unit}".replace('"', ""))
    return found


def _assumed(block: dict[str, Any], field: str) -> Any:
    """The value of a field; of the held faces, also those that null stands for."""
    return held_faces_of(block) if field == "fixed_faces" and block else block.get(field)


def stability(evidence: Evidence) -> Claim:
    """S = 100 % for both controllers on both groups."""
    text, source = "All insertions are stable, S = 100 %, with both controllers on LIN and CUR", "results"
    scores = [(group, arm, evidence.score(group, arm)) for group in ("LIN", "CUR") for arm in BOTH]
    known = [score for _, _, score in scores if score]
    figure = "; ".join(f"{s.group} {arm_name(s.arm)} {share_text(s.stable, s.stable_interval)}" for s in known)
    if len(known) < len(scores):
        lacking = ", ".join(f"{arm_name(arm)} on {group}" for group, arm, score in scores if not score)
        return Claim("stability", text, source, UNDECIDED, figure, "", None, "", f"not run: {lacking}")
    verdict, reason = judge_without_exception(known, list_failures(evidence, "failed"))
    claim = Claim("stability", text, source, verdict, figure, "Wilson 95 %", None, "", reason)
    return undecided_by_band(claim, evidence.bands.rmse(ALL, *BOTH), math.inf)


def submillimetric(evidence: Evidence) -> Claim:
    """Every insertion of both controllers has an RMSE below 1 mm."""
    text = "The error is sub-millimetric throughout"
    known = [s for g in ("LIN", "CUR") for arm in BOTH if (s := evidence.score(g, arm))]
    if not known:
        return Claim("submillimetric", text, "abstract", UNDECIDED, "", "", None, "", "neither controller ran")
    figure = "; ".join(
        f"{s.group} {arm_name(s.arm)}: RMSE of stable insertions at most {millimetres(s.max_mm)}, "
        f"error never above 1 mm in {100 * s.within_1mm:.3g} % of all"
        for s in known
    )
    stable, failed = sum(s.insertions - s.failed for s in known), sum(s.failed for s in known)
    above = sum(round((1.0 - s.submillimetric) * s.insertions) for s in known) - failed
    exceptions = f"{above} of the {stable} that did not fail have an RMSE of 1 mm or more" if above else ""
    verdict, reason = judge_without_exception(known, exceptions)
    if not stable:
        verdict, reason = UNDECIDED, "every insertion failed"
    if failed:
        reason += f"; {failed} failed, which counts under stability"
    if len(known) < 4 and not exceptions:
        verdict, reason = UNDECIDED, "not every controller ran in both groups"
    if open_loop := [s for g in ("LIN", "CUR") if (s := evidence.score(g, "open_loop"))]:
        shares = ", ".join(f"{100 * s.submillimetric:.0f} % on {s.group}" for s in open_loop)
        reason += f"; an open loop has an RMSE below 1 mm in {shares}: on its own this proves little"
    claim = Claim("submillimetric", text, "abstract", verdict, figure, "", None, "", reason)
    return undecided_by_band(claim, *_nearest_to_turning(evidence, known, verdict))


def _nearest_to_turning(evidence: Evidence, known: Sequence[Score], verdict: str) -> tuple[Band, float]:
    """Band and margin of the controller that decides: all have to be below a millimetre, or one above."""
    held = [(evidence.bands.rmse(s.group, s.arm), 1.0 - s.max_mm) for s in known]
    if unknown := next((pair for pair in held if pair[0].mm is None), None):
        return unknown
    sign = -1.0 if verdict == REPRODUCED else 1.0
    return min(held, key=lambda pair: pair[1] + sign * (pair[0].mm or 0.0))


def variable_stability(evidence: Evidence) -> Claim:
    """S = 98 % of the ELM under variable Young's modulus, and the failures lie near the side faces."""
    text, source = "Under variable Young’s modulus S = 98 % with the ELM, failures near the borders", "results"
    score = next((s for g in (ALL, "LIN", "CUR") if (s := evidence.score(g, "elm", young="variable"))), None)
    if not score:
        return Claim("variable", text, source, UNDECIDED, "", "", None, "", "no ELM ran at variable Young’s modulus")
    figure = f"S = {share_text(score.stable, score.stable_interval)} of {score.insertions}"
    if nominal := evidence.score(score.group, "elm"):
        figure += f"; at constant Young’s modulus {share_text(nominal.stable, nominal.stable_interval)}"
    mine = [row for row in main_rows(evidence.rows) if (row.arm, row.young) == ("elm", "variable")]
    failed = [border_mm(row) for row in mine if row.failed]
    rest = [border_mm(row) for row in mine if row.stable]
    inside = score.stable_interval.low <= PAPER_STABLE <= score.stable_interval.high
    reason = f"98 % lies {'inside' if inside else 'outside'} the interval; "
    if min(len(failed), len(rest)) < FEW_FAILURES:
        verdict = UNDECIDED if inside else NOT_REPRODUCED
        reason += f"{len(failed)} failed, too few to compare where"
        claim = Claim("variable", text, source, verdict, figure, "Wilson 95 %", None, "", reason)
        return undecided_by_band(claim, evidence.bands.rmse(score.group, "elm"), math.inf)
    p = statistics.mann_whitney_p(failed, rest)
    near, far = statistics.middle(failed), statistics.middle(rest)
    nearer = near < far and p < DIFFERENT
    effect = f"median distance to a side face {near:.1f} mm of failures, {far:.1f} mm of the others"
    reason += f"the {len(failed)} failures {'lie' if nearer else 'do not lie'} nearer to the borders"
    verdict = REPRODUCED if inside and nearer else NOT_REPRODUCED
    test = "Wilson 95 %; Mann-Whitney of distances"
    claim = Claim("variable", text, source, verdict, figure, test, p, effect, reason)
    return undecided_by_band(claim, evidence.bands.rmse(score.group, "elm"), math.inf)


def no_difference(evidence: Evidence) -> Claim:
    """Constant and variable Young's modulus: no significant difference by the paper's test, and by a fair one."""
    text, source = "No significant difference between constant and variable Young’s modulus, p > 0.05", "results"
    mine = {c.comparison.group: c.comparison for c in evidence.young if c.varied == "elm"}
    comparison = next((mine[group] for group in (ALL, "CUR", "LIN") if group in mine), None)
    if not comparison:
        return Claim("young", text, source, UNDECIDED, "", "", None, "", "no ELM ran at both on the same paths")
    first, second = millimetres(comparison.median_first_mm), millimetres(comparison.median_second_mm)
    figure = f"median RMSE {first} constant, {second} variable; difference {change_text(comparison)}"
    test = f"Mann-Whitney U over {comparison.pairs} paths"
    paired = f"Wilcoxon over {comparison.clusters} end points p = {p_value(comparison.p_wilcoxon)}"
    margin = f"{statistics.MARGIN_MM:g} mm"
    there = "path by path there is a difference, but it" if comparison.p_wilcoxon <= DIFFERENT else "the difference"
    if comparison.p_mann_whitney <= DIFFERENT:
        verdict, reason = NOT_REPRODUCED, f"the paper’s own test finds a difference; {paired}"
    elif comparison.equivalent:
        verdict, reason = REPRODUCED, f"{there} is shown to be smaller than {margin}; {paired}"
    elif comparison.p_wilcoxon <= DIFFERENT:
        verdict, reason = NOT_REPRODUCED, f"unpaired there is none, but path by path there is: {paired}"
    elif comparison.clusters >= PAPER_END_POINTS:
        verdict, reason = REPRODUCED, f"none found, though not shown to be smaller than {margin}; {paired}"
    else:
        verdict, reason = UNDECIDED, f"none found, but {comparison.clusters} end points are too few; {paired}"
    effect = f"Cliff’s delta {effect_text(comparison.cliffs_delta)}"
    claim = Claim("young", text, source, verdict, figure, test, comparison.p_mann_whitney, effect, reason)
    turns_at = statistics.MARGIN_MM if verdict == REPRODUCED else comparison.difference_mm
    band = evidence.bands.difference(comparison.group, "elm", "elm")
    band = replace(band, of=f"ELM at two Young’s moduli on {comparison.group}")
    return undecided_by_band(claim, band, turns_at)


def time_saved(evidence: Evidence, where: str, share: float) -> Claim:
    """The ELM's whole step, simulation included, is shorter than I-FEM's by at least the stated share, however I-FEM
    gets its Jacobian: by the interval over paths, of which there must be enough for one."""
    said = {"abstract": "reduced to a third"}.get(where, f"reduced by {100 * share:.0f} %")
    text, key = f"Computation time is {said} ({where})", f"time-{where.replace(' ', '-')}"
    total = [s for s in evidence.savings if s.part == "total"]
    if not total:
        return Claim(key, text, where, UNDECIDED, "", "", None, "", "no timing pass with I-FEM and ELM")
    alone = {s.way: s for s in evidence.savings if s.part == "controller"}
    figure = "; ".join(
        f"{s.way}: whole step {share_text(s.saved, s.saved_interval)} shorter"
        + (f", Jacobian and command alone {100 * alone[s.way].saved:.1f} %" if s.way in alone else "")
        for s in total
    )
    pairs = min(s.pairs for s in total)
    test = f"median over {pairs} paths, bootstrap 95 %" if pairs > 1 else "one path"
    verdict, reason = _saving_verdict(total, share)
    if pairs < statistics.FEWEST_CLUSTERS:
        verdict, reason = UNDECIDED, f"{reason}; {pairs} path{'s are' if pairs > 1 else ' is'} too few to decide"
    return Claim(key, text, where, verdict, figure, test, None, "", reason)


def _saving_verdict(total: Sequence[Saving], share: float) -> tuple[str, str]:
    reached = [s.way for s in total if s.saved_interval.low >= share]
    missed = [s.way for s in total if s.saved_interval.high < share]
    if len(reached) == len(total):
        return REPRODUCED, f"a whole step saves at least {100 * share:.0f} % against {' and '.join(reached)}"
    if len(missed) == len(total):
        return NOT_REPRODUCED, f"a whole step saves less than {100 * share:.0f} % in every form of I-FEM"
    undecided = [s.way for s in total if s.way not in (*reached, *missed)]
    words = (("holds against", reached), ("does not hold against", missed), ("undecided against", undecided))
    reason = ", ".join(f"{word} {' and '.join(ways)}" for word, ways in words if ways)
    return UNDECIDED, f"{reason}; which form of I-FEM was timed is not stated"
