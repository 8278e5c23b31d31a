"""`needlebench paper`: the paper from data set to report, in a folder that survives every interruption."""

from __future__ import annotations

import csv
import io
import json
import sys
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from service.blas_threads import one_thread
from simcore.errors import Problem, ScenarioError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rich.progress import Progress

    from benchmarks.cases import Outcome
    from benchmarks.paper.pipeline import Findings
    from benchmarks.paper.plan import Plan, Stage, StepCost
    from benchmarks.paper.scale import Scale
    from service.local.paper_run import ProgressListener
    from service.worker.crew import Crew
    from simcore.rollout.dataset import Dataset

LINE_EVERY_S = 20.0  # of a progress that goes to no terminal
PACE_OVER_S = 120.0


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
    from benchmarks.paper.plan import Plan

    if fields:
        click.echo(read_scale(scale_name).model_dump_json(indent=1))
        return
    plan = Plan(read_scale(scale_name))
    from service.worker.crew import Crew

    if only_plan:
        with (
            tempfile.TemporaryDirectory(prefix="needlebench-") as scratch,
            Crew(workers, folder=Path(scratch), files=Path(scratch)) as crew,
        ):
            _print_plan(plan, workers, crew)
        return
    from service.local.paper_folder import open_folder
    from service.local.paper_run import PaperRun, check_needs, identity

    check_needs(plan, path, workers)
    with open_folder(path, identity(plan), any_commit=any_commit, extend=extend) as folder:
        with Crew(workers, folder=folder.series, files=path.absolute()) as crew:
            cost = _print_plan(plan, workers, crew)
            begun = time.monotonic()
            with _progress_on(plan, cost, workers) as listener:
                findings = PaperRun(plan, folder, crew, listener, trainer(plan)).run()
        write_report(findings, plan, path, wall_s=time.monotonic() - begun, workers=workers)
    click.echo(path / "report.html")


def read_scale(name: str) -> Scale:
    """A scale by name or from a JSON file. Raises ScenarioError."""
    from benchmarks.paper.scale import SCALES, scale_of

    if name in SCALES:
        return SCALES[name]
    if not Path(name).is_file():
        known = f"is neither a file nor one of {', '.join(SCALES)}"
        raise ScenarioError([Problem("--scale", name, known)])
    try:
        data = json.loads(Path(name).read_bytes())
    except (OSError, ValueError, RecursionError) as error:
        raise ScenarioError([Problem("--scale", name, f"is not readable JSON: {error}")]) from None
    return scale_of(data, field="--scale")


def trainer(plan: Plan) -> Callable[[str, int, Dataset], str]:
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


def write_report(findings: Findings, plan: Plan, path: Path, *, wall_s: float, workers: int) -> None:
    """report.html, report.json, insertions.csv, predictions.csv."""
    from benchmarks.paper import report
    from benchmarks.paper.pipeline import commits, cpu_seconds, paper_outcomes
    from service.local.paper_folder import write_text
    from simcore.provenance import provenance

    write_text(path / "predictions.csv", predictions_csv(findings))
    origin, own = provenance(findings.outcomes[0].case.scenario), paper_outcomes(findings)
    del origin["scenario"], origin["seed"]
    origin |= {
        "scale": plan.scale.model_dump(mode="json"),
        "plan_sha256": plan.sha256,
        "cases_sha256": findings.cases_sha256,
        "insertions": len(findings.outcomes) + len(findings.timing),
        "insertions_by_commit": commits(findings),
        "insertions_cpu_s": round(cpu_seconds((*findings.outcomes, *findings.timing)), 1),
        "of_the_paper_itself": {"insertions": len(own), "cpu_s": round(cpu_seconds(own), 1)},
        "last_call_wall_s": round(wall_s, 1),
        "workers": workers,
    }
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


def predictions_csv(findings: Findings) -> str:
    """A line for each trained ELM: what was varied, and its errors of Delta P in mm."""
    text = io.StringIO()
    table = list(findings.learning.rows())
    writer = csv.DictWriter(text, list(table[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(table)
    return text.getvalue()


# ---- what is shown


def _print_plan(plan: Plan, workers: int, crew: Crew) -> StepCost:
    """Measure what a step costs, print the plan; the cost."""
    from service.local.paper_run import measured_cost

    click.echo("measuring what a step costs (the first run on a machine compiles for half a minute)", err=True)
    cost = measured_cost(plan, crew)
    seconds = plan.seconds(cost, workers)
    steps_ms = f"{1e3 * cost.ifem_s:.1f} ms CPU a step with I-FEM, {1e3 * cost.plain_s:.1f} ms without"
    click.echo(f"scale {plan.scale.name}: {steps_ms}, {workers} workers")
    for stage in plan.stages:
        alone = ", one worker" if stage.alone else ""
        click.echo(f"  {stage.title:<12}{len(stage.cases):>6} insertions {_minutes(seconds[stage.title]):>9}{alone}")
    total = _minutes(sum(seconds.values()))
    click.echo(f"  {'all':<12}{plan.insertions:>6} insertions {total:>9} and about {plan.bytes / 1e6:.0f} MB")
    return cost


def _minutes(seconds: float) -> str:
    return f"{seconds / 60:.1f} min" if seconds >= 60 else f"{seconds:.0f} s"


@contextmanager
def _progress_on(plan: Plan, cost: StepCost, workers: int) -> Iterator[ProgressListener]:
    """A bar with the time left on a terminal, else lines."""
    share = {case.id: cost.of(case) / (1 if stage.alone else workers) for stage in plan.stages for case in stage.cases}
    if not sys.stderr.isatty():
        yield Lines(share)
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, speed_estimate_period=PACE_OVER_S) as progress:
        yield Bar(progress, share)


class Lines:
    """Progress that goes to a file or a pipe: a line now and then. share: estimated seconds of each case by id."""

    def __init__(self, share: dict[str, float]) -> None:
        self._share, self._total, self._done = share, sum(share.values()), 0.0
        self._stage, self._count, self._ended = "", 0, 0
        self._begun = self._spoken = time.monotonic()
        self._fresh = 0.0

    def begin(self, stage: Stage) -> None:
        """A line for the stage."""
        self._stage, self._count, self._ended = stage.title, len(stage.cases), 0
        click.echo(f"{stage.title}: {len(stage.cases)} insertions", err=True)

    def ended(self, outcome: Outcome, *, fresh: bool) -> None:
        """A line now and then."""
        self._ended += 1
        seconds, now = self._share.get(outcome.case.id, 0.0), time.monotonic()
        self._done += seconds
        self._fresh += seconds if fresh else 0.0
        if now - self._spoken < LINE_EVERY_S and self._ended < self._count:
            return
        self._spoken = now
        pace = (now - self._begun) / self._fresh if self._fresh else 1.0
        left = _minutes(pace * max(0.0, self._total - self._done))
        share = f"{100 * self._done / self._total:.0f} %, about {left} left"
        click.echo(f"{self._stage}: {self._ended} of {self._count}; {share}", err=True)

    def say(self, text: str) -> None:
        """The text."""
        click.echo(text, err=True)


class Bar:
    """Progress on a terminal, measured in estimated seconds, so that dear insertions count more."""

    def __init__(self, progress: Progress, share: dict[str, float]) -> None:
        self._progress, self._share = progress, share
        self._task = progress.add_task("starting", total=sum(share.values()))
        self._count, self._ended, self._title = 0, 0, ""

    def begin(self, stage: Stage) -> None:
        """Name the stage beside the bar."""
        self._title, self._count, self._ended = stage.title, len(stage.cases), 0
        self._progress.update(self._task, description=f"{stage.title} 0/{self._count}")

    def ended(self, outcome: Outcome, *, fresh: bool) -> None:  # noqa: ARG002  (a listener's signature)
        """Move the bar by the estimated seconds of the insertion."""
        self._ended += 1
        done = self._share.get(outcome.case.id, 0.0)
        self._progress.update(self._task, advance=done, description=f"{self._title} {self._ended}/{self._count}")

    def say(self, text: str) -> None:
        """The text, above the bar."""
        self._progress.console.print(text, highlight=False, markup=False)
