"""`needlebench dataset`: the data of learned controllers, from new insertions or from those that have ended."""

from __future__ import annotations

import shutil
import sys
from contextlib import ExitStack, closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from service.blas_threads import one_thread
from service.cli.cluster.options import cluster_address, cluster_options
from service.cli.connection import data_option, url_option
from service.cli.results.output_file import free_to_write
from simcore.errors import Problem, ScenarioError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from benchmarks.cases import Case
    from benchmarks.learning.training_insertions import Insertion
    from service.local.case_runner import Where
    from service.local.dataset_runs import InsertionCache

FILE = click.Path(dir_okay=False, path_type=Path)


@click.command()
@click.option("--out", "path", metavar="FILE", required=True, type=FILE, help="The data set.")
@click.option(
    "--from",
    "source",
    metavar="CAMPAIGN|FOLDER",
    help="Take insertions that have ended instead of new ones: of a campaign, of `needlebench paper`, of runs.",
)
@click.option(
    "--arm", "arms", metavar="NAME", multiple=True, help="With --from, only insertions of this arm. Repeatable."
)
@click.option(
    "--format",
    "kind",
    type=click.Choice(["npz", "parquet"]),
    default="npz",
    show_default=True,
    help="npz = for `needlebench train`; parquet = a table for pandas, with --from alone.",
)
@click.option(
    "--insertions",
    type=click.IntRange(2, 105),
    default=105,
    show_default=True,
    help="How many of the grid's 105 points; fewer, spread over the grid, for a quick look.",
)
@click.option("--samples", type=click.IntRange(10), default=10_000, show_default=True, help="Rows that are drawn.")
@click.option("--seed", type=click.IntRange(0, 10**9), default=0, show_default=True, help="Of noise, draw and splits.")
@click.option("--workers", type=click.IntRange(1, 64), default=2, show_default=True, help="Processes, one thread each.")
@click.option(
    "--set", "changes", metavar="PATH=VALUE", multiple=True, help="Change one field of all insertions. Repeatable."
)
@cluster_options
@click.option("--force", is_flag=True, help="Replace the file.")
@data_option
@url_option
@click.pass_context
def dataset(
    ctx: click.Context, /, path: Path, source: str | None, samples: int, seed: int, force: bool, **options: Any
) -> None:
    """Run the paper's training insertions and write every step of them into FILE, or take those that have ended.

    Straight I-FEM insertions to a 7 x 15 grid on z = 122 mm, with target noise of +-0.25 mm. The file holds the
    variables of the paper's table I (simcore/rollout/dataset.py), the drawn rows, a 90/10 split by sample and one by
    trajectory, and where it all comes from.

    \b
    All of it:            needlebench dataset --out out/data.npz
    A quick look:         needlebench dataset --out out/few.npz --insertions 10
    At another time step: needlebench dataset --out out/data.npz --set dt_s=0.005
    Of a campaign:        needlebench dataset --from 5f2b8c0d9e1a4b37 --arm ifem --out out/mine.npz
    On a cluster:         needlebench dataset --out out/data.npz --cluster file:cluster/scheduler.json
    For pandas:           needlebench dataset --from out/paper --format parquet --out out/paper.parquet

    With --from, an insertion counts that left a series with all variables: of `needlebench paper` those of its data
    set, of campaigns and runs all. CAMPAIGN is the id of one on the service at --url, or in the data folder --data.

    Ctrl-C at any time: finished insertions stay in FILE.npz.parts until the file is complete, and the same command
    goes on from there.
    """
    one_thread()
    free_to_write(path, force=force)
    if source is not None:
        _refuse_given(
            ctx, ("insertions", "workers", "changes"), "runs new insertions; --from takes those that have ended"
        )
        _gather(source, path, samples=samples, seed=seed, **options)
        return
    _refuse_given(ctx, ("arms", "kind", "data", "url"), "needs --from")
    _run_insertions(path, samples=samples, seed=seed, **options)


def _refuse_given(ctx: click.Context, names: Sequence[str], why: str) -> None:
    """Raises ScenarioError for an option that was given and has no effect."""
    from click.core import ParameterSource

    for option in ctx.command.params:
        if option.name in names and ctx.get_parameter_source(option.name) is ParameterSource.COMMANDLINE:
            raise ScenarioError([Problem(option.opts[0], ctx.params[option.name], why)])


def _gather(
    source: str, path: Path, *, arms: tuple[str, ...], kind: str, samples: int, seed: int, **options: Any
) -> None:
    """The data set of insertions that have ended."""
    from service.cli.results.insertion_source import insertions_of
    from service.local.dataset_of import dataset_of, save_parquet
    from simcore.rollout.dataset import save_dataset

    scratch = path.with_name(f"{path.name}.parts")
    with insertions_of(source, scratch, data=options["data"], url=options["url"]) as insertions:
        found = dataset_of(insertions, arms=arms, samples=samples, seed=seed)
    for note in found.notes:
        click.echo(f"needlebench: warning: {note}", err=True)
    if kind == "parquet":
        save_parquet(found, path)
    else:
        save_dataset(found.data, path)
    rows, drawn = len(found.data.trajectory), len(found.data.drawn)
    click.echo(f"{path}: {len(found.outcomes)} insertions, {rows} steps, {drawn} drawn (seed {seed})")


def _run_insertions(
    path: Path, *, insertions: int, samples: int, seed: int, changes: tuple[str, ...], **options: Any
) -> None:
    """The data set of new insertions."""
    from benchmarks.learning.training_insertions import collect_dataset, training_insertions
    from service.local.case_runner import Where
    from service.local.dataset_runs import InsertionCache
    from simcore.rollout.dataset import save_dataset
    from simcore.scenario.presets import with_changes

    chosen = training_insertions(insertions=insertions, seed=seed, changes=with_changes({}, list(changes)))
    where = Where(
        options["workers"], cluster_address(options["cluster_text"], options["insecure"], options["certificates"])
    )
    cache = InsertionCache(path.with_name(f"{path.name}.parts"))
    data = collect_dataset(chosen, lambda these: _with_bar(these, where, cache), samples=samples, seed=seed)
    save_dataset(data, path)
    shutil.rmtree(cache.folder, ignore_errors=True)
    failed = [i["id"] for i in data.provenance["insertions"] if i["status"] != "completed"]
    if failed:
        click.echo(f"needlebench: warning: did not complete: {', '.join(failed)}", err=True)
    rows, drawn = len(data.trajectory), len(data.drawn)
    click.echo(f"{path}: {len(chosen)} insertions, {rows} steps, {drawn} drawn (seed {seed})")
    if drawn < samples:
        click.echo(f"needlebench: warning: {samples} samples were asked for, there are {drawn} steps", err=True)


def _with_bar(cases: Sequence[Case], where: Where, cache: InsertionCache) -> Iterator[Insertion]:
    """The insertions as they are finished, with a bar on a terminal, else with lines."""
    from service.local.dataset_runs import insertions

    with ExitStack() as stack:
        tick = stack.enter_context(_Bar(len(cases)))
        for done in stack.enter_context(closing(insertions(cases, where=where, cache=cache))):
            tick.advance()
            yield done


class _Bar:
    """How many are done and when all will be."""

    def __init__(self, total: int) -> None:
        self._total, self._done = total, 0
        self._progress: Any = None

    def __enter__(self) -> _Bar:
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

            columns = (TextColumn("insertions"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
            self._progress = Progress(*columns, console=Console(stderr=True), transient=True)
            self._progress.start()
            self._task = self._progress.add_task("insertions", total=self._total)
        return self

    def __exit__(self, *_: object) -> None:
        if self._progress is not None:
            self._progress.stop()

    def advance(self) -> None:
        self._done += 1
        if self._progress is not None:
            self._progress.advance(self._task)
        elif self._done % 10 == 0 or self._done == self._total:
            click.echo(f"{self._done} of {self._total} insertions", err=True)
