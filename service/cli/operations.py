"""The commands of an operator: remove old jobs, check the installation."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import click

from service.cli.connection import data_option, service_client

if TYPE_CHECKING:
    from pathlib import Path

    from service.engine.retention import Policy
    from service.settings import Settings


@click.command()
@click.option("--older-than", metavar="AGE", help="Jobs that ended longer ago, and unused uploads; 30d, 12h.")
@click.option("--keep-last", type=click.IntRange(0), metavar="N", help="Never the newest N; alone: all but these.")
@click.option("--max-gb", type=click.FloatRange(0), metavar="G", help="Then the oldest, until the rest takes no more.")
@click.option("--dry-run", is_flag=True, help="Only report what would be removed.")
@click.option("--json", "as_json", is_flag=True, help="What was removed, as one JSON object.")
@click.option("--url", metavar="URL", help="A service on another machine; default: the data folder on this one.")
@data_option
def gc(
    older_than: str | None,
    keep_last: int | None,
    max_gb: float | None,
    dry_run: bool,
    as_json: bool,
    url: str | None,
    data: Path | None,
) -> None:
    """Remove ended jobs with their results and recordings, unused uploads, and folders without a job.

    Pinned jobs (needlebench pin JOB) and those of a running campaign are kept. With --older-than, uploads of that age
    are removed too, unless they are pinned or a remaining job, campaign, schedule or model uses them. Without a rule,
    only folders without a job are removed. A service that runs on the data folder does the work itself.

    \b
    What would be removed:    needlebench gc --older-than 30d --dry-run
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
    click.echo(json.dumps(cleared)) if as_json else _print_cleared(cleared, dry_run)


def _cleared(settings: Settings, policy: Policy, dry_run: bool, url: str | None) -> dict[str, Any]:
    """By the service, if there is one: only one process may write to a data folder."""
    from dataclasses import asdict

    from service.engine.retention import clear
    from service.files.endpoint import endpoint
    from service.files.lock import LockHeldError, file_lock
    from service.store.database import open_database
    from service.store.jobs import Store
    from service.store.uploads import Uploads
    from simcore.errors import Problem, ScenarioError

    if url is None:
        if not settings.database.is_file():
            raise ScenarioError([Problem("--data", str(settings.data), "has no jobs")])
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
    with service_client(url) as client:
        return client.clear(**asdict(policy), dry_run=dry_run)


def _print_cleared(cleared: dict[str, Any], dry_run: bool) -> None:
    from service.files.disk import readable

    verb = "would be removed" if dry_run else "removed"
    for name in (*cleared["jobs"], *cleared["uploads"]):
        click.echo(name)
    counts = f"{len(cleared['jobs'])} jobs, {len(cleared['uploads'])} uploads and {len(cleared['orphans'])} folders"
    click.echo(f"{counts} {verb}: {readable(cleared['bytes'])}", err=True)
    click.echo(f"{cleared['kept']} ended jobs remain: {readable(cleared['kept_bytes'])}", err=True)


@click.command()
@click.option("--json", "as_json", is_flag=True, help="One JSON object per check.")
@data_option
@click.pass_context
def doctor(ctx: click.Context, as_json: bool, data: Path | None) -> None:
    """Check this installation and its data folder, and say what to fix.

    Python and package versions, the cache of compiled kernels, memory, data folder, disk, lock, database, port and
    viewer. Nothing is changed, and no service is needed.

    \b
    Before the first start:   needlebench doctor
    Of another folder:        needlebench doctor --data /data

    \b
    Exit code: 0 ready for work, perhaps with warnings; 1 something is wrong
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
