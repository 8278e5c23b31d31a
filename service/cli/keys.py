"""`needlebench key`: creates, lists and revokes API keys, in the data folder itself."""

from __future__ import annotations

from contextlib import contextmanager
from datetime import UTC, datetime
from typing import TYPE_CHECKING

import click

from service.cli.connection import data_option

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from service.store.keys import Keys


@click.group()
def key() -> None:
    """Create, list and revoke the API keys of a data folder.

    Works on the folder itself, whether a service runs on it or not; changes take effect within a second. The scope of a
    key says what it allows: read = see everything, submit = also submit and cancel jobs and upload files, admin = also
    delete what other keys created and operate the service. Only a hash of each key is stored.

    \b
    The first one:            needlebench key create --scope admin --note "me"
    For the nightly script:   needlebench key create --scope submit --note "nightly"
    All keys:                 needlebench key list
    After losing one:         needlebench key revoke ID
    """


@key.command()
@click.option("--scope", type=click.Choice(["read", "submit", "admin"]), default="submit", show_default=True)
@click.option("--note", default="", help="Who or what it is for; at most 200 characters.")
@data_option
def create(scope: str, note: str, data: Path | None) -> None:
    """Create a key and print it. It cannot be shown again.

    Once a key exists, the service on this data folder requires one with every request, also when the last one was
    revoked: this command is then the way back in.

    \b
    For a colleague:          needlebench key create --scope submit --note "Ada"
    """
    with _keys(data) as keys:
        created, text = keys.create(scope=scope, note=note)
        every = keys.all()
    usable = [item for item in every if item.revoked_at is None]
    click.echo(text)
    click.echo(f"key {created.id}, scope {created.scope}: keep it now, it is not shown again", err=True)
    if len(every) == 1:
        click.echo("this is the first key: from now on the service requires one with every request", err=True)
    if all(item.scope == "read" for item in usable):
        click.echo("no key allows submitting: create one of scope submit or admin too", err=True)


@key.command("list")
@data_option
def list_keys(data: Path | None) -> None:
    """List the keys: id, scope, when created and last used (to the minute), note.

    \b
    All keys:                 needlebench key list
    """
    with _keys(data, existing=True) as keys:
        for item in keys.all():
            state = f"revoked {_day(item.revoked_at)}" if item.revoked_at is not None else f"used {_day(item.used_at)}"
            click.echo(f"{item.id}  {item.scope:<7} created {_day(item.created_at)}  {state:<27}  {item.note}".rstrip())


@key.command()
@click.argument("key_id", metavar="ID")
@data_option
def revoke(key_id: str, data: Path | None) -> None:
    """Revoke the key of this ID and end its logins. Idempotent.

    \b
    The ids are in:           needlebench key list
    """
    with _keys(data, existing=True) as keys:
        keys.revoke(key_id)
        left = any(item.revoked_at is None for item in keys.all())
    click.echo(f"key {key_id} is revoked")
    if not left:
        click.echo(
            "no key is left, and the service stays locked; to get back in, on this machine: "
            "needlebench key create --scope admin",
            err=True,
        )


@contextmanager
def _keys(data: Path | None, *, existing: bool = False) -> Iterator[Keys]:
    """The keys of the data folder. existing: raises ScenarioError for a folder without a database, else makes one."""
    from service.settings import Settings
    from service.store.database import open_database
    from service.store.jobs import Store
    from service.store.keys import Keys
    from simcore.errors import Problem, ScenarioError

    settings = Settings.load(data=data, host="127.0.0.1")
    if existing and not settings.database.is_file():
        raise ScenarioError([Problem("--data", str(settings.data), "is not a service's data folder: it has no keys")])
    store = Store(open_database(settings.database))
    try:
        yield Keys(store)
    finally:
        store.close()


def _day(moment: float | None) -> str:
    return "never" if moment is None else datetime.fromtimestamp(moment, UTC).strftime("%Y-%m-%d %H:%M")
