"""Committed results as tables: the paper rerun, the golden numbers, the convergence study, the timings."""

from __future__ import annotations

import csv
import json
import statistics
from collections import Counter
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.paper.number_text import error_text
from benchmarks.paper.table import ARMS, BESIDE, GROUPS, arm_name
from page_tables.markdown import percent, signed_percent, table

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

RESULTS = Path(__file__).parents[2] / "benchmarks" / "results"
Row = dict[str, str]
Json = dict[str, Any]

FAILED = error_text(None)
VERDICTS = ("reproduced", "not reproduced under our assumptions", "undecided")


@cache
def _json(name: str) -> Any:
    return json.loads((RESULTS / name).read_text(encoding="utf-8"))


@cache
def _csv(name: str) -> tuple[Row, ...]:
    with (RESULTS / name).open(encoding="utf-8", newline="") as file:
        return tuple(csv.DictReader(file))


# ---- the paper


def _insertions(**wanted: str) -> list[Row]:
    """Rows of the main experiment under the primary condition: constant Young's modulus, no target noise."""
    primary = {"young": "constant", "noise": "off", "purpose": "main", "model_seed": "", "parameter": "", **wanted}
    return [
        row
        for row in _csv("paper/insertions.csv")
        if all(row.get(name, "") == value for name, value in primary.items())
    ]


def _stable_median(rows: Sequence[Row], metric: str) -> float:
    return statistics.median(float(row[metric]) for row in rows if row["stable"] == "yes")


def _beside() -> dict[str, tuple[str, int]]:
    """What a small tip error may have been paid with, as far as committed insertions measured it: heading, digits."""
    measured = _csv("paper/insertions.csv")[0]
    return {metric: (head.replace(",", ""), digits) for metric, (head, digits) in BESIDE.items() if metric in measured}


def _scores() -> list[Json]:
    """Scores of LIN, CUR and ALL under the primary condition, controllers in their usual order."""
    found = [s for s in _json("paper/report.json")["scores"] if (s["young"], s["noise"]) == ("constant", "off")]
    return sorted(found, key=lambda s: ((*GROUPS, "ALL").index(s["group"]), ARMS.index(s["arm"])))


def _of_score(score: Json) -> list[Row]:
    groups = GROUPS if score["group"] == "ALL" else (score["group"],)
    return [row for group in groups for row in _insertions(group=group, arm=score["arm"])]


def _ratio(score: Json) -> str:
    return FAILED if score["ratio"] is None else f"{score['ratio']:.3f}"


def _quartiles(score: Json) -> str:
    low, high = error_text(score["q1_mm"]), error_text(score["q3_mm"])
    return low if low == high == FAILED else f"{low}–{high}"


def summary() -> str:
    """The README's table: how well the tip follows the path, and what that costs at the entry and in force."""
    rows = []
    for score in _scores():
        if score["group"] == "ALL" or score["arm"] not in ("ifem", "elm", "open_loop"):
            continue
        found = _of_score(score)
        rows.append(
            (
                score["group"] if score["arm"] == "ifem" else "",
                arm_name(score["arm"]),
                str(score["insertions"]),
                percent(score["stable"]),
                error_text(score["median_mm"]),
                *(f"{_stable_median(found, metric):.{digits}f}" for metric, (_, digits) in _beside().items()),
            )
        )
    head = ("paths", "controller", "insertions", "stable", "RMSE mm", *(head for head, _ in _beside().values()))
    return table(head, rows, numbers=range(2, len(head)))


def paper_scores() -> str:
    """Every controller on straight paths, curved ones, and all."""
    rows, before = [], ""
    for score in _scores():
        found = _of_score(score)
        rows.append(
            (
                score["group"] if score["group"] != before else "",
                arm_name(score["arm"]),
                str(score["insertions"]),
                percent(score["stable"]),
                error_text(score["median_mm"]),
                _quartiles(score),
                error_text(score["max_mm"]),
                percent(score["within_1mm"]),
                _ratio(score),
                *(f"{_stable_median(found, metric):.{digits}f}" for metric, (_, digits) in _beside().items()),
            )
        )
        before = score["group"]
    head = (
        "paths",
        "controller",
        "n",
        "S",
        "median RMSE mm",
        "quartiles mm",
        "largest RMSE mm",
        "never above 1 mm",
        "ratio to open loop",
        *(head for head, _ in _beside().values()),
    )
    return table(head, rows, numbers=range(2, len(head)))


def verdicts() -> str:
    """How many claims of the paper ended how, in one sentence."""
    claims = _json("paper/report.json")["claims"]
    counts = Counter(claim["verdict"] for claim in claims)
    parts = [f"{counts[verdict]} {verdict}" for verdict in VERDICTS if counts[verdict]]
    told = " and ".join([", ".join(parts[:-1]), parts[-1]] if parts[1:] else parts)
    return f"Of the {len(claims)} claims of the paper that were checked: {told}."


def paper_claims() -> str:
    """Each claim of the paper with the verdict of the committed run."""
    items = []
    for claim in _json("paper/report.json")["claims"]:
        verdict = f"**{_sentence(claim['verdict'])}**"
        p = "" if claim["p"] is None else f", p = {claim['p']:.2g}"
        test = f" ({claim['test']}{p})" if claim["test"] else ""
        items.append(f"1. *{claim['claim']}.* {verdict}\n\n   {claim['figure']}{test}. {_sentence(claim['reason'])}")
    return "\n\n".join(items)


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}."


def paper_directions() -> str:
    """Curved paths by the direction of the sine, I-FEM beside the ELM: tip, entry and push."""
    rows = []
    shown = {metric: digits for metric, (_, digits) in _beside().items()} | {"min_det_f": 2}
    for found in sorted(_json("paper/report.json")["directions"], key=lambda d: (d["varied"][1], d["varied"][0])):
        arms = (found["first"], found["second"])
        both = [_insertions(group="CUR", arm=arm, direction=found["varied"]) for arm in arms]
        cells = [
            " / ".join(f"{_stable_median(insertions, metric):.{digits}f}" for insertions in both)
            for metric, digits in shown.items()
        ]
        failures = [str(sum(row["stable"] == "no" for row in insertions)) for insertions in both]
        rows.append(
            (
                f"sine along {found['varied'].replace('-', '−')}",
                f"{error_text(found['median_first_mm'])} / {error_text(found['median_second_mm'])}",
                *cells,
                f"{found['clusters_below']} of {found['clusters']}",
                " / ".join(failures),
            )
        )
    head = (
        "I-FEM / ELM",
        "RMSE mm",
        *(head for head, _ in _beside().values()),
        "min det F",
        "I-FEM better to end points",
        "failures",
    )
    return table(head, rows, numbers=range(1, len(head)))


def paper_meshes() -> str:
    """Medians over the paths that were run on both meshes, and to how many end points I-FEM is ahead on each."""
    rows = []
    coarse, fine = (_errors(name) for name in ("paper/mesh-8/insertions.csv", "paper/insertions.csv"))
    for group in GROUPS:
        medians = [
            error_text(statistics.median(error for key, error in coarse.items() if key[:2] == (group, arm)))
            + " / "
            + error_text(statistics.median(fine[key] for key in coarse if key[:2] == (group, arm)))
            for arm in ("ifem", "elm")
        ]
        apart = [
            error_text(max(abs(error - fine[key]) for key, error in coarse.items() if key[:2] == (group, arm)))
            for arm in ("ifem", "elm")
        ]
        ends = {key[2] for key in coarse if key[:2] == (group, "elm")}
        ahead = [sum(_lead(errors, group, end) > 0.0 for end in ends) for errors in (coarse, fine)]
        rows.append((group, *medians, *apart, f"{ahead[0]} / {ahead[1]} of {len(ends)}"))
    head = ("8 / 6 mm", "I-FEM mm", "ELM mm", "largest change, I-FEM mm", "largest change, ELM mm", "I-FEM ahead to")
    return table(head, rows, numbers=range(1, 6))


Errors = dict[tuple[str, str, str, str], float]  # group, arm, end point, direction -> RMSE in mm


def _errors(name: str) -> Errors:
    keys, primary = ("group", "arm", "end_point", "direction"), ("main", "constant", "off")
    rows = [row for row in _csv(name) if (row["purpose"], row["young"], row["noise"]) == primary]
    return {tuple(row[key] for key in keys): float(row["rmse_commanded_mm"]) for row in rows}


def _lead(errors: Errors, group: str, end: str) -> float:
    """By how much I-FEM is ahead to an end point, mm: the median over its directions."""
    ways = [key[3] for key in errors if key[:3] == (group, "elm", end)]
    return statistics.median(errors[group, "elm", end, way] - errors[group, "ifem", end, way] for way in ways)


# ---- the golden numbers

_SHOWN: tuple[tuple[str, str, Callable[[Any], str]], ...] = (
    ("RMSE mm", "rmse_commanded_mm", "{:.4f}".format),
    ("largest error mm", "max_commanded_mm", "{:.3f}".format),
    *((head.replace(",", ""), metric, f"{{:.{digits}f}}".format) for metric, (head, digits) in BESIDE.items()),
    ("success", "success", lambda yes: "yes" if yes else "no"),
)


def builtin_scenarios() -> str:
    """The built-in scenarios that are steered, and the same paths without feedback."""
    cases = _json("builtin_scenarios.json")["cases"]
    columns = [column for column in _SHOWN if column[1] in cases["line"]["metrics"]]
    rows = []
    for name in cases:
        without = f"{name}, open loop"
        if without not in cases:
            continue
        for case, first, controller in ((name, f"`{name}`", "I-FEM"), (without, "", "open loop")):
            rows.append((first, controller, *(show(cases[case]["metrics"][key]) for _, key, show in columns)))
    return table(("path", "controller", *(head for head, _, _ in columns)), rows, numbers=range(2, 2 + len(columns)))


# ---- the sweeps

_COMPARED = (
    ("h = 6 mm (default)", "mesh", "6", "h = 4 mm", "4"),
    ("h = 10 mm", "mesh", "10", "h = 4 mm", "4"),
    ("ball of 4 mm", "spread", "4", "ball of 6 mm (default)", "6"),
    ("spacing 3 mm (default)", "spacing", "3", "spacing 1 mm", "1"),
    ("spacing 12 mm", "spacing", "12", "spacing 1 mm", "1"),
    ("20 beams (default)", "beams", "20", "80 beams", "80"),
    ("dt = 10 ms (default)", "dt", "10", "dt = 1.2 ms", "1.2"),
    ("held tip", "coupling", "held tip", "free tip (default)", "free tip"),
    ("hard points, held tip", "coupling", "hard", "compliant line, free tip (default)", "free tip"),
    ("back face held, z", "faces", "z", "faces across y held (default)", "y"),
)


def discretisation() -> str:
    """What one change of the discretisation, or of what is coupled and held, does to the tip and the forces."""
    found = {(row["sweep"], row["variant"]): row for row in _csv("sweeps/sweeps.csv")}
    rows = []
    for label, sweep, variant, against, reference in _COMPARED:
        here, there = found[sweep, variant], found[sweep, reference]
        forces = [signed_percent(float(here[name]) / float(there[name])) for name in ("push_mean_n", "lateral_mean_n")]
        entry = " / ".join(f"{1e3 * float(row['entry_mean_n']):.2f}" for row in (here, there))
        rows.append((label, against, f"{float(here['tip_max_mm']):.2g}", entry, *forces))
    head = (
        "variant",
        "against",
        "largest tip difference mm",
        "mean lateral force at the entry mN",
        "mean push",
        "mean sum of lateral forces",
    )
    return table(head, rows, numbers=range(2, 6))


# ---- timings

_SPEEDS = (
    ("converged plant step", "step.{}.plant_ms", "step.{}.plant_in_limits"),
    ("whole I-FEM step: Jacobian, record and series included", "step.{}.ms", "step.{}.in_limits"),
    ("Jacobian alone", "step.{}.jacobian_ms", None),
    ("simulated time / wall time", "realtime.{}", None),
)


def bench_report() -> Path:
    """The newest committed measurement of speed."""
    return max((RESULTS / "bench").glob("*.json"))


def speed() -> str:
    """A step of the built-in scenarios, in milliseconds and in L0."""
    figures = _json(f"bench/{bench_report().name}")["figures"]

    def cell(name: str, scenario: str, limits: str | None) -> str:
        unit = figures[name.format(scenario)]["unit"]
        value = f"{figures[name.format(scenario)]['median']:.3g} {'' if unit == 'x' else unit}".strip()
        return value if limits is None else f"{value} = {figures[limits.format(scenario)]['median']:.3g} L0"

    rows = [
        (label, *(cell(name, scenario, limits) for scenario in ("line", "sine"))) for label, name, limits in _SPEEDS
    ]
    return table(("figure", "`line`", "`sine`"), rows, numbers=(1, 2))
