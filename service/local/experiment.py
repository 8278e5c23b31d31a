"""One experiment from plan to page: what it will cost, its stages in its folder, where its numbers come from."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import click

from benchmarks.cases import Suite
from benchmarks.learning.training import train_model
from benchmarks.paper.pipeline import commits, cpu_seconds
from service.local.paper_folder import open_folder
from service.local.paper_progress import minutes, progress_on
from service.local.paper_run import PaperRun, check_needs, identity, measured_cost, nearest_folder
from service.worker.network_trainer import train_network
from simcore import learning
from simcore.provenance import machine

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from benchmarks.cases import Outcome
    from benchmarks.paper.pipeline import PaperPorts
    from benchmarks.paper.plan import StagedPlan, StepCost
    from service.local.case_runner import Where
    from service.worker.crew import CaseRunner
    from simcore.rollout.dataset import Dataset

Result = TypeVar("Result")


class RunOptions(NamedTuple):
    """How an experiment is run. extend: None = it cannot be extended."""

    path: Path
    where: Where
    only_plan: bool
    any_commit: bool
    extend: bool | None = None


def carry_out(
    plan: StagedPlan,
    options: RunOptions,
    stages: Callable[[PaperPorts], Result],
    write: Callable[[Result, float], Path],
) -> None:
    """Run an experiment's stages in its folder, or go on with them, write its report and print where that is.

    write: result of the stages, wall time of this call in s -> path of the page.
    """
    path, where = options.path, options.where
    if options.only_plan:
        shared = None if where.cluster is None else nearest_folder(path)
        with (
            tempfile.TemporaryDirectory(prefix="needlebench-", dir=shared) as scratch,
            where.runner(folder=Path(scratch), files=Path(scratch)) as crew,
        ):
            _print_plan(plan, crew)
        return
    check_needs(plan, path, where.workers if where.cluster is None else 0)
    with open_folder(path, identity(plan), any_commit=options.any_commit, extend=options.extend) as folder:
        with where.runner(folder=folder.series, files=path.absolute()) as crew:
            cost = _print_plan(plan, crew)
            begun = time.monotonic()
            with progress_on(plan, cost, max(1, crew.slots), stored=folder.has_result) as listener:
                result = PaperRun(folder, crew, listener, trainer(plan)).run(stages)
        page = write(result, time.monotonic() - begun)
    click.echo(page)


def trainer(plan: StagedPlan) -> Callable[[str, int, Dataset], str]:
    """Trains a model of a kind, seed and data set; the text of its file."""

    def train(kind: str, seed: int, data: Dataset) -> str:
        makers: dict[str, Callable[[], learning.Regressor]] = {
            "elm": lambda: learning.ExtremeLearningMachine(nodes=plan.scale.nodes, seed=seed),
            "linear": learning.LinearModel,
            "neighbours": learning.NearestNeighbours,
            "mlp": lambda: learning.MultilayerPerceptron(seed=seed, trainer=train_network),
        }
        return train_model(data, makers[kind](), split="sample").model.text()

    return train


def origin_of(plan: StagedPlan, outcomes: Sequence[Outcome], *, wall_s: float, workers: int) -> dict[str, Any]:
    """Where the numbers of a report come from: machine and versions, plan, cases, commits, cost."""
    return machine() | {
        "scale": plan.scale.model_dump(mode="json"),
        "plan_sha256": plan.sha256,
        "cases_sha256": Suite(name="all", title="", cases=tuple(outcome.case for outcome in outcomes)).sha256,
        "insertions": len(outcomes),
        "insertions_by_commit": commits(outcomes),
        "insertions_cpu_s": round(cpu_seconds(outcomes), 1),
        "last_call_wall_s": round(wall_s, 1),
        "workers": workers,
    }


def _print_plan(plan: StagedPlan, crew: CaseRunner) -> StepCost:
    """Measure what a step costs, print the plan; the cost."""
    click.echo("measuring what a step costs (the first run on a machine compiles for about a minute)", err=True)
    cost = measured_cost(plan, crew)
    workers = max(1, crew.slots)
    seconds = plan.seconds(cost, workers)
    steps_ms = f"{1e3 * cost.ifem_s:.1f} ms CPU a step with I-FEM, {1e3 * cost.plain_s:.1f} ms without"
    click.echo(f"scale {plan.scale.name}: {steps_ms}, {workers} workers")
    for stage in plan.stages:
        alone = ", one worker" if stage.alone else ""
        click.echo(f"  {stage.title:<17}{len(stage.cases):>6} insertions {minutes(seconds[stage.title]):>9}{alone}")
    total = minutes(sum(seconds.values()))
    click.echo(f"  {'all':<17}{plan.insertions:>6} insertions {total:>9} and about {plan.bytes / 1e6:.0f} MB")
    return cost
