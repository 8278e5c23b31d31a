"""`needlebench settle`: the experiment on what decides curved paths, in a folder that survives every interruption."""

from __future__ import annotations

from pathlib import Path

import click

from service.blas_threads import one_thread
from service.cli.paper import RunOptions, carry_out, origin_of, read_scale


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
@click.option("--plan", "only_plan", is_flag=True, help="Say what would be run, how long it takes, and end.")
@click.option("--any-commit", is_flag=True, help="Go on with a folder that another commit began.")
@click.option("--fields", is_flag=True, help="Print the scale as JSON, with every field, and end.")
def settle(scale_name: str, path: Path, workers: int, only_plan: bool, any_commit: bool, fields: bool) -> None:
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
    In DIR: settling.html, settling.json, cases.csv (one line an insertion), pareto.svg, results/ID.json, series/ID.npz,
    dataset-PLANT.npz, models/elm-PLANT.json.

    \b
    Exit code: 0 done   2 bad scale or folder, too little space   1 crash   130 Ctrl-C
    """
    one_thread()
    from benchmarks.settling.pipeline import settle as run_stages
    from benchmarks.settling.plan import SettlingPlan
    from benchmarks.settling.report import write
    from benchmarks.settling.scale import SCALES

    scale = read_scale(scale_name, SCALES)
    if fields:
        click.echo(scale.model_dump_json(indent=1))
        return
    plan = SettlingPlan(scale)
    carry_out(
        plan,
        RunOptions(path, workers, only_plan, any_commit, extend=None),
        lambda ports: run_stages(plan, ports),
        lambda outcomes, wall_s: write(
            outcomes, scale, path, origin_of(plan, outcomes, wall_s=wall_s, workers=workers)
        ),
    )
