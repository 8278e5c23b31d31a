"""The paper from data set to report: what is run, in which order, and what follows from what.

It neither runs nor stores anything itself: `PaperPorts` provides whatever runs, stores, trains or records.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from benchmarks.cases import Case, Label, Outcome
from benchmarks.learning.training_insertions import Insertion, collect_dataset
from benchmarks.paper.learning import LearningCurves, learning_curves
from benchmarks.paper.plan import Plan, Stage, StagedPlan, elm_names, model_names
from benchmarks.paper.retraining import LABEL, training_conditions
from benchmarks.paper.suites import resolve_cases
from benchmarks.paper.table import TRAINING
from simcore.errors import NeedlebenchError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from simcore.rollout.dataset import Dataset, Table

DATA_SEED = 0
DATASET = "dataset.npz"
RECORDED_ARMS, RECORDED_GROUPS = ("ifem", "elm"), ("LIN", "CUR")


class EmptyDatasetError(NeedlebenchError):
    """The insertions of the data set all failed at once."""


class PaperPorts(Protocol):
    """What the stages need and must not know: processes, a folder, training, a recorder."""

    def run_many(self, cases: Sequence[Case]) -> Iterable[Outcome]:
        """Run the cases on all workers; outcomes in any order."""

    def run_alone(self, cases: Sequence[Case]) -> Iterable[Outcome]:
        """Run one case after the other, for their times."""

    def begin(self, stage: Stage) -> None:
        """Hear of a stage and its cases before they run."""

    def table(self, case: Case) -> Table:
        """Table I of a finished training insertion."""

    def keep(self, name: str, data: Dataset) -> None:
        """Store a data set under a name."""

    def train(self, kind: str, seed: int, data: Dataset) -> str:
        """Content of a model file."""

    def store(self, name: str, text: str) -> None:
        """Keep a text under a name in the run's folder, where scenarios then find it."""

    def stored(self, name: str) -> bool:
        """Whether there is something under this name."""

    def record(self, outcomes: Sequence[Outcome]) -> dict[str, str]:
        """Record each of these outcomes again; id -> file name."""


@dataclass(frozen=True)
class Findings:
    """All that a report is made of."""

    outcomes: tuple[Outcome, ...]
    timing: tuple[Outcome, ...]
    learning: LearningCurves
    recordings: dict[str, str]


def rerun(plan: Plan, ports: PaperPorts) -> Findings:
    """Run every stage of the plan."""
    training, *stages = plan.stages
    first = run_stage(training, ports, training.cases)
    data = gather_dataset(plan, first, ports.table)
    ports.keep(DATASET, data)
    for name, kind, seed in model_files(plan):
        if not ports.stored(name):
            ports.store(name, ports.train(kind, seed, data))
    outcomes, timing = list(first), list[Outcome]()
    for stage in stages:
        stage_outcomes = run_stage(stage, ports, stage.cases if stage.trains else resolve_cases(stage.cases))
        if stage.trains:
            _train_others(plan, stage_outcomes, ports)
        (timing if stage.alone else outcomes).extend(stage_outcomes)
    curves = learning_curves(
        data,
        nodes=plan.scale.nodes,
        node_counts=plan.scale.curve_nodes,
        sample_counts=plan.scale.curve_samples,
        seeds=plan.scale.seeds,
    )
    recordings = ports.record(cases_to_record(outcomes, failed=plan.scale.recordings))
    return Findings(tuple(outcomes), tuple(timing), curves, recordings)


def _train_others(plan: Plan, outcomes: Sequence[Outcome], ports: PaperPorts) -> None:
    """An ELM for each condition of the training study, from its own insertions."""
    for condition in training_conditions(plan.scale.dt_s):
        if not ports.stored(condition.model):
            mine = [outcome for outcome in outcomes if outcome.case.labels[LABEL] == condition.name]
            ports.store(condition.model, ports.train("elm", 0, gather_dataset(plan, mine, ports.table)))


def run_stage(stage: Stage, ports: PaperPorts, cases: Sequence[Case]) -> list[Outcome]:
    """The outcomes in the order of the cases, whichever ended first."""
    ports.begin(stage)
    run = ports.run_alone if stage.alone else ports.run_many
    outcomes = {outcome.case.id: outcome for outcome in run(cases)}
    return [outcomes[case.id] for case in cases]


def gather_dataset(plan: StagedPlan, outcomes: Sequence[Outcome], table: Callable[[Case], Table]) -> Dataset:
    """The data set of finished insertions; those that ended without a step are left out. Raises EmptyDatasetError."""
    useful = [outcome for outcome in outcomes if outcome.result["metrics"]["steps_completed"]]
    if not useful:
        raise EmptyDatasetError(
            f"none of {len(outcomes)} training insertions made a step: {outcomes[0].result['message']}"
        )

    def done(_: Sequence[Case]) -> Iterable[Insertion]:
        for outcome in useful:
            result = outcome.result
            yield Insertion(outcome.case, table(outcome.case), result["status"], result["digest"])

    cases = [outcome.case for outcome in useful]
    return collect_dataset(cases, done, samples=plan.scale.samples, seed=DATA_SEED)


def model_files(plan: Plan) -> list[tuple[str, str, int]]:
    """(file, kind, seed) of every model that the stages name."""
    files = [(name, "elm", seed) for seed, name in enumerate(elm_names(plan.scale))]
    if plan.scale.baselines:
        files += [(name, kind, 0) for kind, name in model_names().items() if kind != "elm"]
    return files


def cases_to_record(outcomes: Sequence[Outcome], *, failed: int) -> list[Outcome]:
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
    error = float(outcome.result["metrics"]["rmse_commanded_mm"])
    return error if math.isfinite(error) else math.inf


def cpu_seconds(outcomes: Iterable[Outcome]) -> float:
    """CPU time of all insertions that tell theirs."""
    each: list[Any] = [outcome.result.get("cost", {}).get("cpu_s") for outcome in outcomes]
    return float(np.sum([seconds for seconds in each if seconds is not None]))


def paper_outcomes(findings: Findings) -> list[Outcome]:
    """The paper's own insertions: data set, I-FEM and ELM along LIN and CUR, the ELM at variable Young's modulus."""

    def own(labels: Mapping[str, Label]) -> bool:
        if labels["group"] == TRAINING:
            return LABEL not in labels
        held = labels.get("purpose") == "main" and labels["noise"] == "off"
        return held and (labels["arm"], labels["young"]) in {
            ("ifem", "constant"),
            ("elm", "constant"),
            ("elm", "variable"),
        }

    return [outcome for outcome in findings.outcomes if own(outcome.case.labels)]


def commits(outcomes: Iterable[Outcome]) -> dict[str, int]:
    """How many insertions were run at each commit: a report may be written by later code than they were run by."""
    each = (outcome.result["provenance"].get("commit", "unknown") for outcome in outcomes)
    return dict(Counter(each))
