"""Whether a database is whole: its pages, and all that was acknowledged.

A write-ahead log that was cut short is no error to SQLite: what is missing is left out without a word. So a small file
beside the database keeps how many rows there ever were when a commit was last known to be on the disk; a database that
holds fewer has lost some.
"""

from __future__ import annotations

import os
import sqlite3
from contextlib import closing, suppress
from typing import TYPE_CHECKING, Any

from service.store.backup_names import BACKUPS, newest_backup
from simcore.errors import NeedlebenchError

if TYPE_CHECKING:
    from pathlib import Path

    from sqlalchemy import Connection

_COUNT = "SELECT coalesce(sum(seq), 0) FROM sqlite_sequence"  # of rows ever made: deleting one changes nothing
_WIDTH = 20
UNFINISHED = 10 ** (_WIDTH - 1)  # kept while a database is replaced: whatever is there meanwhile is refused


class DamagedDatabaseError(NeedlebenchError):
    """The file of the database is not whole, or does not hold all that was acknowledged; says what to do."""


def mark_of(path: Path) -> Path:
    """The file beside the database that keeps what was acknowledged."""
    return path.with_name(f"{path.name}-mark")


class Mark:
    """Keeps how many rows a database held when a commit was last on the disk. database: its file."""

    def __init__(self, database: Path) -> None:
        self._path = mark_of(database)
        self._file: int | None = None
        self._kept = -1
        self.committed = 0  # as of the last commit, which may not be on the disk yet

    def count(self, connection: Connection) -> int:
        """Rows ever made, within a transaction that is about to be committed."""
        driver: Any = connection.connection.driver_connection
        return int(driver.execute(_COUNT).fetchone()[0])

    def keep(self, count: int) -> None:
        """That many are on the disk. What cannot be written now is written after the next commit."""
        if count == self._kept:
            return
        with suppress(OSError):
            if self._file is None:
                self._file = os.open(self._path, os.O_WRONLY | os.O_CREAT, 0o600)
            os.lseek(self._file, 0, os.SEEK_SET)
            os.write(self._file, f"{count:0{_WIDTH}d}\n".encode())
            self._kept = count

    def close(self) -> None:
        """Give the file back; a later `keep` opens it again."""
        number, self._file = self._file, None
        if number is not None:
            os.close(number)


def check_whole(path: Path) -> None:
    """Raises DamagedDatabaseError unless every page can be read and nothing that was acknowledged is missing."""
    try:
        with closing(_read_only(path)) as connection:
            found = [str(row[0]) for row in connection.execute("PRAGMA quick_check(3)")]
            known = connection.execute("SELECT 1 FROM sqlite_master WHERE name = 'sqlite_sequence'").fetchone()
            count = int(connection.execute(_COUNT).fetchone()[0]) if known else 0
    except sqlite3.OperationalError as error:
        if error.sqlite_errorcode & 0xFF not in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB):
            raise  # locked, not readable: no word about its content
        found, count = [str(error)], 0
    except sqlite3.DatabaseError as error:
        found, count = [str(error)], 0
    if found != ["ok"]:
        raise DamagedDatabaseError(f"{path} is damaged ({'; '.join(found)}). {_advice(path)}")
    promised = acknowledged(path)
    if promised == UNFINISHED:
        raise DamagedDatabaseError(f"{path}: restoring it was interrupted. {_advice(path)}")
    if count < promised:
        raise DamagedDatabaseError(
            f"{path} has lost {promised - count} of {promised} rows that were acknowledged: its write-ahead log "
            f"({path.name}-wal) was cut short or removed, or the file is an older copy. {_advice(path)}, or go on with "
            f"what is left: needlebench restore --as-it-is --data {path.parent}"
        )


def acknowledged(path: Path) -> int:
    """Rows that the database at `path` must hold, as its mark says; 0 without one."""
    try:
        return int(mark_of(path).read_text(encoding="ascii")[:_WIDTH])
    except (OSError, ValueError):
        return 0


def accept_as_it_is(path: Path) -> int:
    """Take what the database holds for all that it ever held; how many rows. Raises DamagedDatabaseError if damaged."""
    mark_of(path).unlink(missing_ok=True)
    check_whole(path)
    with closing(sqlite3.connect(path)) as connection:
        count = int(connection.execute(_COUNT).fetchone()[0])
    mark = Mark(path)
    mark.keep(count)
    mark.close()
    return count


def _advice(path: Path) -> str:
    """What to type; nothing was changed so far."""
    home = path.parent / BACKUPS
    newest = newest_backup(home)
    if newest is None:
        return f"Nothing was changed, and there is no backup in {home}. Choose another folder with --data"
    return f"Nothing was changed. Restore the newest backup: needlebench restore {newest} --data {path.parent}"


def _read_only(path: Path) -> sqlite3.Connection:
    return sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)
