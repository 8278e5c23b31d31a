"""The commands that open or download the recording of a job."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from service.cli.connection import service_client, url_option

if TYPE_CHECKING:
    from service.client.client import Client, JobStatus


@click.group()
def recording() -> None:
    """Open or fetch the recording of a job.

    \b
    In the viewer:            needlebench recording open JOB
    Into a file:              needlebench recording fetch JOB a.rrd
    Of several jobs in one:   needlebench recording together both.rrd JOB JOB
    A picture of it:          needlebench view a.rrd --screenshot a.png
    """


@recording.command("open")
@click.argument("job_id", metavar="JOB")
@url_option
@click.pass_context
def open_recording(ctx: click.Context, job_id: str, url: str | None) -> None:
    """Open the recording of JOB in the Rerun viewer, until its window is closed.

    The file of a service on this machine is opened directly; from another machine it is downloaded once into the
    user's cache. Of a job that runs on this machine, the part recorded so far is shown.

    \b
    The last one that ended:  needlebench recording open $(needlebench jobs --limit 1 | cut -d' ' -f1)
    """
    from service.recording import viewer

    with service_client(url) as client:
        job = client.job(job_id)
        path = _local(client, job) or _cached(client, job)
    ctx.exit(viewer.show(path))


@recording.command("fetch")
@click.argument("job_id", metavar="JOB")
@click.argument("file", type=click.Path(dir_okay=False, path_type=Path))
@url_option
def fetch_recording(job_id: str, file: Path, url: str | None) -> None:
    """Write the recording of JOB to FILE; that of a running job once it has ended.

    \b
    From another machine:     needlebench recording fetch JOB a.rrd --url http://lab:8321
    """
    with service_client(url) as client:
        click.echo(client.recording(job_id, file))


@recording.command()
@click.argument("file", type=click.Path(dir_okay=False, path_type=Path))
@click.argument("job_ids", metavar="JOB JOB...", nargs=-1, required=True)
@url_option
def together(file: Path, job_ids: tuple[str, ...], url: str | None) -> None:
    """Write the recordings of two to six jobs into FILE as one: scenes side by side under one time cursor, plots on
    top of each other, each series with the name of its job.

    \b
    Two controllers:          needlebench recording together both.rrd JOB JOB
    Then:                     needlebench view both.rrd
    """
    from service.recording.together import combine, distinct

    with service_client(url) as client:
        jobs = [client.job(job_id) for job_id in job_ids]
        paths = [_local(client, job) or _cached(client, job) for job in jobs]
    combine(list(zip(distinct([job.name for job in jobs]), paths, strict=True)), file)
    click.echo(file)


def _local(client: Client, job: JobStatus) -> Path | None:
    """The file in the data folder of this machine, if it is this service's."""
    from service.files.endpoint import endpoint
    from service.settings import data_dir

    data = data_dir()
    path = data / "jobs" / job.id / str(job.attempt) / "recording.rrd"
    return path if endpoint(data) == client.url and path.is_file() else None


def _cached(client: Client, job: JobStatus) -> Path:
    """A copy in the user's cache, named by its content."""
    import platformdirs

    folder = Path(platformdirs.user_cache_dir("needlebench")) / "recordings"
    folder.mkdir(parents=True, exist_ok=True)
    known = next((file["sha256"] for file in client.artefacts(job.id) if file["name"] == "recording.rrd"), None)
    if known is None:
        click.echo("the job is still running: its recording is downloaded once it has ended", err=True)
        return client.recording(job.id, folder / f"{job.id}.rrd")
    path = folder / f"{job.id}-{known[:16]}.rrd"
    return path if path.is_file() else client.recording(job.id, path)
