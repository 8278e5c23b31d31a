"""The commands about jobs of a service: submit, jobs, show, edit, cancel, retry, pin, unpin."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import click

from service.cli.connection import report_submitted, service_client, url_option

if TYPE_CHECKING:
    from service.client.client import Client
    from service.client.records import JobEvent, JobStatus


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
    help="Repeated with the same scenario, it returns the same job: for scripts that retry.",
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
    """Submit a scenario to a running service; prints the id of the job.

    SCENARIO is a JSON file, the name of a built-in scenario, or - for JSON on standard input.

    \b
    A built-in one:           needlebench submit demo --wait
    Your own:                 needlebench scenario demo > mine.json
                              needlebench submit mine.json --wait
    With another field:       needlebench submit demo --set tissue.young_kpa=3
    With a mesh of your own:  needlebench upload liver.msh
                              needlebench submit mine.json --set tissue.mesh_file=artefact:ID
    In a script that retries: needlebench submit mine.json --idempotency-key night-42
    To another machine:       NEEDLEBENCH_API_KEY=... needlebench submit mine.json --url http://lab:8321

    \b
    Exit code with --wait: 0 completed and successful
                           3 completed without success, or not converged
                           1 failed, cancelled or timed out; 2 bad scenario
    """
    from service.cli.progress import exit_code

    with service_client(url) as client:
        data = _read(source, changes)
        job = client.submit(data, priority=priority, timeout_s=timeout_s, idempotency_key=idempotency_key)
        if done := report_submitted(client, job, wait=wait):
            _print_end(client, done)
            ctx.exit(exit_code(done))


def _read(source: str, changes: tuple[str, ...]) -> Any:
    """The scenario of a file, of standard input, or of a built-in name, with changes."""
    from service.cli.local import read_source
    from simcore.scenario.presets import with_changes

    return with_changes(read_source(source), list(changes))


@click.command()
@click.option("--state", metavar="STATE", help="Only queued, running, finished, failed, cancelled or timed_out.")
@click.option("--outcome", metavar="OUTCOME", help="Only finished ones: success, missed, or a status, as target_lost.")
@click.option("--tag", metavar="TAG", help="Only those with this tag.")
@click.option("--limit", type=click.IntRange(1, 10_000), default=20, show_default=True, help="Most jobs listed.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object per line.")
@url_option
def jobs(state: str | None, outcome: str | None, tag: str | None, limit: int, as_json: bool, url: str | None) -> None:
    """List the jobs of a service, newest first.

    \b
    The running ones:         needlebench jobs --state running
    That lost their target:   needlebench jobs --outcome target_lost
    Of one study:             needlebench jobs --tag liver
    For other programs:       needlebench jobs --limit 1000 --json
    """
    with service_client(url) as client:
        for job in list(client.jobs(state=state, outcome=outcome, tag=tag, limit=limit)):
            click.echo(json.dumps(job.raw) if as_json else _line(job))


@click.command()
@click.argument("job_id", metavar="JOB")
@url_option
def cancel(job_id: str, url: str | None) -> None:
    """Cancel a queued or running job; what it has recorded so far is kept. Idempotent.

    \b
    The running ones:         needlebench jobs --state running
    One of them:              needlebench cancel JOB
    """
    with service_client(url) as client:
        client.cancel(job_id)
        job = client.wait(job_id, timeout_s=30)
        click.echo(f"{job.id} {job.state}")


@click.command()
@click.argument("job_id", metavar="JOB")
@url_option
def retry(job_id: str, url: str | None) -> None:
    """Queue a job again that failed, was cancelled or timed out, under the same id.

    \b
    The failed ones:          needlebench jobs --state failed
    One of them:              needlebench retry JOB
    """
    with service_client(url) as client:
        job = client.retry(job_id)
        click.echo(f"{job.id} {job.state}")


def _line(job: JobStatus) -> str:
    rmse = (job.metrics or {}).get("rmse_commanded_mm")
    measured = f"rmse {rmse:.3f} mm" if isinstance(rmse, float) else (job.error or {}).get("kind", "")
    share = f"{100 * job.progress.fraction:3.0f} %"
    tags = f"  [{', '.join(job.tags)}]" if job.tags else ""
    ended = f"{job.outcome or job.state:<14}"
    return f"{job.id}  {job.created_at[:19]}  {ended} {share}  {job.name}{tags}  {measured}".rstrip()


def _print_end(client: Client, job: JobStatus) -> None:
    if job.error is not None:
        click.echo(f"{job.state}: {job.error['message']}", err=True)
    for name, value in (job.metrics or {}).items():
        click.echo(f"  {name:<28}{value:.6g}" if isinstance(value, float) else f"  {name:<28}{value}")
    if (recording := job.raw["links"]["recording"]) and job.state == "finished":
        click.echo(f"recording: {client.url}{recording}")


@click.command()
@click.argument("job_id", metavar="JOB")
@click.option("--events", "part", flag_value="events", help="Its events so far, one per line.")
@click.option("--log", "part", flag_value="log", help="The log of its last attempt so far.")
@url_option
def show(job_id: str, part: str | None, url: str | None) -> None:
    """Print a job as JSON: state, progress, scenario, result, links; or its events or its log.

    \b
    Metrics only:             needlebench show JOB | jq .metrics
    Why did it fail?          needlebench show JOB --log
    When did it wait, crash?  needlebench show JOB --events
    """
    with service_client(url) as client:
        if part == "events":
            for event in client.history(job_id):
                click.echo(_event_line(event))
        elif part == "log":
            click.echo(client.log(job_id), nl=False)
        else:
            click.echo(json.dumps(dict(client.job(job_id).raw), indent=2))


def _event_line(event: JobEvent) -> str:
    more = ", ".join(f"{name} {value}" for name, value in (event.data or {}).items())
    return f"{(event.at or '')[:19]}  attempt {event.attempt}  {event.kind:<16}  {more}".rstrip()


@click.command()
@click.argument("job_id", metavar="JOB")
@click.option("--name", metavar="TEXT", help="Another name; the scenario keeps its own.")
@click.option("--tag", "tags", metavar="TAG", multiple=True, help="One of its tags, in the place of all; repeatable.")
@click.option("--no-tags", is_flag=True, help="Remove its tags.")
@click.option("--note", metavar="TEXT", help="Another note; an empty one removes it.")
@url_option
def edit(
    job_id: str, name: str | None, tags: tuple[str, ...], no_tags: bool, note: str | None, url: str | None
) -> None:
    """Change name, tags and note of a job. What is not given stays.

    \b
    To find it again:         needlebench edit JOB --tag liver --tag paper-2
    To remember why:          needlebench edit JOB --note "friction doubled"
    """
    if tags and no_tags:
        raise click.UsageError("--tag and --no-tags exclude each other")
    if name is None and note is None and not tags and not no_tags:
        raise click.UsageError("nothing to change: give --name, --tag, --no-tags or --note")
    with service_client(url) as client:
        job = client.edit(job_id, name=name, tags=tags if tags or no_tags else None, note=note)
        click.echo(f"{job.id} {job.name}" + (f" [{', '.join(job.tags)}]" if job.tags else ""))


@click.command()
@click.argument("job_id", metavar="JOB")
@url_option
def pin(job_id: str, url: str | None) -> None:
    """Pin a job: `needlebench gc` keeps it with its result and files. Idempotent.

    \b
    One of them:              needlebench pin JOB
    """
    with service_client(url) as client:
        click.echo(f"{client.pin(job_id).id} is pinned")


@click.command()
@click.argument("job_id", metavar="JOB")
@url_option
def unpin(job_id: str, url: str | None) -> None:
    """Unpin a job: it may be removed and deleted again. Idempotent.

    \b
    One of them:              needlebench unpin JOB
    """
    with service_client(url) as client:
        client.unpin(job_id)
        click.echo(f"{job_id} is no longer pinned")
