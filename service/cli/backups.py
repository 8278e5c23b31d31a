"""The commands that back a data folder up and restore it."""

from __future__ import annotations

import time
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from service.cli.connection import data_option

if TYPE_CHECKING:
    from collections.abc import Iterator

    from service.store.backups import Backup


@click.command()
@click.argument("folder", metavar="[DIR]", required=False, type=click.Path(file_okay=False, path_type=Path))
@click.option("--database-only", is_flag=True, help="Without results, recordings and uploads.")
@data_option
def backup(folder: Path | None, database_only: bool, data: Path | None) -> None:
    """Back a data folder up to DIR, which must not be there yet; a service may go on working meanwhile.

    Copies the database as it is at one moment, and the results, recordings and uploads that it names. DIR has its name
    once the backup is whole. Without DIR: a new folder in `backups` of the data folder, which does not help when its
    disk is lost.

    \b
    To another disk:          needlebench backup /media/usb/lab-$(date +%F)
    Back:                     needlebench restore /media/usb/lab-2026-12-01

    \b
    Exit code: 0 done   1 not done, with the reason
    """
    from service.files.disk import readable
    from service.files.private import private_files
    from service.settings import Settings
    from service.store.backup_names import BACKUPS
    from service.store.backups import take_backup

    settings, now = Settings.load(data=data), time.time()
    name = f"manual-{time.strftime('%Y%m%dT%H%M%SZ', time.gmtime(now))}"
    target = settings.data / BACKUPS / name if folder is None else folder.absolute()
    with private_files(), _reported("backing up"):
        made = take_backup(settings.data, target, with_files=not database_only, now=now)
    for lost in made.left_out:
        click.echo(f"left out, it is not as long as the database says: {lost}", err=True)
    content = f"the database and {len(made.files)} files, {readable(made.bytes)}" if made.with_files else "the database"
    click.echo(f"{content}", err=True)
    click.echo(made.folder)


@click.command()
@click.argument("folder", metavar="[BACKUP]", required=False, type=click.Path(file_okay=False, path_type=Path))
@click.option("--as-it-is", is_flag=True, help="No backup: go on with what a database whose log was cut still holds.")
@data_option
def restore(folder: Path | None, as_it_is: bool, data: Path | None) -> None:
    """Put BACKUP in the place of a data folder's database, and the files in it that are missing there.

    No service may run on the folder. The database that was there is kept in `backups`. Jobs that were submitted after
    the backup are gone; those that were queued or running in it are run.

    \b
    The newest of every day:  ls -d DATA/backups/daily-*
    Put it back:              needlebench restore DATA/backups/daily-20261201T030000Z --data DATA

    \b
    Exit code: 0 done   1 not done, with the reason   2 bad arguments
    """
    from service.files.lock import LockHeldError, file_lock
    from service.files.private import private_files
    from service.settings import Settings
    from service.store.backups import BackupError, read_backup, restore_backup
    from service.store.integrity import accept_as_it_is

    if (folder is None) != as_it_is:
        raise click.UsageError("Give either a BACKUP or --as-it-is.")
    settings = Settings.load(data=data)
    try:
        with private_files(), file_lock(settings.data / "server.lock"), _reported("restoring"):
            if folder is None:
                rows = accept_as_it_is(settings.database)
                click.echo(f"{settings.database} is taken as it is, with {rows} rows ever made", err=True)
                return
            found = read_backup(folder.absolute())
            kept, missing = restore_backup(found, settings.data, now=time.time())
    except LockHeldError:
        raise BackupError(f"a service runs on {settings.data}: stop it first") from None
    _print_restored(found, kept, missing)


def _print_restored(found: Backup, kept: Path | None, missing: list[str]) -> None:
    moment = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime(found.created_at))
    click.echo(f"restored the state of {moment}", err=True)
    if kept is not None:
        click.echo(f"the database that was there is kept in {kept}", err=True)
    for name in missing:
        click.echo(f"missing: {name}", err=True)


@contextmanager
def _reported(doing: str) -> Iterator[None]:
    """What the disk refuses, in one line. Raises BackupError."""
    from service.store.backups import BackupError

    try:
        yield
    except OSError as error:
        name = f" ({error.filename})" if error.filename else ""
        raise BackupError(f"{doing} failed: {error.strerror or error}{name}") from None
