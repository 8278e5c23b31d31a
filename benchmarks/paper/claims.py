"""The claims of Perrusi et al. 2021, each held against what was measured here.

A claim is reproduced only if what it says holds, and holds by the primary test; one about all insertions needs as many
end points as the paper's for that. It is contradicted if the opposite holds, or if a sample as large as the paper's
finds nothing. Everything else is not testable with this run; the reason is given. A run on a mesh or with steps coarser
than those of the experiments decides nothing, whatever it finds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from benchmarks.paper import statistics
from benchmarks.paper.direction_claims import direction_claim
from benchmarks.paper.evidence import (
    BOTH,
    CONTRADICTED,
    NOT_TESTABLE,
    PAPER_END_POINTS,
    REPRODUCED,
    Claim,
    Evidence,
    change_text,
    judge_without_exception,
    list_failures,
)
from benchmarks.paper.failure_places import border_mm
from benchmarks.paper.number_text import effect_text, millimetres, p_value, share_text
from benchmarks.paper.table import ALL, Row, arm_name, main_rows
from benchmarks.paper.timing import PAPER_REDUCTIONS, Saving

DIFFERENT = 0.05  # [paper] of constant against variable Young's modulus
PAPER_STABLE = 0.98  # [paper] under variable Young's modulus
COARSEST_MM = 6.0  # [ours] element size of the experiments; at 7.5 mm the tip is 1.7 mm away (convergence)
COARSEST_DT_S = 0.01  # [ours] time step of the experiments
FEW_FAILURES = 3  # fewer have no place that could be compared


def claims(evidence: Evidence) -> list[Claim]:
    """All of them, in the paper's order."""
    all_claims = [
        stability(evidence),
        direction_claim(evidence, "lin", "I-FEM is the more precise on straight paths (LIN)", "LIN", "ifem"),
        direction_claim(evidence, "cur", "The ELM is the more precise on curved paths (CUR), p < 0.01", "CUR", "elm"),
        submillimetric(evidence),
        variable_stability(evidence),
        no_difference(evidence),
        *(time_saved(evidence, name, share) for name, share in PAPER_REDUCTIONS.items()),
    ]
    coarse = coarseness(evidence.rows)
    return [_mark_undecided(claim, coarse) for claim in all_claims] if coarse else all_claims


def coarseness(table: Sequence[Row]) -> str:
    """How the experiments' mesh or time step is too coarse for a verdict; empty if neither is."""
    mine = main_rows(table)
    size_mm = max((row.scenario.get("tissue", {}).get("element_size_mm", 0.0) for row in mine), default=0.0)
    dt_s = max((row.scenario.get("dt_s", 0.0) for row in mine), default=0.0)
    mesh = [f"a mesh of {size_mm:g} mm instead of {COARSEST_MM:g}"] if size_mm > COARSEST_MM else []
    steps = [f"steps of {1e3 * dt_s:g} ms instead of {1e3 * COARSEST_DT_S:g}"] if dt_s > COARSEST_DT_S else []
    return " and ".join(mesh + steps)


def _mark_undecided(claim: Claim, coarse: str) -> Claim:
    return replace(claim, verdict=NOT_TESTABLE, reason=f"{claim.reason}; {coarse}: too coarse to decide")


def stability(evidence: Evidence) -> Claim:
    """S = 100 % for both controllers on both groups."""
    text, source = "All insertions are stable, S = 100 %, with both controllers on LIN and CUR", "results"
    scores = [(group, arm, evidence.score(group, arm)) for group in ("LIN", "CUR") for arm in BOTH]
    known = [score for _, _, score in scores if score]
    figure = "; ".join(f"{s.group} {arm_name(s.arm)} {share_text(s.stable, s.stable_interval)}" for s in known)
    if len(known) < len(scores):
        lacking = ", ".join(f"{arm_name(arm)} on {group}" for group, arm, score in scores if not score)
        return Claim("stability", text, source, NOT_TESTABLE, figure, "", None, "", f"not run: {lacking}")
    verdict, reason = judge_without_exception(known, list_failures(evidence, "failed"))
    return Claim("stability", text, source, verdict, figure, "Wilson 95 %", None, "", reason)


def submillimetric(evidence: Evidence) -> Claim:
    """Every insertion of both controllers has an RMSE below 1 mm."""
    text = "The error is sub-millimetric throughout"
    known = [s for g in ("LIN", "CUR") for arm in BOTH if (s := evidence.score(g, arm))]
    if not known:
        return Claim("submillimetric", text, "abstract", NOT_TESTABLE, "", "", None, "", "neither controller ran")
    figure = "; ".join(
        f"{s.group} {arm_name(s.arm)}: RMSE of stable insertions at most {millimetres(s.max_mm)}, "
        f"error never above 1 mm in {100 * s.within_1mm:.3g} % of all"
        for s in known
    )
    count, failed = sum(s.insertions for s in known), sum(s.failed for s in known)
    above = sum(round((1.0 - s.submillimetric) * s.insertions) for s in known) - failed
    counted = list_failures(evidence, "failed, and a failure has no error")
    exceptions = [
        *([f"{above} of {count} have an RMSE of 1 mm or more"] if above else []),
        *([counted] if counted else []),
    ]
    verdict, reason = judge_without_exception(known, "; ".join(exceptions))
    if len(known) < 4 and not exceptions:
        verdict, reason = NOT_TESTABLE, "not every controller ran in both groups"
    if open_loop := [s for g in ("LIN", "CUR") if (s := evidence.score(g, "open_loop"))]:
        shares = ", ".join(f"{100 * s.submillimetric:.0f} % on {s.group}" for s in open_loop)
        reason += f"; an open loop has an RMSE below 1 mm in {shares}: on its own this proves little"
    return Claim("submillimetric", text, "abstract", verdict, figure, "", None, "", reason)


def variable_stability(evidence: Evidence) -> Claim:
    """S = 98 % of the ELM under variable Young's modulus, and the failures lie near the side faces."""
    text, source = "Under variable Young’s modulus S = 98 % with the ELM, failures near the borders", "results"
    score = next((s for g in (ALL, "LIN", "CUR") if (s := evidence.score(g, "elm", young="variable"))), None)
    if not score:
        return Claim("variable", text, source, NOT_TESTABLE, "", "", None, "", "no ELM ran at variable Young’s modulus")
    figure = f"S = {share_text(score.stable, score.stable_interval)} of {score.insertions}"
    if nominal := evidence.score(score.group, "elm"):
        figure += f"; at constant Young’s modulus {share_text(nominal.stable, nominal.stable_interval)}"
    mine = [row for row in main_rows(evidence.rows) if (row.arm, row.young) == ("elm", "variable")]
    failed = [border_mm(row) for row in mine if row.failed]
    rest = [border_mm(row) for row in mine if row.stable]
    inside = score.stable_interval.low <= PAPER_STABLE <= score.stable_interval.high
    reason = f"98 % lies {'inside' if inside else 'outside'} the interval; "
    if min(len(failed), len(rest)) < FEW_FAILURES:
        verdict = NOT_TESTABLE if inside else CONTRADICTED
        reason += f"{len(failed)} failed, too few to compare where"
        return Claim("variable", text, source, verdict, figure, "Wilson 95 %", None, "", reason)
    p = statistics.mann_whitney_p(failed, rest)
    near, far = statistics.middle(failed), statistics.middle(rest)
    nearer = near < far and p < DIFFERENT
    effect = f"median distance to a side face {near:.1f} mm of failures, {far:.1f} mm of the others"
    reason += f"the {len(failed)} failures {'lie' if nearer else 'do not lie'} nearer to the borders"
    verdict = REPRODUCED if inside and nearer else CONTRADICTED
    return Claim("variable", text, source, verdict, figure, "Wilson 95 %; Mann-Whitney of distances", p, effect, reason)


def no_difference(evidence: Evidence) -> Claim:
    """Constant and variable Young's modulus: no significant difference by the paper's test, and by a fair one."""
    text, source = "No significant difference between constant and variable Young’s modulus, p > 0.05", "results"
    mine = {c.comparison.group: c.comparison for c in evidence.young if c.varied == "elm"}
    comparison = next((mine[group] for group in (ALL, "CUR", "LIN") if group in mine), None)
    if not comparison:
        return Claim("young", text, source, NOT_TESTABLE, "", "", None, "", "no ELM ran at both on the same paths")
    first, second = millimetres(comparison.median_first_mm), millimetres(comparison.median_second_mm)
    figure = f"median RMSE {first} constant, {second} variable; difference {change_text(comparison)}"
    test = f"Mann-Whitney U over {comparison.pairs} paths"
    paired = f"Wilcoxon over {comparison.clusters} end points p = {p_value(comparison.p_wilcoxon)}"
    margin = f"{statistics.MARGIN_MM:g} mm"
    there = "path by path there is a difference, but it" if comparison.p_wilcoxon <= DIFFERENT else "the difference"
    if comparison.p_mann_whitney <= DIFFERENT:
        verdict, reason = CONTRADICTED, f"the paper’s own test finds a difference; {paired}"
    elif comparison.equivalent:
        verdict, reason = REPRODUCED, f"{there} is shown to be smaller than {margin}; {paired}"
    elif comparison.p_wilcoxon <= DIFFERENT:
        verdict, reason = CONTRADICTED, f"unpaired there is none, but path by path there is: {paired}"
    elif comparison.clusters >= PAPER_END_POINTS:
        verdict, reason = REPRODUCED, f"none found, though not shown to be smaller than {margin}; {paired}"
    else:
        verdict, reason = NOT_TESTABLE, f"none found, but {comparison.clusters} end points are too few; {paired}"
    effect = f"Cliff’s delta {effect_text(comparison.cliffs_delta)}"
    return Claim("young", text, source, verdict, figure, test, comparison.p_mann_whitney, effect, reason)


def time_saved(evidence: Evidence, where: str, share: float) -> Claim:
    """The ELM's whole step, simulation included, is shorter than I-FEM's by at least the stated share, however I-FEM
    gets its Jacobian: by the interval over paths, of which there must be enough for one."""
    said = {"abstract": "reduced to a third"}.get(where, f"reduced by {100 * share:.0f} %")
    text, key = f"Computation time is {said} ({where})", f"time-{where.replace(' ', '-')}"
    total = [s for s in evidence.savings if s.part == "total"]
    if not total:
        return Claim(key, text, where, NOT_TESTABLE, "", "", None, "", "no timing pass with I-FEM and ELM")
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
        verdict, reason = NOT_TESTABLE, f"{reason}; {pairs} path{'s are' if pairs > 1 else ' is'} too few to decide"
    return Claim(key, text, where, verdict, figure, test, None, "", reason)


def _saving_verdict(total: Sequence[Saving], share: float) -> tuple[str, str]:
    reached = [s.way for s in total if s.saved_interval.low >= share]
    missed = [s.way for s in total if s.saved_interval.high < share]
    if len(reached) == len(total):
        return REPRODUCED, f"a whole step saves at least {100 * share:.0f} % against {' and '.join(reached)}"
    if len(missed) == len(total):
        return CONTRADICTED, f"a whole step saves less than {100 * share:.0f} % in every form of I-FEM"
    undecided = [s.way for s in total if s.way not in (*reached, *missed)]
    words = (("holds against", reached), ("does not hold against", missed), ("undecided against", undecided))
    reason = ", ".join(f"{word} {' and '.join(ways)}" for word, ways in words if ways)
    return NOT_TESTABLE, f"{reason}; which form of I-FEM was timed is not stated"
