"""What the commands that talk to a service share: its address, its errors, following a job."""

from __future__ import annotations

import os
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from collections.abc import Iterator

    from service.client.client import Client
    from service.client.records import JobStatus

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


@contextmanager
def service_client(url: str | None) -> Iterator[Client]:
    """A client of the service at `url`, else of the one that was started last on this machine.

    Wrong fields that the service reports become ScenarioError: bad input of the command.
    """
    from service.client.client import Client
    from service.files.endpoint import endpoint
    from service.settings import DEFAULT_HOST, DEFAULT_PORT, data_dir, url_of

    known = url or endpoint(data_dir()) or url_of(DEFAULT_HOST, DEFAULT_PORT)
    with Client(known, os.environ.get("NEEDLEBENCH_API_KEY")) as client, with_field_errors():
        yield client


@contextmanager
def with_field_errors() -> Iterator[None]:
    """Raises ScenarioError for a ServiceError that names wrong fields."""
    from service.client.connection import ServiceError
    from simcore.errors import ScenarioError

    try:
        yield
    except ServiceError as error:
        if error.problems:
            raise ScenarioError(error.problems) from None
        raise


def report_submitted(client: Client, job: JobStatus, *, wait: bool) -> JobStatus | None:
    """Print the id of a job that was just queued. wait: follow it to its end, and return it."""
    from service.cli.progress import follow

    click.echo(job.id)
    if not wait:
        click.echo(f"{client.url}{job.raw['links']['self']}", err=True)
        return None
    try:
        return follow(client, job)
    except KeyboardInterrupt:
        click.echo(f"the job continues; to stop it: needlebench cancel {job.id}", err=True)
        raise
