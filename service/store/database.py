"""Opening the embedded database: pragmas, explicit transactions, migrations."""

from __future__ import annotations

import json
import logging
import os
import sqlite3
import time
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic_core import from_json
from sqlalchemy import Connection, Engine, create_engine, event

from service.files.private import private_file, private_folder
from service.store.integrity import check_whole
from service.store.schema import REVISION
from simcore.errors import NeedlebenchError

if TYPE_CHECKING:
    from collections.abc import Callable

    from alembic.config import Config

_log = logging.getLogger("needlebench")
MIGRATIONS = Path(__file__).parent / "migrations"
_BUSY = "busy_timeout = 10000"
_PRAGMAS = ("journal_mode = WAL", "synchronous = FULL", "foreign_keys = ON", _BUSY)


class ForeignDatabaseError(NeedlebenchError):
    """The tables in the file are of another version of the program, or not of this program."""


def open_database(path: Path, *, now: Callable[[], float] = time.time) -> Engine:
    """An engine on the SQLite file at `path`, upgraded to the newest tables.

    Raises ForeignDatabaseError, and DamagedDatabaseError for one that is not whole; neither changes anything.

    Before an upgrade the file is copied to the folder `backups` beside it. now: UTC seconds since 1970.
    """
    private_folder(path.parent)
    if path.is_file():
        check_whole(path)
    private_file(path)  # SQLite gives its log the same permissions
    engine = create_engine(
        f"sqlite:///{path}",
        json_serializer=partial(json.dumps, allow_nan=False),
        json_deserializer=from_json,  # in less than half the time of json.loads: large campaigns are megabytes
        pool_size=10,
        max_overflow=40,  # one for each thread that serves a request
    )
    event.listen(engine, "connect", _prepare)
    event.listen(engine, "begin", _begin)
    try:
        _upgrade(engine, path, now)
    except BaseException:
        engine.dispose()
        raise
    return engine


def _prepare(connection: Any, _record: Any) -> None:
    connection.isolation_level = None  # no BEGIN by the driver: _begin says which one
    for pragma in _PRAGMAS:
        connection.execute(f"PRAGMA {pragma}")


def _begin(connection: Connection) -> None:
    """A transaction that will write takes the write lock at once: a read that turns into a write fails when busy.

    With `write="lazy"` its commit does not wait for the disk. It outlives any death of the process all the same; a
    power cut may take it back, whole, with those that came after it, until `sync` or another writer has waited.
    """
    driver = connection.connection.driver_connection
    assert driver is not None
    if (write := connection.get_execution_options().get("write", False)) is False:
        driver.execute("BEGIN")  # the short way: this BEGIN locks nothing, so it cannot fail
        return
    driver.execute(f"PRAGMA synchronous = {'NORMAL' if write == 'lazy' else 'FULL'}")
    connection.exec_driver_sql("BEGIN IMMEDIATE")


def sync(engine: Engine) -> None:
    """Bring to the disk what was committed so far. Raises OSError."""
    try:
        log = os.open(f"{engine.url.database}-wal", os.O_RDWR)
    except FileNotFoundError:  # SQLite took it into the database itself, and waited for the disk
        return
    try:
        os.fsync(log)
    finally:
        os.close(log)


def touch(engine: Engine) -> None:
    """Take the write lock and give it back. Raises SQLAlchemyError when that is not possible within a second."""
    with engine.connect() as connection:
        driver = connection.connection.driver_connection
        assert driver is not None
        driver.execute("PRAGMA busy_timeout = 1000")
        try:
            with connection.execution_options(write=True).begin():
                connection.exec_driver_sql("SELECT 1")
        finally:
            driver.execute(f"PRAGMA {_BUSY}")


def revision_of(path: Path) -> str | None:
    """The revision of the tables in the file; None for one that has none. Raises sqlite3.Error."""
    with closing(_read_only(path)) as connection:
        known = connection.execute("SELECT 1 FROM sqlite_master WHERE name = 'alembic_version'").fetchone()
        row = connection.execute("SELECT version_num FROM alembic_version").fetchone() if known else None
    return None if row is None else str(row[0])


def _read_only(path: Path) -> sqlite3.Connection:
    return sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)


def revisions() -> list[str]:
    """The revisions of the tables that this version knows, the newest first."""
    from alembic.script import ScriptDirectory

    return [script.revision for script in ScriptDirectory.from_config(_config()).walk_revisions()]


def _config() -> Config:
    from alembic.config import Config

    config = Config()
    config.set_main_option("script_location", str(MIGRATIONS).replace("%", "%%"))
    config.set_main_option("path_separator", "os")
    return config


def _back_up(path: Path, present: str, now: Callable[[], float]) -> Path:
    """Copy the database, whole and consistent, to a name that tells revision and time; the copy."""
    folder = path.parent / "backups"
    folder.mkdir(exist_ok=True)
    moment = time.strftime("%Y%m%dT%H%M%SZ", time.gmtime(now()))
    copy = folder / f"{path.stem}-{present}-{moment}{path.suffix}"
    draft = copy.with_name(f".{copy.name}.tmp")
    draft.unlink(missing_ok=True)
    with closing(sqlite3.connect(path)) as source, closing(sqlite3.connect(draft)) as target:
        source.backup(target)
    with draft.open("rb+") as file:
        os.fsync(file.fileno())
    draft.replace(copy)
    return copy


def _upgrade(engine: Engine, path: Path, now: Callable[[], float]) -> None:
    """Bring the tables to the newest revision, in one transaction. Raises ForeignDatabaseError."""
    before = revision_of(path) if path.is_file() else None
    if before == REVISION:
        return  # the usual case, without the cost of Alembic
    from alembic import command

    if path.stat().st_size:
        _check_origin(path, before)
    if before is not None:
        copy = _back_up(path, before, now)
        _log.warning("the database is upgraded from %s to %s; its copy: %s", before, REVISION, copy)
    config = _config()
    with engine.execution_options(write=True).begin() as connection:
        config.attributes["connection"] = connection
        command.upgrade(config, "head")


def _check_origin(path: Path, present: str | None) -> None:
    """Raises ForeignDatabaseError for tables that this version can neither use nor upgrade; changes nothing."""
    if present in revisions():
        return
    with closing(_read_only(path)) as connection:
        tables = connection.execute("SELECT 1 FROM sqlite_master WHERE type = 'table'").fetchone()
    if present is not None:
        raise ForeignDatabaseError(
            f"{path} was written by another version of needlebench (its tables are of revision {present}, this "
            f"version uses {REVISION}): use the version that wrote it, or choose another folder with --data"
        )
    if tables is not None:
        raise ForeignDatabaseError(f"{path} holds tables that are not needlebench's: choose another folder with --data")
