"""`needlebench paper` and `needlebench settle`: experiments in folders that survive every interruption."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from service.blas_threads import one_thread
from service.cli.cluster.options import cluster_address, cluster_options
from simcore.errors import Problem, ScenarioError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from benchmarks.paper.pipeline import Findings
    from benchmarks.paper.plan import Plan
    from benchmarks.paper.scale import AnyScale
    from service.local.experiment import RunOptions


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
@cluster_options
@click.option("--plan", "only_plan", is_flag=True, help="Say what would be run, how long it takes, and end.")
@click.option("--any-commit", is_flag=True, help="Go on with a folder that another commit began.")
@click.option(
    "--extend",
    is_flag=True,
    help="Make the run in the folder one of this scale, if mesh, time step, data set and models are the same.",
)
@click.option("--fields", is_flag=True, help="Print the scale as JSON, with every field, and end.")
def paper(scale_name: str, path: Path, workers: int, extend: bool, fields: bool, **options: Any) -> None:
    """Rerun the paper: data set, ELM, test insertions, timing, statistics, report.

    Each finished insertion is stored at once. Interrupted by Ctrl-C, a kill or a power cut, the same command goes on
    and runs nothing twice. A folder of another scale or commit is refused, and nothing in it is changed.

    \b
    Does it work here, minutes:       needlebench paper --scale smoke --out out/smoke
    A first look, coarse:             needlebench paper --scale quick --out out/quick
    The paper, about an hour:         needlebench paper --scale full --out out/paper
    What would that be:               needlebench paper --scale full --plan
    On a cluster:                     needlebench paper --scale full --cluster file:cluster/scheduler.json
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
    from service.local.experiment import carry_out

    scale = read_scale(scale_name, SCALES)
    if fields:
        click.echo(scale.model_dump_json(indent=1))
        return
    plan = Plan(scale)
    carry_out(
        plan,
        _run_options(path, workers, extend, **options),
        lambda ports: rerun(plan, ports),
        lambda findings, wall_s: write_report(findings, plan, path, wall_s=wall_s, workers=workers),
    )


@click.command()
@click.option(
    "--scale",
    "scale_name",
    metavar="NAME",
    default="smoke",
    show_default=True,
    help="smoke, full, or a JSON file with the fields of a scale (see --fields).",
)
@click.option(
    "--out",
    "path",
    metavar="DIR",
    default=Path("out/settling"),
    show_default=True,
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder of this run; the same command goes on where it was interrupted.",
)
@click.option("--workers", type=click.IntRange(1, 64), default=2, show_default=True, help="Processes, one thread each.")
@cluster_options
@click.option("--plan", "only_plan", is_flag=True, help="Say what would be run, how long it takes, and end.")
@click.option("--any-commit", is_flag=True, help="Go on with a folder that another commit began.")
@click.option("--fields", is_flag=True, help="Print the scale as JSON, with every field, and end.")
def settle(scale_name: str, path: Path, workers: int, fields: bool, **options: Any) -> None:
    """Run the experiment that settles the claim on curved paths: 20 cells along 80 paths.

    I-FEM and ELM on two plants, with and without delay, and I-FEM with the remote centre weighted in three ways or
    replaced by its axis; an ELM is trained on each plant first. Plan, margins and tests are fixed in the code, and
    there is no way to add paths to a run that has begun. It goes on where it was interrupted, like `needlebench paper`.

    \b
    Does it work here, minutes:   needlebench settle --scale smoke --out out/smoke
    The experiment, hours:        needlebench settle --scale full --out out/settling
    What would that be:           needlebench settle --scale full --plan
    With models of one's own:     needlebench settle --scale full --fields > mine.json
                                  needlebench settle --scale mine.json

    \b
    In DIR: settling.html, settling.md, settling.json, cases.csv (one line an insertion), pareto.svg, results/ID.json,
    series/ID.npz, dataset-PLANT.npz, models/elm-PLANT.json.

    \b
    Exit code: 0 done   2 bad scale or folder, too little space   1 crash   130 Ctrl-C
    """
    one_thread()
    from benchmarks.settling.pipeline import settle as run_stages
    from benchmarks.settling.plan import SettlingPlan
    from benchmarks.settling.report import write
    from benchmarks.settling.scale import SCALES
    from service.local.experiment import carry_out, origin_of

    scale = read_scale(scale_name, SCALES)
    if fields:
        click.echo(scale.model_dump_json(indent=1))
        return
    plan = SettlingPlan(scale)
    carry_out(
        plan,
        _run_options(path, workers, None, **options),
        lambda ports: run_stages(plan, ports),
        lambda outcomes, wall_s: write(
            outcomes, scale, path, origin_of(plan, outcomes, wall_s=wall_s, workers=workers)
        ),
    )


def _run_options(
    path: Path,
    workers: int,
    extend: bool | None,
    *,
    only_plan: bool,
    any_commit: bool,
    cluster_text: str | None,
    **security: Any,
) -> RunOptions:
    from service.local.case_runner import Where
    from service.local.experiment import RunOptions

    where = Where(workers, cluster_address(cluster_text, **security))
    return RunOptions(path, where, only_plan, any_commit, extend)


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


# ---- what is written at the end


def write_report(findings: Findings, plan: Plan, path: Path, *, wall_s: float, workers: int) -> Path:
    """report.html, report.json, insertions.csv, predictions.csv; the path of the first."""
    from benchmarks.paper import report
    from benchmarks.paper.bands import bands_of
    from benchmarks.paper.pipeline import cpu_seconds, paper_outcomes
    from service.local.experiment import origin_of
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
        bands=bands_of(plan.scale),
    )
    return path / report.HTML


def predictions_csv(findings: Findings) -> str:
    """A line for each trained ELM: what was varied, and its errors of Delta P in mm."""
    text = io.StringIO()
    table = list(findings.learning.rows())
    writer = csv.DictWriter(text, list(table[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(table)
    return text.getvalue()
