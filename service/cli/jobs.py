"""The commands about one job of a service: show, pin, unpin."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import click

from service.cli.service import asked, client_of, url_option

if TYPE_CHECKING:
    from service.client.client import JobEvent


@click.command()
@click.argument("job_id", metavar="JOB")
@click.option("--events", "part", flag_value="events", help="What happened to it so far, a line each.")
@click.option("--log", "part", flag_value="log", help="What its last attempt logged so far.")
@url_option
def show(job_id: str, part: str | None, url: str | None) -> None:
    """Print everything about one job as JSON: state, progress, scenario, result, links; or its events or its log.

    \b
    Metrics only:             needlebench show JOB | jq .metrics
    Why did it fail?          needlebench show JOB --log
    When did it wait, crash?  needlebench show JOB --events
    """
    with client_of(url) as client:
        if part == "events":
            for event in asked(lambda: client.history(job_id)):
                click.echo(_line(event))
        elif part == "log":
            click.echo(asked(lambda: client.log(job_id)), nl=False)
        else:
            click.echo(json.dumps(dict(asked(lambda: client.job(job_id)).raw), indent=2))


def _line(event: JobEvent) -> str:
    more = ", ".join(f"{name} {value}" for name, value in (event.data or {}).items())
    return f"{(event.at or '')[:19]}  attempt {event.attempt}  {event.kind:<16}  {more}".rstrip()


@click.command()
@click.argument("job_id", metavar="JOB")
@url_option
def pin(job_id: str, url: str | None) -> None:
    """Keep a job with its result and files, whatever `needlebench gc` clears away. Once more is no error.

    \b
    One of them:              needlebench pin JOB
    """
    with client_of(url) as client:
        click.echo(f"{asked(lambda: client.pin(job_id)).id} is kept")


@click.command()
@click.argument("job_id", metavar="JOB")
@url_option
def unpin(job_id: str, url: str | None) -> None:
    """Keep a job no longer: it may be cleared away and deleted again. Once more is no error.

    \b
    One of them:              needlebench unpin JOB
    """
    with client_of(url) as client:
        asked(lambda: client.unpin(job_id))
        click.echo(f"{job_id} is kept no longer")
