"""Studies besides the experiments: ELMs that differ in their random weights, learning curves, sensitivity."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from benchmarks.paper import statistics
from benchmarks.paper.analysis import PRIMARY, under
from benchmarks.paper.comparison import compare, pair_rows
from benchmarks.paper.table import Row, groups, main_rows, only

if TYPE_CHECKING:
    from collections.abc import Sequence

# ---- seeds


@dataclass(frozen=True)
class SeedScore:
    """One ELM against I-FEM on the same paths; difference = ELM - I-FEM, mm."""

    model_seed: str
    group: str
    insertions: int
    failed: int
    median_mm: float
    difference_mm: float


def seed_scores(table: Sequence[Row]) -> list[SeedScore]:
    """Every ELM seed in every group."""
    seeded = [row for row in table if "model_seed" in row.labels and row.arm == "elm"]
    reference = only(under(main_rows(table), PRIMARY), arm="ifem")
    reference += [row for row in table if "model_seed" in row.labels and row.arm == "ifem"]
    scores = []
    for seed in sorted({row.labels["model_seed"] for row in seeded}, key=lambda seed: (str(type(seed)), seed)):
        mine = [row for row in seeded if row.labels["model_seed"] == seed]
        for group in groups(mine):
            own = only(mine, group=group)
            matched = pair_rows(own, only(reference, group=group))
            change = statistics.differences(matched.first, matched.second)
            medians = statistics.cluster_medians(change, matched.clusters)
            errors = [row.rmse_commanded_mm for row in own]
            failed = sum(row.failed for row in own)
            scores.append(
                SeedScore(str(seed), group, len(own), failed, statistics.middle(errors), statistics.middle(medians))
            )
    return scores


@dataclass(frozen=True)
class SeedShare:
    """In how many ELM seeds the ELM is the more precise, and in how many I-FEM is, along `paths` paths each.

    references: median RMSE of I-FEM, open loop and rigid needle along the same paths, mm, of those that ran there.
    """

    group: str
    seeds: int
    paths: int
    insertions: int
    failed: int
    elm_better: int
    ifem_better: int
    low_mm: float
    median_mm: float
    high_mm: float
    references: dict[str, float]


def seed_shares(scores: Sequence[SeedScore], table: Sequence[Row] = ()) -> list[SeedShare]:
    """One row a group; seeds without a comparison are left out. table: all insertions, for the references."""
    shares = []
    for group in dict.fromkeys(score.group for score in scores):
        known = [score for score in scores if score.group == group and not math.isnan(score.difference_mm)]
        if known:
            medians = [score.median_mm for score in known]
            elm, ifem = (sum(sign * score.difference_mm < 0 for score in known) for sign in (1, -1))
            shares.append(
                SeedShare(
                    *(group, len(known), max(score.insertions for score in known)),
                    insertions=sum(score.insertions for score in known),
                    failed=sum(score.failed for score in known),
                    elm_better=elm,
                    ifem_better=ifem,
                    low_mm=min(medians),
                    median_mm=statistics.middle(medians),
                    high_mm=max(medians),
                    references=_along_seed_paths(table, group),
                )
            )
    return shares


def _along_seed_paths(table: Sequence[Row], group: str) -> dict[str, float]:
    paths = {row.pair for row in table if "model_seed" in row.labels and row.group == group}
    there = [row for row in under(main_rows(table), PRIMARY) if row.pair in paths]
    known = {arm: only(there, arm=arm) for arm in ("ifem", "open_loop", "rigid")}
    return {arm: statistics.middle([row.rmse_commanded_mm for row in mine]) for arm, mine in known.items() if mine}


# ---- learning


@dataclass(frozen=True)
class LearningPoint:
    """One trained ELM. curve: what is varied, "nodes" or "samples", and `value` how many. measure: what the error is
    of, in words (a split of the samples, or a closed loop); error_mm: its RMSE."""

    curve: str
    value: int
    seed: int
    measure: str
    error_mm: float


@dataclass(frozen=True)
class LearningStep:
    """The seeds of one value of a curve together."""

    curve: str
    measure: str
    value: int
    seeds: int
    median_mm: float
    low_mm: float
    high_mm: float


def learning_steps(points: Sequence[LearningPoint]) -> list[LearningStep]:
    """Median and range over the seeds, by curve, measure and value."""
    errors_by_step: dict[tuple[str, str, int], list[float]] = {}
    for point in points:
        errors_by_step.setdefault((point.curve, point.measure, point.value), []).append(point.error_mm)
    return [
        LearningStep(*key, len(errors), statistics.middle(errors), min(errors), max(errors))
        for key, errors in sorted(errors_by_step.items())
    ]


# ---- sensitivity


@dataclass(frozen=True)
class Variant:
    """One parameter at one value, in one group, along `paths` paths. Medians in mm.

    difference_mm: ELM - I-FEM, nan where both failed. better: the more precise of the two, empty if neither is. ran:
    controllers that have a figure, be it a failure. nominal: those whose figures are of the nominal run, because the
    parameter is not theirs.
    """

    parameter: str
    value: str
    group: str
    paths: int
    insertions: int
    failed: int
    ifem_mm: float
    elm_mm: float
    open_loop_mm: float
    difference_mm: float
    p: float
    better: str
    ran: tuple[str, ...]
    nominal: tuple[str, ...]


NOMINAL = "nominal"


def variants(table: Sequence[Row]) -> list[Variant]:
    """A row for each parameter, value and group, in the order of the parameters' first mention; nominal first."""
    varied = [row for row in table if "parameter" in row.labels]
    rows = []
    keys = dict.fromkeys((str(row.labels["parameter"]), str(row.labels.get("value", ""))) for row in varied)
    for parameter, value in sorted(keys, key=lambda key: (key[0] != NOMINAL, *key)):
        mine = [row for row in varied if _setting(row) == (parameter, value)]
        for group in groups(mine):
            nominal = [row for row in varied if row.labels["parameter"] == NOMINAL and row.group == group]
            rows.append(_variant(parameter, value, group, only(mine, group=group), nominal))
    return rows


def _setting(row: Row) -> tuple[str, str]:
    return str(row.labels["parameter"]), str(row.labels.get("value", ""))


def _variant(parameter: str, value: str, group: str, mine: list[Row], nominal: list[Row]) -> Variant:
    members: dict[str, list[Row]] = {}
    borrowed = []
    for arm in ("ifem", "elm", "open_loop"):
        members[arm] = only(mine, arm=arm)
        if not members[arm] and (standing := only(nominal, arm=arm)):
            members[arm] = standing
            borrowed.append(arm)
    compared = compare(members["elm"], members["ifem"], group=group, names=("elm", "ifem"))
    difference = compared.difference_mm if compared else math.nan
    ifem, elm, open_loop = (statistics.middle([row.rmse_commanded_mm for row in rows]) for rows in members.values())
    if math.isinf(ifem) and math.isinf(elm):
        difference = math.nan
    return Variant(
        parameter=parameter,
        value=value,
        group=group,
        paths=len({row.pair for row in mine}),
        insertions=len(mine),
        failed=sum(row.failed for row in mine),
        ifem_mm=ifem,
        elm_mm=elm,
        open_loop_mm=open_loop,
        difference_mm=difference,
        p=compared.p_primary if compared else math.nan,
        better="elm" if difference < 0.0 else "ifem" if difference > 0.0 else "",
        ran=tuple(arm for arm, rows in members.items() if rows),
        nominal=tuple(borrowed),
    )
