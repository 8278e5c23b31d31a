"""The paper from data set to report: what is run, in which order, and what follows from what.

Pure in the sense of the suites: it is handed everything that runs, stores, trains or records.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.cases import Case, Label, Outcome, RunMany, Suite
from benchmarks.learning import training_insertions as dataset
from benchmarks.learning.training_insertions import Insertion
from benchmarks.paper.learning import LearningCurves, learning_curves
from benchmarks.paper.plan import Plan, Stage, elm_names, model_names
from benchmarks.paper.suites import resolved
from benchmarks.paper.table import TRAINING
from simcore.errors import NeedlebenchError
from simcore.rollout.dataset import Dataset, Table

DATA_SEED = 0
RECORDED_ARMS, RECORDED_GROUPS = ("ifem", "elm"), ("LIN", "CUR")


class NothingToLearn(NeedlebenchError):
    """The insertions of the data set all failed at once."""


@dataclass(frozen=True)
class Hands:
    """What the stages are handed.

    run_many, run_alone: on all workers, and one after the other. begin: is told each stage and its cases before they
    run. table: table I of a finished training insertion. keep: stores the data set. train: (kind, seed, data) ->
    content of a model file. store: keeps a text under a name in the run's folder, where scenarios then find it;
    stored: whether it is there. record: a recording of each of these outcomes, id -> file name.
    """

    run_many: RunMany
    run_alone: RunMany
    begin: Callable[[Stage], None]
    table: Callable[[Case], Table]
    keep: Callable[[Dataset], None]
    train: Callable[[str, int, Dataset], str]
    store: Callable[[str, str], None]
    stored: Callable[[str], bool]
    record: Callable[[Sequence[Outcome]], dict[str, str]]


@dataclass(frozen=True)
class Findings:
    """All that a report is made of."""

    outcomes: tuple[Outcome, ...]
    timing: tuple[Outcome, ...]
    learning: LearningCurves
    recordings: dict[str, str]

    @property
    def cases_sha256(self) -> str:
        """Digest of all cases as they were run, digests of trained models included."""
        cases = tuple(outcome.case for outcome in (*self.outcomes, *self.timing))
        return Suite(name="all", title="", cases=cases).sha256


def rerun(plan: Plan, hands: Hands) -> Findings:
    """Run every stage of the plan."""
    training, *stages = plan.stages
    first = _ran(training, hands, training.cases)
    data = gathered(plan, first, hands.table)
    hands.keep(data)
    for name, kind, seed in models_of(plan):
        if not hands.stored(name):
            hands.store(name, hands.train(kind, seed, data))
    outcomes, timing = list(first), list[Outcome]()
    for stage in stages:
        found = _ran(stage, hands, resolved(stage.cases))
        (timing if stage.alone else outcomes).extend(found)
    curves = learning_curves(
        data,
        nodes=plan.scale.nodes,
        node_counts=plan.scale.curve_nodes,
        sample_counts=plan.scale.curve_samples,
        seeds=plan.scale.seeds,
    )
    recordings = hands.record(worth_recording(outcomes, failed=plan.scale.recordings))
    return Findings(tuple(outcomes), tuple(timing), curves, recordings)


def _ran(stage: Stage, hands: Hands, cases: Sequence[Case]) -> list[Outcome]:
    """The outcomes in the order of the cases, whichever ended first."""
    hands.begin(stage)
    run = hands.run_alone if stage.alone else hands.run_many
    found = {outcome.case.id: outcome for outcome in run(cases)}
    return [found[case.id] for case in cases]


def gathered(plan: Plan, outcomes: Sequence[Outcome], table: Callable[[Case], Table]) -> Dataset:
    """The data set of finished insertions; those that ended without a step are left out. Raises NothingToLearn."""
    useful = [outcome for outcome in outcomes if outcome.result["metrics"]["steps_completed"]]
    if not useful:
        raise NothingToLearn(
            f"none of {len(outcomes)} training insertions made a step: {outcomes[0].result['message']}"
        )

    def done(_: Sequence[Case]) -> Iterable[Insertion]:
        for outcome in useful:
            result = outcome.result
            yield Insertion(outcome.case, table(outcome.case), result["status"], result["digest"])

    cases = [outcome.case for outcome in useful]
    return dataset.dataset(cases, done, samples=plan.scale.samples, seed=DATA_SEED)


def models_of(plan: Plan) -> list[tuple[str, str, int]]:
    """(file, kind, seed) of every model that the stages name."""
    found = [(name, "elm", seed) for seed, name in enumerate(elm_names(plan.scale))]
    if plan.scale.baselines:
        found += [(name, kind, 0) for kind, name in model_names().items() if kind != "elm"]
    return found


def worth_recording(outcomes: Sequence[Outcome], *, failed: int) -> list[Outcome]:
    """The best, median and worst test case of each controller along LIN and CUR, then the first that failed or lost
    their target: those that failed before the others, and those of these controllers before the baselines'."""
    main = [outcome for outcome in outcomes if outcome.case.labels.get("purpose") == "main"]
    chosen: dict[str, Outcome] = {}
    for group in RECORDED_GROUPS:
        for arm in RECORDED_ARMS:
            wanted = {"group": group, "arm": arm, "young": "constant", "noise": "off"}
            there = [o for o in main if all(o.case.labels[key] == value for key, value in wanted.items())]
            ranked = sorted((o for o in there if o.result["metrics"]["stable"]), key=_rmse_mm)
            if ranked:
                chosen |= {o.case.id: o for o in (ranked[0], ranked[len(ranked) // 2], ranked[-1])}
    lost = [o for o in main if not o.result["metrics"]["success"] and o.result["digest"]]
    lost.sort(key=lambda o: (o.result["metrics"]["stable"], o.case.labels["arm"] not in RECORDED_ARMS))
    chosen |= {o.case.id: o for o in lost[:failed]}
    return list(chosen.values())


def _rmse_mm(outcome: Outcome) -> float:
    return float(outcome.result["metrics"]["rmse_mm"])


def cpu_seconds(outcomes: Iterable[Outcome]) -> float:
    """CPU time of all insertions that tell theirs."""
    each: list[Any] = [outcome.result.get("cost", {}).get("cpu_s") for outcome in outcomes]
    return float(np.sum([seconds for seconds in each if seconds is not None]))


def of_the_paper(findings: Findings) -> list[Outcome]:
    """The paper's own insertions: data set, I-FEM and ELM along LIN and CUR, the ELM at variable Young's modulus."""

    def own(labels: Mapping[str, Label]) -> bool:
        if labels["group"] == TRAINING:
            return True
        held = labels.get("purpose") == "main" and labels["noise"] == "off"
        return held and (labels["arm"], labels["young"]) in {
            ("ifem", "constant"),
            ("elm", "constant"),
            ("elm", "variable"),
        }

    return [outcome for outcome in findings.outcomes if own(outcome.case.labels)]


def commits(findings: Findings) -> dict[str, int]:
    """How many insertions were run at each commit: a report may be written by later code than they were run by."""
    each = (o.result["provenance"].get("commit", "unknown") for o in (*findings.outcomes, *findings.timing))
    return dict(Counter(each))
