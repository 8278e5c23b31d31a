"""Shows a job on the command line while it runs: a bar on a terminal, plain lines otherwise."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import click

from service.client.client import Client, JobStatus

SUCCESS, FAILURE, WITHOUT_SUCCESS = 0, 1, 3
_PLAIN_SHARE = 0.1  # of the run between two plain lines

Show = Callable[[JobStatus], None]


def follow(client: Client, job: JobStatus) -> JobStatus:
    """Show the job until it has ended; the job then."""
    if client.ready()["workers_ready"] == 0:
        click.echo("the workers are starting; the first time on a machine they compile for about a minute", err=True)
    with _bar() if sys.stderr.isatty() else _lines() as show:
        return client.wait(job.id, progress=show)


def exit_code(job: JobStatus) -> int:
    """0 = completed and successful, 3 = completed without success or not converged, 1 = no result."""
    if job.state != "finished":
        return FAILURE
    return SUCCESS if job.success else WITHOUT_SUCCESS


@contextmanager
def _bar() -> Iterator[Show]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %  {task.fields[text]}"),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("queued", total=1.0, text="")

        def show(job: JobStatus) -> None:
            progress.update(task, description=job.state, completed=job.progress.fraction, text=_text(job))

        yield show


@contextmanager
def _lines() -> Iterator[Show]:
    state, due = "", 0.0

    def show(job: JobStatus) -> None:
        nonlocal state, due
        if job.state != state or job.progress.fraction >= due:
            due = (job.progress.fraction // _PLAIN_SHARE + 1) * _PLAIN_SHARE
            state = job.state
            click.echo(f"{state} {100 * job.progress.fraction:3.0f} %  {_text(job)}".rstrip(), err=True)

    yield show


def _text(job: JobStatus) -> str:
    now = job.progress
    if job.state == "queued" or now.depth_mm is None:
        return ""
    parts = [f"depth {now.depth_mm:.1f} mm"]
    if now.tip_error_mm is not None:
        parts.append(f"tip error {now.tip_error_mm:.2f} mm")
    if now.insertion_force_n is not None:
        parts.append(f"force {now.insertion_force_n:.2f} N")
    if now.eta_s is not None and not job.terminal:
        parts.append(f"{now.eta_s:.0f} s left")
    return ", ".join(parts)
