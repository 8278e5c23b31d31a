"""`needlebench bench`: the benchmarks, with the processes and the recorder that they need handed to them."""

from __future__ import annotations

import contextlib
import functools
import json
import os
import sys
import tempfile
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import click

from service.blas_threads import one_thread
from simcore.errors import Problem, ScenarioError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from benchmarks.measurements import Table

WIDTH = 170  # columns of a table that goes to a file or a pipe
REGRESSION = 1


@click.command()
@click.argument("names", metavar="[NAME]...", nargs=-1)
@click.option(
    "--json", "json_file", metavar="FILE", type=click.Path(dir_okay=False, path_type=Path), help="Store the figures."
)
@click.option(
    "--out",
    "folder",
    metavar="DIR",
    default=Path("out/bench"),
    show_default=True,
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder for tables and pictures.",
)
@click.option("--quick", is_flag=True, help="Coarse mesh, short path, one round: does it work, not how fast it is.")
@click.option("--list", "listed", is_flag=True, help="List the benchmarks and end.")
@click.option(
    "--compare",
    "reports",
    metavar="A B",
    nargs=2,
    type=click.Path(dir_okay=False, path_type=Path),
    help="Say what changed from report A to report B, and measure nothing.",
)
@click.option(
    "--checkouts",
    metavar="OLD NEW",
    nargs=2,
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    help="Run the same short timings in two checkouts of this project in turn; print the ratio pair by pair.",
)
def bench(
    names: tuple[str, ...],
    json_file: Path | None,
    folder: Path,
    quick: bool,
    listed: bool,
    reports: tuple[Path, Path] | None,
    checkouts: tuple[Path, Path] | None,
) -> None:
    """Measure how fast the simulator is, what it costs and what its results owe to the discretisation.

    Without a NAME everything that measures time or memory is run; `convergence`, `work-precision`, `sweeps`,
    `cluster` and `forces` are studies and are run when they are named. Times are also given in L0, a frozen unit
    measured in the same run: one back-solve of SciPy's SuperLU and one pass of a plain force loop. Measure on a machine
    that does nothing else.

    \b
    What there is:             needlebench bench --list
    All timings, stored:       needlebench bench --json after.json
    Two of them:               needlebench bench step recording
    What changed:              needlebench bench --compare before.json after.json
    Bands of the default mesh: needlebench bench convergence --out results/convergence
    Which mesh is worth its time: needlebench bench work-precision --out results/work_precision
    Only whether it works:     needlebench bench micro --quick
    Did my change cost time:   git worktree add ../before main
                               needlebench bench --checkouts ../before .

    Reports of different days also differ by what else the machine did. --checkouts compares in one run: fresh
    processes in turn (old new, new old, ...), each with the code of one checkout and a kernel cache of its own that is
    filled before; nine pairs, about five minutes. It decides nothing: the exit code is 0 whatever the ratio.

    \b
    Exit code: 0 done (a missed target is no error), or nothing got worse
               1 --compare: a figure got worse by more than the noise; or a crash
               2 bad name, report or folder
    """
    one_thread()
    if reports is not None:
        click.get_current_context().exit(_compare(*reports))
    if checkouts is not None:
        if names:
            raise ScenarioError(
                [Problem("NAME", names[0], "cannot be combined with --checkouts, which has its own timings")]
            )
        _compare_checkouts(*checkouts, json_file=json_file, quick=quick)
        return
    from benchmarks.registry import BENCHMARKS, select

    if listed:
        for name, benchmark in BENCHMARKS.items():
            click.echo(f"{name:<16}{benchmark.text}{' (when named)' if benchmark.study else ''}")
        return
    _measure(select(names), json_file, folder, quick)


def _measure(names: list[str], json_file: Path | None, folder: Path, quick: bool) -> None:
    """Run, print, write."""
    from threadpoolctl import threadpool_limits

    from benchmarks.bench_report import busy, document
    from benchmarks.measurements import figure_table
    from benchmarks.ports import BenchPorts
    from benchmarks.registry import run_suite
    from service.local.bench_ports import bench_crew, cluster_cost, recorder
    from simcore.rollout.artefacts import replace_atomically

    _writable(folder, "--out")
    if json_file is not None:
        _writable(json_file.parent, "--json")
    before = _load()
    if warning := busy(before):
        click.echo(f"needlebench: warning: {warning}", err=True)
    date = datetime.now(UTC).isoformat(timespec="seconds")
    with tempfile.TemporaryDirectory(prefix="needlebench-") as scratch, _progress() as say, threadpool_limits(1):
        ports = BenchPorts(
            say=say,
            recorder=recorder,
            recorder_name="service.local.bench_ports:recorder",
            crew=lambda workers: bench_crew(workers, Path(scratch), say),
            folder=Path(scratch),
            quick=quick,
            kept=lambda name: _text_of(folder / name),
            keep=lambda name, text: replace_atomically(folder / name, functools.partial(_fill, text)),
            cluster=lambda tasks, workers: cluster_cost(tasks, workers, Path(scratch) / "cluster"),
        )
        parts = run_suite(names, ports)
    report = document(parts, date=date, quick=quick, load_before=before, load_after=_load())
    for table in (figure_table(parts), *(table for part in parts.values() for table in part.tables)):
        _print(table)
    written = {folder / name: text for part in parts.values() for name, text in part.files.items()}
    if json_file is not None:
        written[json_file] = json.dumps(report, indent=2, allow_nan=False) + "\n"
    for path, text in written.items():
        replace_atomically(path, functools.partial(_fill, text))
        click.echo(path)


def _text_of(path: Path) -> str | None:
    return path.read_text(encoding="utf-8") if path.exists() else None


def _fill(text: str, file: BinaryIO) -> None:
    file.write(text.encode())


def _writable(folder: Path, option: str) -> None:
    """Fail before the measurements and not after them."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise ScenarioError([Problem(option, str(folder), f"cannot be written: {error.strerror}")]) from None


def _load() -> float | None:
    """Load average over the last minute, None where nobody counts."""
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else None


@contextlib.contextmanager
def _progress() -> Iterator[Callable[[str], None]]:
    """A function that shows what is being measured: one changing line on a terminal, else a line each time."""
    if not sys.stderr.isatty():
        yield lambda text: click.echo(text, err=True)
        return
    from rich.console import Console

    console = Console(stderr=True)
    with console.status("starting") as status:
        yield status.update


# -- what is printed --------------------------------------------------------------------------------------------------

COLOURS = {"met": "green", "better": "green", "missed": "red", "worse": "red"}


def _print(table: Table) -> None:
    """A table on standard output; numbers to the right."""
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table as Grid

    from benchmarks.measurements import cell_text

    console = Console(highlight=False, width=None if sys.stdout.isatty() else WIDTH)
    if table.title:
        console.print(f"[bold]{table.title}[/bold]")
    grid = Grid(box=None, header_style="dim", pad_edge=False)
    for i, column in enumerate(table.columns):
        text = all(isinstance(row[i], str) for row in table.rows)
        grid.add_column(column, justify="left" if text else "right", overflow="fold", no_wrap=i == 0)
    for row in table.rows:
        cells = [escape(cell_text(value)) for value in row]
        grid.add_row(*(f"[{COLOURS[cell]}]{cell}[/]" if cell in COLOURS else cell for cell in cells))
    console.print(grid, "")


def _compare(first: Path, second: Path) -> int:
    """Print the changes; the exit code."""
    from benchmarks.bench_comparison import compare, regressions, table
    from benchmarks.bench_report import busy, load_report

    reports = {"A": load_report(first), "B": load_report(second)}
    changes = compare(reports["A"], reports["B"])
    for side, report in reports.items():
        if warning := busy(report["machine"]["load_before"]):
            click.echo(f"needlebench: warning: report {side}: {warning}", err=True)
    if reports["A"]["machine"]["cpu"] != reports["B"]["machine"]["cpu"]:
        click.echo("needlebench: warning: the reports are from different processors", err=True)
    _print(table(changes))
    worse = regressions(changes)
    click.echo(f"{len(worse)} of {len(changes)} figures got worse" if worse else "nothing got worse")
    return REGRESSION if worse else 0


def _compare_checkouts(old: Path, new: Path, *, json_file: Path | None, quick: bool) -> None:
    """Run both, print the ratios, write every value."""
    from benchmarks.bench_report import busy
    from benchmarks.performance.checkouts import checkout_table, compare_checkouts
    from simcore.rollout.artefacts import replace_atomically

    if json_file is not None:
        _writable(json_file.parent, "--json")
    if warning := busy(_load()):
        click.echo(f"needlebench: warning: {warning}", err=True)
    with tempfile.TemporaryDirectory(prefix="needlebench-") as scratch, _progress() as say:
        comparison = compare_checkouts(old, new, scratch=Path(scratch), say=say, quick=quick)
    _print(checkout_table(comparison))
    if json_file is not None:
        replace_atomically(json_file, functools.partial(_fill, json.dumps(comparison.as_json(), indent=2) + "\n"))
        click.echo(json_file)
