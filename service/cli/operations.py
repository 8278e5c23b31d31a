"""The commands for those who run a service: clear away old jobs, look over the installation."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from service.engine.retention import Policy
    from service.settings import Settings

_data = click.option(
    "--data",
    metavar="DIR",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder of jobs, results and recordings (NEEDLEBENCH_DATA); default: the platform's data folder.",
)


@click.command()
@click.option("--older-than", metavar="AGE", help="Jobs that ended longer ago, and unused uploads; 30d, 12h.")
@click.option("--keep-last", type=click.IntRange(0), metavar="N", help="Never the newest N; alone: all but these.")
@click.option("--max-gb", type=click.FloatRange(0), metavar="G", help="Then the oldest, until the rest holds no more.")
@click.option("--dry-run", is_flag=True, help="Only tell what would go.")
@click.option("--json", "as_json", is_flag=True, help="What went as one JSON object.")
@click.option("--url", metavar="URL", help="A service elsewhere; default: the data folder on this machine.")
@_data
def gc(
    older_than: str | None,
    keep_last: int | None,
    max_gb: float | None,
    dry_run: bool,
    as_json: bool,
    url: str | None,
    data: Path | None,
) -> None:
    """Clear away jobs that have ended, with their results and recordings, unused uploads, and folders without a job.

    Pinned jobs stay (needlebench pin JOB), and those of a campaign that runs. With --older-than, uploads of that age go
    too, unless they are pinned or a job, campaign, schedule or model that stays names them. Without a rule only folders
    without a job go. A service that runs on the data folder does the work itself.

    \b
    What would go:            needlebench gc --older-than 30d --dry-run
    Keep it small, by cron:   needlebench gc --older-than 90d --keep-last 100 --max-gb 50
    By the service itself:    needlebench serve --keep-days 90 --keep-gb 50
    """
    from service.engine.retention import Policy, seconds_of
    from service.settings import Settings

    policy = Policy(
        older_than_s=None if older_than is None else seconds_of(older_than, "--older-than"),
        keep_last=keep_last,
        max_bytes=None if max_gb is None else int(max_gb * 2**30),
    )
    cleared = _cleared(Settings.load(data=data), policy, dry_run, url)
    click.echo(json.dumps(cleared)) if as_json else _tell(cleared, dry_run)


def _cleared(settings: Settings, policy: Policy, dry_run: bool, url: str | None) -> dict[str, Any]:
    """By the service, if there is one: only one process may write to a data folder."""
    from dataclasses import asdict

    from service.engine.retention import clear
    from service.files.lock import LockHeldError, file_lock
    from service.server.endpoint import endpoint
    from service.store.database import open_database
    from service.store.jobs import Store
    from service.store.uploads import Uploads
    from simcore.errors import Problem, ScenarioError

    if url is None:
        if not settings.database.is_file():
            raise ScenarioError([Problem("--data", str(settings.data), "holds no jobs")])
        try:
            with file_lock(settings.data / "server.lock"):
                store = Store(open_database(settings.database))
                try:
                    uploads = Uploads(settings.uploads, store, settings.limits)
                    return asdict(clear(store, settings.jobs, policy, dry_run=dry_run, uploads=uploads))
                finally:
                    store.close()
        except LockHeldError:
            url = endpoint(settings.data)
    from service.cli.service import asked, client_of

    with client_of(url) as client:
        return asked(lambda: client.clear(**asdict(policy), dry_run=dry_run))


def _tell(cleared: dict[str, Any], dry_run: bool) -> None:
    from service.files.disk import readable

    would = "would go" if dry_run else "cleared away"
    for name in (*cleared["jobs"], *cleared["uploads"]):
        click.echo(name)
    counts = f"{len(cleared['jobs'])} jobs, {len(cleared['uploads'])} uploads and {len(cleared['orphans'])} folders"
    click.echo(f"{counts} {would}: {readable(cleared['bytes'])}", err=True)
    click.echo(f"{cleared['kept']} ended jobs stay: {readable(cleared['kept_bytes'])}", err=True)


@click.command()
@click.option("--json", "as_json", is_flag=True, help="One JSON object a check.")
@_data
@click.pass_context
def doctor(ctx: click.Context, as_json: bool, data: Path | None) -> None:
    """Look over this installation and its data folder, and say what to mend.

    Python and package versions, the cache of compiled kernels, memory, data folder, disk, lock, database, port and
    viewer. Nothing is changed, and no service is needed.

    \b
    Before the first start:   needlebench doctor
    Of another folder:        needlebench doctor --data /data

    \b
    Exit code: 0 fit for work, warnings included; 1 something is bad
    """
    from dataclasses import asdict

    from service.server.doctor import examine
    from service.settings import Settings

    checks = examine(Settings.load(data=data))
    for check in checks:
        if as_json:
            click.echo(json.dumps(asdict(check)))
            continue
        colour = {"ok": "green", "warn": "yellow", "bad": "red"}[check.level]
        click.echo(f"{click.style(f'{check.level:<5}', fg=colour)}{check.name:<14}{check.found}")
        if check.advice and check.level != "ok":
            click.echo(f"{'':<19}{check.advice}")
    if any(check.level == "bad" for check in checks):
        ctx.exit(1)
