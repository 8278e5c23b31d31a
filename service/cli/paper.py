"""`needlebench paper`: the paper from data set to report, in a folder that survives every interruption."""

from __future__ import annotations

import csv
import io
import json
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import click

from service.blas_threads import one_thread
from simcore.errors import Problem, ScenarioError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from benchmarks.cases import Outcome
    from benchmarks.paper.pipeline import Findings, PaperPorts
    from benchmarks.paper.plan import Plan, StagedPlan, StepCost
    from benchmarks.paper.scale import AnyScale
    from service.worker.crew import Crew
    from simcore.rollout.dataset import Dataset

Result = TypeVar("Result")


class RunOptions(NamedTuple):
    """How an experiment is run. extend: None = it cannot be extended."""

    path: Path
    workers: int
    only_plan: bool
    any_commit: bool
    extend: bool | None = None


@click.command()
@click.option(
    "--scale",
    "scale_name",
    metavar="NAME",
    default="smoke",
    show_default=True,
    help="smoke, quick, full, extended, or a JSON file with the fields of a scale (see --fields).",
)
@click.option(
    "--out",
    "path",
    metavar="DIR",
    default=Path("out/paper"),
    show_default=True,
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder of this run; the same command goes on where it was interrupted.",
)
@click.option(
    "--workers",
    type=click.IntRange(1, 64),
    default=2,
    show_default=True,
    help="Processes, one thread each; times are measured with one.",
)
@click.option("--plan", "only_plan", is_flag=True, help="Say what would be run, how long it takes, and end.")
@click.option("--any-commit", is_flag=True, help="Go on with a folder that another commit began.")
@click.option(
    "--extend",
    is_flag=True,
    help="Make the run in the folder one of this scale, if mesh, time step, data set and models are the same.",
)
@click.option("--fields", is_flag=True, help="Print the scale as JSON, with every field, and end.")
def paper(
    scale_name: str, path: Path, workers: int, only_plan: bool, any_commit: bool, extend: bool, fields: bool
) -> None:
    """Rerun the paper: data set, ELM, test insertions, timing, statistics, report.

    Each finished insertion is stored at once. Interrupted by Ctrl-C, a kill or a power cut, the same command goes on
    and runs nothing twice. A folder of another scale or commit is refused, and nothing in it is changed.

    \b
    Does it work here, minutes:       needlebench paper --scale smoke --out out/smoke
    A first look, coarse:             needlebench paper --scale quick --out out/quick
    The paper, about an hour:         needlebench paper --scale full --out out/paper
    What would that be:               needlebench paper --scale full --plan
    More of it, keeping what is done: needlebench paper --scale extended --out out/paper --extend
    A scale of one's own:             needlebench paper --scale full --fields > mine.json
                                      needlebench paper --scale mine.json

    \b
    In DIR: report.html, report.json, insertions.csv (one line an insertion), predictions.csv (the ELMs' errors),
    results/ID.json, series/ID.npz, dataset.npz, models/, recordings/ID.rrd (best, median, worst and failed cases, run
    again). Scenarios name models as models/NAME.json, relative to DIR. A case that crashed stays crashed: remove its
    result to have it run again.

    \b
    Exit code: 0 done   2 bad scale or folder, too little space   1 crash   130 Ctrl-C
    """
    one_thread()
    from benchmarks.paper.pipeline import rerun
    from benchmarks.paper.plan import Plan
    from benchmarks.paper.scale import SCALES

    scale = read_scale(scale_name, SCALES)
    if fields:
        click.echo(scale.model_dump_json(indent=1))
        return
    plan = Plan(scale)
    carry_out(
        plan,
        RunOptions(path, workers, only_plan, any_commit, extend),
        lambda ports: rerun(plan, ports),
        lambda findings, wall_s: write_report(findings, plan, path, wall_s=wall_s, workers=workers),
    )


def carry_out(
    plan: StagedPlan,
    options: RunOptions,
    stages: Callable[[PaperPorts], Result],
    write: Callable[[Result, float], Path],
) -> None:
    """Run an experiment's stages in its folder, or go on with them, write its report and print where that is.

    write: result of the stages, wall time of this call in s -> path of the page.
    """
    from service.worker.crew import Crew

    path, workers = options.path, options.workers
    if options.only_plan:
        with (
            tempfile.TemporaryDirectory(prefix="needlebench-") as scratch,
            Crew(workers, folder=Path(scratch), files=Path(scratch)) as crew,
        ):
            _print_plan(plan, workers, crew)
        return
    from service.local.paper_folder import open_folder
    from service.local.paper_progress import progress_on
    from service.local.paper_run import PaperRun, check_needs, identity

    check_needs(plan, path, workers)
    with open_folder(path, identity(plan), any_commit=options.any_commit, extend=options.extend) as folder:
        with Crew(workers, folder=folder.series, files=path.absolute()) as crew:
            cost = _print_plan(plan, workers, crew)
            begun = time.monotonic()
            with progress_on(plan, cost, workers) as listener:
                result = PaperRun(folder, crew, listener, trainer(plan)).run(stages)
        page = write(result, time.monotonic() - begun)
    click.echo(page)


def read_scale(name: str, scales: Mapping[str, AnyScale]) -> AnyScale:
    """A scale by name or from a JSON file. Raises ScenarioError."""
    from benchmarks.paper.scale import scale_of

    if name in scales:
        return scales[name]
    if not Path(name).is_file():
        known = f"is neither a file nor one of {', '.join(scales)}"
        raise ScenarioError([Problem("--scale", name, known)])
    try:
        data = json.loads(Path(name).read_bytes())
    except (OSError, ValueError, RecursionError) as error:
        raise ScenarioError([Problem("--scale", name, f"is not readable JSON: {error}")]) from None
    kind = type(next(iter(scales.values())))
    return scale_of(data, kind, field="--scale")


def trainer(plan: StagedPlan) -> Callable[[str, int, Dataset], str]:
    """Trains a model of a kind, seed and data set; the text of its file."""
    from benchmarks.learning.training import train_model
    from service.worker.network_trainer import train_network
    from simcore import learning

    def train(kind: str, seed: int, data: Dataset) -> str:
        makers: dict[str, Callable[[], learning.Regressor]] = {
            "elm": lambda: learning.ExtremeLearningMachine(nodes=plan.scale.nodes, seed=seed),
            "linear": learning.LinearModel,
            "neighbours": learning.NearestNeighbours,
            "mlp": lambda: learning.MultilayerPerceptron(seed=seed, trainer=train_network),
        }
        return train_model(data, makers[kind](), split="sample").model.text()

    return train


# ---- what is written at the end


def write_report(findings: Findings, plan: Plan, path: Path, *, wall_s: float, workers: int) -> Path:
    """report.html, report.json, insertions.csv, predictions.csv; the path of the first."""
    from benchmarks.paper import report
    from benchmarks.paper.pipeline import cpu_seconds, paper_outcomes
    from service.local.paper_folder import write_text

    write_text(path / "predictions.csv", predictions_csv(findings))
    own = paper_outcomes(findings)
    origin = origin_of(plan, (*findings.outcomes, *findings.timing), wall_s=wall_s, workers=workers)
    origin["of_the_paper_itself"] = {"insertions": len(own), "cpu_s": round(cpu_seconds(own), 1)}
    report.write(
        findings.outcomes,
        timing=findings.timing,
        learning=findings.learning.for_report(),
        recordings=findings.recordings,
        scale=plan.scale.name,
        out=path,
        provenance=origin,
        band_mm=plan.scale.band_mm,
    )
    return path / report.HTML


def origin_of(plan: StagedPlan, outcomes: Sequence[Outcome], *, wall_s: float, workers: int) -> dict[str, Any]:
    """Where the numbers of a report come from: machine and versions, plan, cases, commits, cost."""
    from benchmarks.cases import Suite
    from benchmarks.paper.pipeline import commits, cpu_seconds
    from simcore.provenance import provenance

    origin = provenance(outcomes[0].case.scenario)
    del origin["scenario"], origin["seed"]
    return origin | {
        "scale": plan.scale.model_dump(mode="json"),
        "plan_sha256": plan.sha256,
        "cases_sha256": Suite(name="all", title="", cases=tuple(outcome.case for outcome in outcomes)).sha256,
        "insertions": len(outcomes),
        "insertions_by_commit": commits(outcomes),
        "insertions_cpu_s": round(cpu_seconds(outcomes), 1),
        "last_call_wall_s": round(wall_s, 1),
        "workers": workers,
    }


def predictions_csv(findings: Findings) -> str:
    """A line for each trained ELM: what was varied, and its errors of Delta P in mm."""
    text = io.StringIO()
    table = list(findings.learning.rows())
    writer = csv.DictWriter(text, list(table[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(table)
    return text.getvalue()


# ---- what is shown


def _print_plan(plan: StagedPlan, workers: int, crew: Crew) -> StepCost:
    """Measure what a step costs, print the plan; the cost."""
    from service.local.paper_progress import minutes
    from service.local.paper_run import measured_cost

    click.echo("measuring what a step costs (the first run on a machine compiles for half a minute)", err=True)
    cost = measured_cost(plan, crew)
    seconds = plan.seconds(cost, workers)
    steps_ms = f"{1e3 * cost.ifem_s:.1f} ms CPU a step with I-FEM, {1e3 * cost.plain_s:.1f} ms without"
    click.echo(f"scale {plan.scale.name}: {steps_ms}, {workers} workers")
    for stage in plan.stages:
        alone = ", one worker" if stage.alone else ""
        click.echo(f"  {stage.title:<12}{len(stage.cases):>6} insertions {minutes(seconds[stage.title]):>9}{alone}")
    total = minutes(sum(seconds.values()))
    click.echo(f"  {'all':<12}{plan.insertions:>6} insertions {total:>9} and about {plan.bytes / 1e6:.0f} MB")
    return cost
