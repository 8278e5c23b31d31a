"""The commands that bring the recording of a job to the screen or into a file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from service.client.client import Client, JobStatus

_url = click.option(
    "--url",
    metavar="URL",
    envvar="NEEDLEBENCH_URL",
    help="Address of the service (NEEDLEBENCH_URL); default: the one on NEEDLEBENCH_DATA, else port 8321.",
)


@click.group()
def recording() -> None:
    """Open or fetch the recording of a job.

    \b
    Look at one:              needlebench recording open JOB
    Take it elsewhere:        needlebench recording fetch JOB a.rrd
    A picture of it:          needlebench view a.rrd --screenshot a.png
    """


@recording.command("open")
@click.argument("job_id", metavar="JOB")
@_url
@click.pass_context
def open_recording(ctx: click.Context, job_id: str, url: str | None) -> None:
    """Open the recording of JOB in the Rerun viewer, until its window is closed.

    A service on this machine has the file already; from another it is fetched once and kept in the user's cache.
    Of a running job on this machine, what there is so far.

    \b
    The last one that ended:  needlebench recording open $(needlebench jobs --limit 1 | cut -d' ' -f1)
    """
    from service.cli.service import asked, client_of
    from service.recording import viewer

    with client_of(url) as client:
        job = asked(lambda: client.job(job_id))
        path = _local(client, job) or _cached(client, job)
    ctx.exit(viewer.show(path))


@recording.command("fetch")
@click.argument("job_id", metavar="JOB")
@click.argument("file", type=click.Path(dir_okay=False, path_type=Path))
@_url
def fetch_recording(job_id: str, file: Path, url: str | None) -> None:
    """Write the recording of JOB to FILE; of a running job when it has ended.

    \b
    From another machine:     needlebench recording fetch JOB a.rrd --url http://lab:8321
    """
    from service.cli.service import asked, client_of

    with client_of(url) as client:
        click.echo(asked(lambda: client.recording(job_id, file)))


def _local(client: Client, job: JobStatus) -> Path | None:
    """The file in the data folder of this machine, if it is this service's."""
    from service.server.endpoint import endpoint
    from service.settings import data_dir

    data = data_dir()
    path = data / "jobs" / job.id / str(job.attempt) / "recording.rrd"
    return path if endpoint(data) == client.url and path.is_file() else None


def _cached(client: Client, job: JobStatus) -> Path:
    """A copy in the user's cache, named by its content."""
    import platformdirs

    from service.cli.service import asked

    folder = Path(platformdirs.user_cache_dir("needlebench")) / "recordings"
    folder.mkdir(parents=True, exist_ok=True)
    known = next((file["sha256"] for file in client.artefacts(job.id) if file["name"] == "recording.rrd"), None)
    if known is None:
        click.echo("the job has not ended: its recording is fetched when it has", err=True)
        return asked(lambda: client.recording(job.id, folder / f"{job.id}.rrd"))
    path = folder / f"{job.id}-{known[:16]}.rrd"
    return path if path.is_file() else asked(lambda: client.recording(job.id, path))
