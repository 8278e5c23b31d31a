"""Opening the embedded database: pragmas, explicit transactions, migrations."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import Any

from alembic import command
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Connection, Engine, create_engine, event

from simcore.errors import NeedlebenchError

_PRAGMAS = ("journal_mode = WAL", "synchronous = FULL", "foreign_keys = ON", "busy_timeout = 10000")


class DatabaseTooNew(NeedlebenchError):
    """The database was written by a later version of the program."""


def open_database(path: Path) -> Engine:
    """An engine on the SQLite file at `path`, upgraded to the newest tables. Raises DatabaseTooNew."""
    path.parent.mkdir(parents=True, exist_ok=True)
    engine = create_engine(
        f"sqlite:///{path}",
        json_serializer=partial(json.dumps, allow_nan=False),
        pool_size=10,
        max_overflow=40,  # one for each thread that serves a request
    )
    event.listen(engine, "connect", _prepare)
    event.listen(engine, "begin", _begin)
    try:
        _upgrade(engine, path)
    except BaseException:
        engine.dispose()
        raise
    return engine


def _prepare(connection: Any, _record: Any) -> None:
    connection.isolation_level = None  # no BEGIN by the driver: _begin says which one
    for pragma in _PRAGMAS:
        connection.execute(f"PRAGMA {pragma}")


def _begin(connection: Connection) -> None:
    """A transaction that will write takes the write lock at once: a read that turns into a write fails when busy."""
    write = connection.get_execution_options().get("write", False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if write else "BEGIN")


def _upgrade(engine: Engine, path: Path) -> None:
    config = Config()
    config.set_main_option("script_location", str(Path(__file__).parent / "migrations").replace("%", "%%"))
    config.set_main_option("path_separator", "os")
    known = {script.revision for script in ScriptDirectory.from_config(config).walk_revisions()}
    with engine.execution_options(write=True).begin() as connection:
        present = set(MigrationContext.configure(connection).get_current_heads())
        if not present <= known:
            raise DatabaseTooNew(
                f"{path} was written by a later needlebench (its tables are at {', '.join(sorted(present - known))}): "
                "install that version, or choose another folder with --data"
            )
        config.attributes["connection"] = connection
        command.upgrade(config, "head")
