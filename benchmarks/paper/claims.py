"""The claims of Perrusi et al. 2021, each held against what was measured here.

A claim is reproduced only if what it says holds, and holds by the primary test; one about all insertions needs as many
end points as the paper's for that. It is contradicted if the opposite holds, or if a sample as large as the paper's
finds nothing. Everything else is not testable with this run; the reason is given. A run on a mesh or with steps coarser
than those of the experiments decides nothing, whatever it finds.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

from benchmarks.paper import statistics
from benchmarks.paper.analysis import PRIMARY, Contrast, Score, under
from benchmarks.paper.comparison import Comparison
from benchmarks.paper.failure_places import border_mm
from benchmarks.paper.learning_studies import SeedShare
from benchmarks.paper.number_text import effect as effect_size
from benchmarks.paper.number_text import millimetres, p_value, signed
from benchmarks.paper.number_text import share as share_of
from benchmarks.paper.table import ALL, GROUPS, Row, arm_name, main_rows
from benchmarks.paper.timing import PAPER_REDUCTIONS, Saving

REPRODUCED, CONTRADICTED, NOT_TESTABLE = "reproduced", "contradicted", "not testable"
SIGNIFICANT = 0.01  # [paper] of the two directions
DIFFERENT = 0.05  # [paper] of constant against variable Young's modulus
PAPER_END_POINTS = 100  # [paper] a sample that large and still nothing: the claim does not hold
PAPER_STABLE = 0.98  # [paper] under variable Young's modulus
COARSEST_MM = 6.0  # [ours] element size of the experiments; at 7.5 mm the tip is 1.7 mm away (convergence)
COARSEST_DT_S = 0.01  # [ours] time step of the experiments
FEW_FAILURES = 3  # fewer have no place that could be compared
BOTH = ("ifem", "elm")


@dataclass(frozen=True)
class Claim:
    """One claim and what became of it. figure: the measured numbers in words; test, p and effect as far as there is
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
class Findings:
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
        for found in self.contrasts:
            compared = found.comparison
            names = (compared.first, compared.second)
            if (found.young, found.noise, compared.group, names) == (PRIMARY.young, noise, group, BOTH):
                return compared
        return None


def claims(findings: Findings) -> list[Claim]:
    """All of them, in the paper's order."""
    found = [
        stability(findings),
        direction(findings, "lin", "I-FEM is the more precise on straight paths (LIN)", "LIN", "ifem"),
        direction(findings, "cur", "The ELM is the more precise on curved paths (CUR), p < 0.01", "CUR", "elm"),
        submillimetric(findings),
        variable_stability(findings),
        no_difference(findings),
        *(time_saved(findings, name, share) for name, share in PAPER_REDUCTIONS.items()),
    ]
    coarse = coarseness(findings.rows)
    return [_undecided(claim, coarse) for claim in found] if coarse else found


def coarseness(table: Sequence[Row]) -> str:
    """How the experiments' mesh or time step is too coarse for a verdict; empty if neither is."""
    mine = main_rows(table)
    size_mm = max((row.scenario.get("tissue", {}).get("element_size_mm", 0.0) for row in mine), default=0.0)
    dt_s = max((row.scenario.get("dt_s", 0.0) for row in mine), default=0.0)
    mesh = [f"a mesh of {size_mm:g} mm instead of {COARSEST_MM:g}"] if size_mm > COARSEST_MM else []
    steps = [f"steps of {1e3 * dt_s:g} ms instead of {1e3 * COARSEST_DT_S:g}"] if dt_s > COARSEST_DT_S else []
    return " and ".join(mesh + steps)


def _undecided(claim: Claim, coarse: str) -> Claim:
    return replace(claim, verdict=NOT_TESTABLE, reason=f"{claim.reason}; {coarse}: too coarse to decide")


def stability(findings: Findings) -> Claim:
    """S = 100 % for both controllers on both groups."""
    text, source = "All insertions are stable, S = 100 %, with both controllers on LIN and CUR", "results"
    found = [(group, arm, findings.score(group, arm)) for group in ("LIN", "CUR") for arm in BOTH]
    known = [score for _, _, score in found if score]
    figure = "; ".join(f"{s.group} {arm_name(s.arm)} {share_of(s.stable, s.stable_interval)}" for s in known)
    if len(known) < len(found):
        lacking = ", ".join(f"{arm_name(arm)} on {group}" for group, arm, score in found if not score)
        return Claim("stability", text, source, NOT_TESTABLE, figure, "", None, "", f"not run: {lacking}")
    verdict, reason = _without_exception(known, failures(findings, "failed"))
    return Claim("stability", text, source, verdict, figure, "Wilson 95 %", None, "", reason)


def _without_exception(known: Sequence[Score], exceptions: str) -> tuple[str, str]:
    """Verdict of a claim about all insertions, and why; exceptions: those that there are, in words."""
    if exceptions:
        return CONTRADICTED, exceptions
    count, points = sum(score.insertions for score in known), min(score.end_points for score in known)
    if points < PAPER_END_POINTS:
        return NOT_TESTABLE, f"holds in all {count} insertions, but {points} end points are too few to say “all”"
    return REPRODUCED, f"holds in all {count} insertions"


def failures(findings: Findings, word: str) -> str:
    """How many insertions of both controllers failed under the primary condition, and how; empty if none did."""
    mine = [row for row in under(main_rows(findings.rows), PRIMARY) if row.arm in BOTH and row.group in GROUPS]
    kinds = Counter(row.status.replace("_", " ") for row in mine if row.failed)
    how = ", ".join(f"{count} {kind}" for kind, count in kinds.most_common())
    return f"{kinds.total()} of {len(mine)} insertions {word} ({how})" if kinds else ""


# ---- directions


def direction(findings: Findings, key: str, text: str, group: str, better: str) -> Claim:
    """One controller is the more precise: the median difference says so and the clustered sign test agrees."""
    found = findings.contrast(group)
    if not found:
        return Claim(key, text, "results", NOT_TESTABLE, "", "", None, "", f"I-FEM and ELM did not both run on {group}")
    sign = 1.0 if better == "ifem" else -1.0
    holds = sign * found.difference_mm < 0.0
    medians = f"median RMSE {millimetres(found.median_first_mm)} I-FEM, {millimetres(found.median_second_mm)} ELM"
    figure = f"{medians}; I-FEM minus ELM {_change(found)}"
    verdict, reason = _direction_verdict(found, holds)
    notes = [reason, *_seeds(findings, group, better), *_noise(findings, group), *_directions(findings, group)]
    effect = (
        f"rank-biserial {effect_size(found.rank_biserial)}; "
        f"I-FEM is the better in {100 * found.superiority:.0f} % of pairs; "
        f"the paper’s tests over all {found.pairs} pairs: sign p = {p_value(found.p_sign)}, "
        f"Mann-Whitney p = {p_value(found.p_mann_whitney)}"
    )
    test = f"sign test over {found.clusters} end points"
    return Claim(key, text, "results", verdict, figure, test, found.p_primary, effect, "; ".join(notes))


def _direction_verdict(found: Comparison, holds: bool) -> tuple[str, str]:
    if found.floor:
        low = statistics.FLOOR_MM
        return (
            NOT_TESTABLE,
            f"floor: without any feedback the error is below {low:g} mm, so precision says nothing here",
        )
    small = f", by less than the margin of {statistics.MARGIN_MM:g} mm" if found.equivalent else ""
    if found.p_primary < SIGNIFICANT:
        return (REPRODUCED, f"the direction holds{small}") if holds else (CONTRADICTED, f"the opposite holds{small}")
    which = "the direction holds" if holds else "the opposite holds"
    if found.clusters >= PAPER_END_POINTS:
        few = f"not significantly (p >= {SIGNIFICANT:g}), with as many end points as in the paper"
        return CONTRADICTED, f"{which}, but {few}"
    return NOT_TESTABLE, f"{which}, but {found.clusters} end points are too few to decide (p >= {SIGNIFICANT:g})"


def _seeds(findings: Findings, group: str, better: str) -> list[str]:
    for share in findings.seeds:
        if share.group == group:
            hits = share.ifem_better if better == "ifem" else share.elm_better
            paths = "1 path" if share.paths == 1 else f"{share.paths} paths"
            return [f"holds for {hits} of {share.seeds} ELM seeds, along {paths} each"]
    return ["ELM seeds were not compared"]


def _noise(findings: Findings, group: str) -> list[str]:
    found = findings.contrast(group, noise="on")
    return [f"with target noise {_change(found)}, p = {p_value(found.p_primary)}"] if found else []


def _directions(findings: Findings, group: str) -> list[str]:
    """Medians of I-FEM and ELM along each direction of the group's paths."""
    mine = [(found.varied, found.comparison) for found in findings.directions if found.comparison.group == group]
    told = [f"{name} {millimetres(c.median_first_mm)} against {millimetres(c.median_second_mm)}" for name, c in mine]
    return [f"by direction of the sine, I-FEM against ELM: {', '.join(told)}"] if told else []


# ---- precision and stability


def submillimetric(findings: Findings) -> Claim:
    """Every insertion of both controllers has an RMSE below 1 mm."""
    text = "The error is sub-millimetric throughout"
    known = [s for g in ("LIN", "CUR") for arm in BOTH if (s := findings.score(g, arm))]
    if not known:
        return Claim("submillimetric", text, "abstract", NOT_TESTABLE, "", "", None, "", "neither controller ran")
    figure = "; ".join(
        f"{s.group} {arm_name(s.arm)}: RMSE of stable insertions at most {millimetres(s.max_mm)}, "
        f"error never above 1 mm in {100 * s.within_1mm:.3g} % of all"
        for s in known
    )
    count, failed = sum(s.insertions for s in known), sum(s.failed for s in known)
    above = sum(round((1.0 - s.submillimetric) * s.insertions) for s in known) - failed
    counted = failures(findings, "failed, and a failure has no error")
    found = [*([f"{above} of {count} have an RMSE of 1 mm or more"] if above else []), *([counted] if counted else [])]
    verdict, reason = _without_exception(known, "; ".join(found))
    if len(known) < 4 and not found:
        verdict, reason = NOT_TESTABLE, "not every controller ran in both groups"
    if open_loop := [s for g in ("LIN", "CUR") if (s := findings.score(g, "open_loop"))]:
        shares = ", ".join(f"{100 * s.submillimetric:.0f} % on {s.group}" for s in open_loop)
        reason += f"; an open loop has an RMSE below 1 mm in {shares}: alone this proves little"
    return Claim("submillimetric", text, "abstract", verdict, figure, "", None, "", reason)


def variable_stability(findings: Findings) -> Claim:
    """S = 98 % of the ELM under variable Young's modulus, and the failures lie near the side faces."""
    text, source = "Under variable Young’s modulus S = 98 % with the ELM, failures near the borders", "results"
    score = next((s for g in (ALL, "LIN", "CUR") if (s := findings.score(g, "elm", young="variable"))), None)
    if not score:
        return Claim("variable", text, source, NOT_TESTABLE, "", "", None, "", "no ELM ran at variable Young’s modulus")
    figure = f"S = {share_of(score.stable, score.stable_interval)} of {score.insertions}"
    if nominal := findings.score(score.group, "elm"):
        figure += f"; at constant Young’s modulus {share_of(nominal.stable, nominal.stable_interval)}"
    mine = [row for row in main_rows(findings.rows) if (row.arm, row.young) == ("elm", "variable")]
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


def no_difference(findings: Findings) -> Claim:
    """Constant and variable Young's modulus: no significant difference by the paper's test, and by a fair one."""
    text, source = "No significant difference between constant and variable Young’s modulus, p > 0.05", "results"
    mine = {c.comparison.group: c.comparison for c in findings.young if c.varied == "elm"}
    found = next((mine[group] for group in (ALL, "CUR", "LIN") if group in mine), None)
    if not found:
        return Claim("young", text, source, NOT_TESTABLE, "", "", None, "", "no ELM ran at both on the same paths")
    medians = (
        f"median RMSE {millimetres(found.median_first_mm)} constant, {millimetres(found.median_second_mm)} variable"
    )
    figure = f"{medians}; difference {_change(found)}"
    test = f"Mann-Whitney U over {found.pairs} paths"
    paired = f"Wilcoxon over {found.clusters} end points p = {p_value(found.p_wilcoxon)}"
    margin = f"{statistics.MARGIN_MM:g} mm"
    there = "path by path there is a difference, but it" if found.p_wilcoxon <= DIFFERENT else "the difference"
    if found.p_mann_whitney <= DIFFERENT:
        verdict, reason = CONTRADICTED, f"the paper’s own test finds a difference; {paired}"
    elif found.equivalent:
        verdict, reason = REPRODUCED, f"{there} is shown to be smaller than {margin}; {paired}"
    elif found.p_wilcoxon <= DIFFERENT:
        verdict, reason = CONTRADICTED, f"unpaired there is none, but path by path there is: {paired}"
    elif found.clusters >= PAPER_END_POINTS:
        verdict, reason = REPRODUCED, f"none found, though not shown to be smaller than {margin}; {paired}"
    else:
        verdict, reason = NOT_TESTABLE, f"none found, but {found.clusters} end points are too few; {paired}"
    effect = f"Cliff’s delta {effect_size(found.cliffs_delta)}"
    return Claim("young", text, source, verdict, figure, test, found.p_mann_whitney, effect, reason)


# ---- time


def time_saved(findings: Findings, where: str, share: float) -> Claim:
    """The ELM's whole step, simulation included, is shorter than I-FEM's by at least the stated share, however I-FEM
    gets its Jacobian: by the interval over paths, of which there must be enough for one."""
    said = {"abstract": "reduced to a third"}.get(where, f"reduced by {100 * share:.0f} %")
    text, key = f"Computation time is {said} ({where})", f"time-{where.replace(' ', '-')}"
    total = [s for s in findings.savings if s.part == "total"]
    if not total:
        return Claim(key, text, where, NOT_TESTABLE, "", "", None, "", "no timing pass with I-FEM and ELM")
    alone = {s.way: s for s in findings.savings if s.part == "controller"}
    figure = "; ".join(
        f"{s.way}: whole step {share_of(s.saved, s.saved_interval)} shorter"
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
    words = (("holds against", reached), ("not against", missed), ("undecided against", undecided))
    reason = ", ".join(f"{word} {' and '.join(ways)}" for word, ways in words if ways)
    return NOT_TESTABLE, f"{reason}; which form of I-FEM was timed is not stated"


def _change(found: Comparison) -> str:
    low, high = found.difference_interval_mm.low, found.difference_interval_mm.high
    return f"{signed(found.difference_mm)} mm [{signed(low)}, {signed(high)}]"
