"""The commands that start a service or talk to one: serve, submit, demo, jobs, cancel, retry."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import click

if TYPE_CHECKING:
    from service.client.client import Client, JobStatus

Answer = TypeVar("Answer")

data_option = click.option(
    "--data",
    metavar="DIR",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder of jobs, results and recordings (NEEDLEBENCH_DATA); default: the platform's data folder.",
)
url_option = click.option(
    "--url",
    metavar="URL",
    envvar="NEEDLEBENCH_URL",
    help="Address of the service (NEEDLEBENCH_URL); default: the one on NEEDLEBENCH_DATA, else port 8321.",
)


class Serve(click.Command):
    """Its help ends with the environment variables that set limits."""

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        from service.settings import limits_help, variables_help

        for title, text in (("Environment variables", variables_help()), ("Limits, at most", limits_help())):
            with formatter.section(title):
                formatter.write_dl(text)


@click.command(cls=Serve)
@click.option("--host", metavar="ADDRESS", help="Address to listen on; default 127.0.0.1, this machine only.")
@click.option("--port", type=click.IntRange(0, 65535), help="Default 8321 or the next free one; 0 = any free one.")
@click.option(
    "--drain",
    "drain_s",
    type=click.FloatRange(0, 86400),
    default=0,
    metavar="SECONDS",
    help="How long running jobs may go on after SIGTERM or Ctrl-C; default 0: back into the queue at once.",
)
@click.option(
    "--keep-days", type=click.FloatRange(1), metavar="DAYS", help="Once a day, jobs that ended longer ago go."
)
@click.option("--keep-gb", type=click.FloatRange(0), metavar="G", help="Then the oldest, until the rest holds no more.")
@click.option(
    "--log-format",
    type=click.Choice(["text", "json"]),
    default="text",
    show_default=True,
    envvar="NEEDLEBENCH_LOG_FORMAT",
    help="Warnings as text, or everything, requests too, as JSON lines.",
)
@data_option
def serve(
    host: str | None,
    port: int | None,
    drain_s: float,
    keep_days: float | None,
    keep_gb: float | None,
    log_format: Literal["text", "json"],
    data: Path | None,
) -> None:
    """Start the HTTP service and run the jobs that are submitted to it, until Ctrl-C.

    Jobs, results and recordings are kept in the data folder: a service that was stopped, or killed, has them again
    when it is started, and goes on with what was queued. One service a data folder.

    \b
    On this machine:          needlebench serve
    One job at a time:        NEEDLEBENCH_WORKERS=1 needlebench serve
    With a folder of its own: needlebench serve --data ./data --port 9000
    For a log collector:      needlebench serve --log-format json --drain 60
    Cleared daily, pins stay: needlebench serve --keep-days 90 --keep-gb 50

    Any address that others can reach needs a key, which clients then send as `Authorization: Bearer KEY`; started
    without one, the command prints the line to type. Keys that are kept, with scopes, come from another command:

    \b
    For this lab:             needlebench key create --scope admin --note "me"
                              needlebench serve --host 0.0.0.0

    Once there is a key, or one is set (NEEDLEBENCH_API_KEY, scope admin), it is asked for on every address;
    `needlebench submit` and the other commands take it from the same variable, a browser at /login. The page with the
    list of jobs is at the address that is printed, the description of the whole interface at /openapi.json.
    """
    from service import logs
    from service.server.endpoint import port_notice
    from service.server.server import serve as serve_until_stopped
    from service.settings import Settings

    settings = Settings.load(data=data, host=host, port=port, drain_s=drain_s, keep_days=keep_days, keep_gb=keep_gb)
    logs.configure(log_format)

    def announce(url: str) -> None:
        if note := port_notice(settings.port, url):
            click.echo(note, err=True)
        click.echo(f"needlebench serves {url}\ndata: {settings.data}\nCtrl-C ends it; queued jobs are kept.")

    serve_until_stopped(settings, announce=announce)


@click.command()
@click.argument("source", metavar="SCENARIO")
@click.option("--wait", is_flag=True, help="Show progress until the job has ended, then its metrics.")
@click.option(
    "--set",
    "changes",
    metavar="PATH=VALUE",
    multiple=True,
    help="Change one field; VALUE is JSON, else a string. Repeatable, applied left to right.",
)
@click.option("--priority", type=click.IntRange(-100, 100), default=0, show_default=True, help="Higher runs first.")
@click.option(
    "--timeout",
    "timeout_s",
    type=click.FloatRange(1, 86400),
    metavar="SECONDS",
    help="Most wall time of an attempt; default an hour, or four times the estimate if that is longer.",
)
@click.option(
    "--idempotency-key",
    metavar="TEXT",
    help="Sent again with the same scenario, it gives the same job: for scripts that try again.",
)
@url_option
@click.pass_context
def submit(
    ctx: click.Context,
    source: str,
    wait: bool,
    changes: tuple[str, ...],
    priority: int,
    timeout_s: float | None,
    idempotency_key: str | None,
    url: str | None,
) -> None:
    """Send a scenario to a running service; prints the id of the job.

    SCENARIO is a JSON file, the name of a built-in scenario, or - for JSON on standard input.

    \b
    A built-in one:           needlebench submit demo --wait
    Your own:                 needlebench scenario demo > mine.json
                              needlebench submit mine.json --wait
    With another field:       needlebench submit demo --set tissue.young_kpa=3
    With a mesh of your own:  needlebench upload liver.msh
                              needlebench submit mine.json --set tissue.mesh_file=artefact:ID
    In a script, once only:   needlebench submit mine.json --idempotency-key night-42
    To another machine:       NEEDLEBENCH_API_KEY=... needlebench submit mine.json --url http://lab:8321

    \b
    Exit code with --wait: 0 completed and successful
                           3 completed without success, or not converged
                           1 failed, cancelled or timed out; 2 bad scenario
    """
    from service.cli.progress import exit_code

    with client_of(url) as client:
        data = _read(source, changes)
        job = asked(
            lambda: client.submit(data, priority=priority, timeout_s=timeout_s, idempotency_key=idempotency_key)
        )
        if done := told(client, job, wait=wait):
            _print_end(client, done)
            ctx.exit(exit_code(done))


def told(client: Client, job: JobStatus, *, wait: bool) -> JobStatus | None:
    """Print the id of a job that was just queued; wait: and follow it to its end, which is returned."""
    from service.cli.progress import follow

    click.echo(job.id)
    if not wait:
        click.echo(f"{client.url}{job.raw['links']['self']}", err=True)
        return None
    try:
        return follow(client, job)
    except KeyboardInterrupt:
        click.echo(f"the job goes on; to stop it: needlebench cancel {job.id}", err=True)
        raise


@click.command()
@data_option
@click.option("--port", type=click.IntRange(1, 65535), help="Default 8321; if it is taken, the next free one.")
@click.option("--keep/--once", default=None, help="Stay up until Ctrl-C, or end with the run; default: by terminal.")
@click.pass_context
def demo(ctx: click.Context, data: Path | None, port: int | None, keep: bool | None) -> None:
    """See it work: start a service, submit one insertion to it, follow it, show what came out.

    A flexible needle is steered 122 mm deep along a bowed path through tissue that deforms. On a terminal the
    service stays up until Ctrl-C, to look at the page and submit more; elsewhere, and with CI set, it ends.

    \b
    Just so:                  needlebench demo
    In a script:              needlebench demo --once --data ./demo-data

    \b
    Exit code: 0 completed and successful
               3 completed without success, or not converged
               1 no result; 130 Ctrl-C before there was one
    """
    from service.cli.demo import run_demo

    ctx.exit(run_demo(data=data, port=port, keep=keep))


@click.command()
@click.option("--state", metavar="STATE", help="Only queued, running, succeeded, failed, cancelled or timed_out.")
@click.option("--limit", type=click.IntRange(1, 10_000), default=20, show_default=True, help="At most so many.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object a line.")
@url_option
def jobs(state: str | None, limit: int, as_json: bool, url: str | None) -> None:
    """List the jobs of a service, newest first.

    \b
    What is going on:         needlebench jobs --state running
    For other programs:       needlebench jobs --limit 1000 --json
    """
    with client_of(url) as client:
        for job in asked(lambda: list(client.jobs(state=state, limit=limit))):
            click.echo(json.dumps(job.raw) if as_json else _line(job))


@click.command()
@click.argument("job_id", metavar="JOB")
@url_option
def cancel(job_id: str, url: str | None) -> None:
    """Cancel a queued or running job; what it has recorded so far is kept. Once more is no error.

    \b
    The running ones:         needlebench jobs --state running
    One of them:              needlebench cancel JOB
    """
    with client_of(url) as client:
        asked(lambda: client.cancel(job_id))
        job = client.wait(job_id, timeout_s=30)
        click.echo(f"{job.id} {job.state}")


@click.command()
@click.argument("job_id", metavar="JOB")
@url_option
def retry(job_id: str, url: str | None) -> None:
    """Queue a job again that failed, was cancelled or ran out of time, under the same id.

    \b
    Which ones:               needlebench jobs --state failed
    One of them:              needlebench retry JOB
    """
    with client_of(url) as client:
        job = asked(lambda: client.retry(job_id))
        click.echo(f"{job.id} {job.state}")


def client_of(url: str | None) -> Client:
    """A client of the service at `url`, else of the one that was started last on this machine."""
    from service.client.client import Client
    from service.server.endpoint import endpoint
    from service.settings import DEFAULT_HOST, DEFAULT_PORT, data_dir, url_of

    known = url or endpoint(data_dir()) or url_of(DEFAULT_HOST, DEFAULT_PORT)
    return Client(known, os.environ.get("NEEDLEBENCH_API_KEY"))


def _read(source: str, changes: tuple[str, ...]) -> Any:
    """The scenario of a file, of standard input, or of a built-in name, with changes."""
    from service.cli.local import read_source
    from simcore.scenario.presets import with_changes

    return with_changes(read_source(source), list(changes))


def asked(question: Callable[[], Answer]) -> Answer:
    """The answer; what the service says about wrong fields becomes bad input."""
    from service.client.client import ServiceError
    from simcore.errors import ScenarioError

    try:
        return question()
    except ServiceError as error:
        if error.problems:
            raise ScenarioError(error.problems) from None
        raise


def _line(job: JobStatus) -> str:
    rmse = (job.metrics or {}).get("rmse_mm")
    told = f"rmse {rmse:.3f} mm" if isinstance(rmse, float) else (job.error or {}).get("kind", "")
    share = f"{100 * job.progress.fraction:3.0f} %"
    return f"{job.id}  {job.created_at[:19]}  {job.state:<10} {share}  {job.name}  {told}".rstrip()


def _print_end(client: Client, job: JobStatus) -> None:
    if job.error is not None:
        click.echo(f"{job.state}: {job.error['message']}", err=True)
    for name, value in (job.metrics or {}).items():
        click.echo(f"  {name:<28}{value:.6g}" if isinstance(value, float) else f"  {name:<28}{value}")
    if (recording := job.raw["links"]["recording"]) and job.state == "succeeded":
        click.echo(f"recording: {client.url}{recording}")
