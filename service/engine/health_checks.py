"""Whether data folder, disk and database are usable: the checks behind `/readyz` and `needlebench doctor`."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from service.files.disk import MINIMUM_FILES, WARNED_BYTES, WARNED_FILES, free_bytes, free_files, readable
from service.store.database import touch
from service.store.errors import SQLAlchemyError

if TYPE_CHECKING:
    from pathlib import Path

    from service.store.transactions import Transactions

Level = Literal["ok", "warn", "bad"]


@dataclass(frozen=True, kw_only=True)
class Check:
    """What was checked, the verdict, what was found, and what to do if it is not well."""

    name: str
    level: Level
    found: str
    advice: str = ""


def folder_check(data: Path) -> Check:
    """Whether a file can be written to the data folder. Its path is not shown: `/readyz` answers everybody."""
    try:
        with tempfile.TemporaryFile(dir=data) as file:
            file.write(b"needlebench")
            file.flush()
    except OSError as error:
        advice = "make it writable for this user, free space, or choose another with --data"
        return Check(name="data folder", level="bad", found=error.strerror or str(error), advice=advice)
    return Check(name="data folder", level="ok", found="is writable")


def disk_check(data: Path, minimum_bytes: int) -> Check:
    """Whether there is room, for bytes and for files: below either minimum no job is started."""
    try:
        free, files = free_bytes(data), free_files(data)
    except OSError as error:
        return Check(name="disk", level="bad", found=str(error), advice="mount the disk of the data folder")
    found, advice = f"{readable(free)} free", "remove old jobs: needlebench gc --older-than 30d"
    level: Level = "warn" if free < WARNED_BYTES else "ok"
    if free < minimum_bytes:
        level, found = "bad", f"{found}: no job is started below {readable(minimum_bytes)}"
    elif files is not None and files < WARNED_FILES:
        level, found = "warn", f"{found}, room for {files} more files (inodes)"
        if files < MINIMUM_FILES:
            level, found = "bad", f"{found}: no job is started below {MINIMUM_FILES}"
    return Check(name="disk", level=level, found=found, advice=advice)


def database_check(store: Transactions) -> Check:
    """Whether the database takes writes now."""
    try:
        touch(store.engine)
    except SQLAlchemyError as error:
        found = str(getattr(error, "orig", None) or error)
        advice = "check that its disk has room and is writable, and that no other program holds the file"
        return Check(name="database", level="bad", found=found, advice=advice)
    return Check(name="database", level="ok", found="takes writes")
