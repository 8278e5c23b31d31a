"""The commands that start a service: serve, demo."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import click

from service.cli.connection import data_option

if TYPE_CHECKING:
    from pathlib import Path


class Serve(click.Command):
    """Its help ends with the environment variables that set limits."""

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002  (click's)
        """List the environment variables and the limits."""
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
    "--keep-days", type=click.FloatRange(1), metavar="DAYS", help="Once a day, remove jobs that ended longer ago."
)
@click.option("--keep-gb", type=click.FloatRange(0), metavar="G", help="Then the oldest, until the rest takes no more.")
@click.option(
    "--log-format",
    type=click.Choice(["text", "json"]),
    default="text",
    show_default=True,
    envvar="NEEDLEBENCH_LOG_FORMAT",
    help="Warnings as text, or everything, requests included, as JSON lines.",
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
    after its next start and resumes the queue. One service per data folder.

    \b
    On this machine:          needlebench serve
    One job at a time:        NEEDLEBENCH_WORKERS=1 needlebench serve
    With a folder of its own: needlebench serve --data ./data --port 9000
    For a log collector:      needlebench serve --log-format json --drain 60
    Old jobs removed daily:   needlebench serve --keep-days 90 --keep-gb 50

    An address that other machines can reach requires a key, which clients send as `Authorization: Bearer KEY`; started
    without one, the command prints what to type. Permanent keys, with scopes, come from another command:

    \b
    For this lab:             needlebench key create --scope admin --note "me"
                              needlebench serve --host 0.0.0.0

    Once a key exists, or one is set (NEEDLEBENCH_API_KEY, scope admin), it is required on every address;
    `needlebench submit` and the other commands take it from the same variable, a browser at /login. The page with the
    list of jobs is at the printed address, the description of the HTTP interface at /openapi.json.
    """
    from service import logs
    from service.server.port_notice import port_notice
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
@data_option
@click.option("--port", type=click.IntRange(1, 65535), help="Default 8321; if it is taken, the next free one.")
@click.option("--keep/--once", default=None, help="Stay up until Ctrl-C, or end with the run; on a terminal: keep.")
@click.pass_context
def demo(ctx: click.Context, data: Path | None, port: int | None, keep: bool | None) -> None:
    """See it work: start a service, submit one insertion to it, follow it, show its result.

    A flexible needle is steered 122 mm deep along a bowed path through tissue that deforms. On a terminal the
    service stays up until Ctrl-C, so that you can open the page and submit more; otherwise, or with CI set, it ends.

    \b
    On a terminal:            needlebench demo
    In a script:              needlebench demo --once --data ./demo-data

    \b
    Exit code: 0 completed and successful
               3 completed without success, or not converged
               1 no result; 130 Ctrl-C before there was one
    """
    from service.cli.demo import run_demo

    ctx.exit(run_demo(data=data, port=port, keep=keep))
