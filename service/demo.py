"""From nothing to a recording: a service of its own, one job over HTTP, its progress, its result."""

from __future__ import annotations

import os
import secrets
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import click

from service.api_key import keys_exist
from service.client import Client, JobStatus, ServiceError, Unreachable
from service.follow import exit_code, follow
from service.report_table import print_report
from service.server import CannotServe, endpoint, listen
from service.settings import DEFAULT_HOST, DEFAULT_PORT, Settings

SCENARIO = "demo"
_STOP_S = 15.0
_PORTS_TRIED = 50


def run_demo(*, data: Path | None, port: int | None, keep: bool | None) -> int:
    """The whole demonstration; its exit code. keep: stay up until Ctrl-C; None = on a terminal outside CI."""
    settings = Settings.load(data=data, host=DEFAULT_HOST, port=port)
    if settings.api_key is None and keys_exist(settings.database):
        settings = replace(settings, api_key=secrets.token_urlsafe(24))  # of the demonstration alone
    stay = keep if keep is not None else sys.stdout.isatty() and not os.environ.get("CI")
    click.echo(
        "A flexible needle is steered 122 mm deep through deforming tissue by an inverse finite element controller.\n"
        "This starts a service in a process of its own, submits the scenario `demo` to it over HTTP, follows the\n"
        f"run and keeps its result and recording in {settings.data}\n"
    )
    with _service(settings) as (url, process), Client(url, settings.api_key) as client:
        click.echo(f"service: {url}")
        job = _followed(client)
        _report(job, settings.data)
        if stay:
            _stay(url, process)
    return exit_code(job)


def _followed(client: Client) -> JobStatus:
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
        click.echo("Ctrl-C ends the service; everything is kept.")
        process.wait()
        click.echo("the service has ended", err=True)
    except KeyboardInterrupt:
        click.echo("\nstopping the service")


@contextmanager
def _service(settings: Settings) -> Iterator[tuple[str, subprocess.Popen[str] | None]]:
    """The address of a service on this data folder: the one that runs already, else a process of our own."""
    present = _running(settings)
    if present is not None:
        click.echo("a service runs on this folder already: using it")
        yield present, None
        return
    process = _start(settings)
    try:
        yield _address(process, settings), process
    finally:
        _stop(process)


def _running(settings: Settings) -> str | None:
    url = endpoint(settings.data)
    if url is None:
        return None
    try:
        with Client(url, settings.api_key, timeout_s=2.0) as client:
            client.ready()
    except (Unreachable, ServiceError):
        return None
    return url


def _start(settings: Settings) -> subprocess.Popen[str]:
    """The service as a process that ends with this one, however this one ends: it holds the other end of a pipe."""
    wanted = DEFAULT_PORT if settings.port is None else settings.port
    home = str(Path(__file__).resolve().parents[1])
    environment = {
        **os.environ,
        "NEEDLEBENCH_DATA": str(settings.data),
        "NEEDLEBENCH_HOST": settings.host,
        **({"NEEDLEBENCH_API_KEY": settings.api_key} if settings.api_key else {}),
        "NEEDLEBENCH_PORT": str(_free_port(settings.host, wanted)),
        "PYTHONPATH": os.pathsep.join(filter(None, [home, os.environ.get("PYTHONPATH")])),
    }
    code = "from service.server import main; main()"
    return subprocess.Popen(
        [sys.executable, "-P", "-c", code],
        env=environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,  # a Ctrl-C is for us alone: we end the service when we are done
    )


def _free_port(host: str, wanted: int) -> int:
    """The wanted port or the next that is free."""
    for port in range(wanted, min(wanted + _PORTS_TRIED, 65536)):
        try:
            with listen(host, port):
                if port != wanted:
                    click.echo(f"port {wanted} is taken: using {port}")
                return port
        except CannotServe:
            continue
    return 0


def _address(process: subprocess.Popen[str], settings: Settings) -> str:
    """What the service says once it listens. Raises CannotServe when it ends instead; it has said why."""
    assert process.stdout is not None
    url = process.stdout.readline().strip()
    if not url:
        raise CannotServe(f"the service did not start on {settings.data} (exit code {process.wait()})")
    return url


def _stop(process: subprocess.Popen[str]) -> None:
    assert process.stdin is not None
    process.stdin.close()
    try:
        process.wait(timeout=_STOP_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    if process.stdout is not None:
        process.stdout.close()
