"""From nothing to a recording: starts a service, runs one job over HTTP, shows progress and result."""

from __future__ import annotations

import os
import secrets
import subprocess
import sys
from pathlib import Path

import click

from service.api_key import keys_exist
from service.cli.progress import exit_code, follow
from service.cli.result_table import print_report
from service.client.client import Client, JobStatus
from service.server.local_service import running_service
from service.settings import DEFAULT_HOST, Settings

SCENARIO = "demo"


def run_demo(*, data: Path | None, port: int | None, keep: bool | None) -> int:
    """Run the demonstration; returns its exit code. keep: stay up until Ctrl-C; None = on a terminal outside CI."""
    settings = Settings.load(data=data, host=DEFAULT_HOST, port=port)
    if settings.api_key is None and keys_exist(settings.database):
        settings = settings.model_copy(update={"api_key": secrets.token_urlsafe(24)})  # of the demonstration alone
    stay = keep if keep is not None else sys.stdout.isatty() and not os.environ.get("CI")
    click.echo(
        "A flexible needle is steered 122 mm deep through deforming tissue by an inverse finite element controller.\n"
        "This starts a service in its own process, submits the scenario `demo` to it over HTTP, follows the\n"
        f"run and keeps its result and recording in {settings.data}\n"
    )
    with running_service(settings) as (url, process), Client(url, settings.api_key) as client:
        click.echo(f"service: {url}")
        job = _run_job(client)
        _report(job, settings.data)
        if stay:
            _stay(url, process)
    return exit_code(job)


def _run_job(client: Client) -> JobStatus:
    """The demo job when it has ended; Ctrl-C cancels it, else the next service on the folder would run it."""
    job = client.submit(SCENARIO)
    try:
        return follow(client, job)
    except KeyboardInterrupt:
        client.cancel(job.id)
        raise


def _report(job: JobStatus, data: Path) -> None:
    if job.result is not None:
        click.echo()
        print_report(dict(job.result), data / "jobs" / job.id / str(job.attempt))
    else:
        message = job.error["message"] if job.error else ""
        click.echo(f"\njob {job.id} is {job.state}: {message}", err=True)


def _stay(url: str, process: subprocess.Popen[str] | None) -> None:
    """Until Ctrl-C, or until the service ends by itself."""
    click.echo(f"\nThe list of jobs: {url}   another run: needlebench submit line --wait --url {url}")
    if process is None:
        return
    try:
        click.echo("Ctrl-C ends the service; its data are kept.")
        process.wait()
        click.echo("the service has ended", err=True)
    except KeyboardInterrupt:
        click.echo("\nstopping the service")
