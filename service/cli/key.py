"""The command `needlebench key`: makes, lists and revokes API keys, in the data folder itself."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import click

from service.cli.service import data_option

if TYPE_CHECKING:
    from service.store.keys import Keys


@click.group()
def key() -> None:
    """Make, list and revoke the API keys of a data folder.

    Works on the folder itself, whether a service runs on it or not; changes hold within a second. A key may do what
    its scope says: read = look at everything, submit = also submit and cancel jobs and send files, admin = also delete
    what others made and run the service. Of each key only a hash is kept.

    \b
    The first one:            needlebench key create --scope admin --note "me"
    For the nightly script:   needlebench key create --scope submit --note "nightly"
    Which there are:          needlebench key list
    Lost one:                 needlebench key revoke ID
    """


@key.command()
@click.option("--scope", type=click.Choice(["read", "submit", "admin"]), default="submit", show_default=True)
@click.option("--note", default="", help="Whose it is or what it is for; at most 200 characters.")
@data_option
def create(scope: str, note: str, data: Path | None) -> None:
    """Make a key and print it. It cannot be shown again.

    As soon as there is one, the service on this data folder asks every request for a key.

    \b
    For a colleague:          needlebench key create --scope submit --note "Ada"
    """
    with _keys(data) as keys:
        made, text = keys.create(scope=scope, note=note)
        usable = [item for item in keys.all() if item.revoked_at is None]
    click.echo(text)
    click.echo(f"key {made.id}, scope {made.scope}: keep it now, it is not shown again", err=True)
    if len(usable) == 1:
        click.echo("it is the first: from now on the service asks every request for a key", err=True)
    if all(item.scope == "read" for item in usable):
        click.echo("with these keys nobody can submit: make one of scope submit or admin too", err=True)


@key.command("list")
@data_option
def list_keys(data: Path | None) -> None:
    """List the keys: id, scope, when made and last used (to a minute), note.

    \b
    Which there are:          needlebench key list
    """
    with _keys(data, there=True) as keys:
        for item in keys.all():
            state = f"revoked {_day(item.revoked_at)}" if item.revoked_at is not None else f"used {_day(item.used_at)}"
            click.echo(f"{item.id}  {item.scope:<7} made {_day(item.created_at)}  {state:<27}  {item.note}".rstrip())


@key.command()
@click.argument("key_id", metavar="ID")
@data_option
def revoke(key_id: str, data: Path | None) -> None:
    """Make the key of this ID open nothing any more and end its logins; once more is no error.

    \b
    The ids are in:           needlebench key list
    """
    with _keys(data, there=True) as keys:
        keys.revoke(key_id)
        left = any(item.revoked_at is None for item in keys.all())
    click.echo(f"key {key_id} is revoked")
    if not left:
        click.echo(
            "no key is left: on 127.0.0.1 the service asks for none, on other addresses it does not start", err=True
        )


@contextmanager
def _keys(data: Path | None, *, there: bool = False) -> Iterator[Keys]:
    """The keys of the data folder. there: one that holds none is refused and not made. Raises ScenarioError."""
    from service.settings import Settings
    from service.store.database import open_database
    from service.store.jobs import Store
    from service.store.keys import Keys
    from simcore.errors import Problem, ScenarioError

    settings = Settings.load(data=data, host="127.0.0.1")
    if there and not settings.database.is_file():
        raise ScenarioError([Problem("--data", str(settings.data), "is no data folder of a service: it holds no keys")])
    store = Store(open_database(settings.database))
    try:
        yield Keys(store)
    finally:
        store.close()


def _day(moment: float | None) -> str:
    return "never" if moment is None else datetime.fromtimestamp(moment, UTC).strftime("%Y-%m-%d %H:%M")
