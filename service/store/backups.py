"""Copies of a data folder while a service works on it, and the way back.

A backup is a folder with the database, a list of the files that it names, and, if wanted, these files. It has its name
once it is whole; what a kill leaves has a temporary name and is removed by the next one.
"""

from __future__ import annotations

import json
import os
import shutil
import sqlite3
import time
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from service.store.backup_names import BACKUPS, CONTENTS
from service.store.integrity import (
    UNFINISHED,
    DamagedDatabaseError,
    Mark,
    accept_as_it_is,
    check_whole,
    mark_of,
)
from simcore.errors import NeedlebenchError

DAILY = "daily-"
DATABASE = "needlebench.sqlite"
_DRAFT = ".part"
_ATTEMPTS = 5  # a job that is removed while its files are copied
_DAY_S = 86_400.0
_STAMP = "%Y%m%dT%H%M%SZ"


class BackupError(NeedlebenchError):
    """A backup cannot be made or used; says why."""


@dataclass(frozen=True, kw_only=True)
class Backup:
    """What a backup holds. files: names within a data folder and sizes, bytes. with_files: whether they are in it.

    left_out: files that had another size than the database says.
    """

    folder: Path
    created_at: float
    files: dict[str, int]
    with_files: bool
    left_out: tuple[str, ...] = ()

    @property
    def bytes(self) -> int:
        """Of the files."""
        return sum(self.files.values())


def take_backup(data: Path, folder: Path, *, with_files: bool, now: float) -> Backup:
    """Back up the data folder `data` to `folder`, which must not be there yet; a service may work on it meanwhile.

    with_files: results, recordings and uploads too, else the database alone. now: UTC seconds since 1970.
    Raises BackupError, OSError.
    """
    if not (data / DATABASE).is_file():
        raise BackupError(f"{data} holds no database: there is nothing to back up")
    if folder.exists():
        raise BackupError(f"{folder} is there already: name another")
    draft = folder.with_name(f".{folder.name}{_DRAFT}")
    for _ in range(_ATTEMPTS):
        shutil.rmtree(draft, ignore_errors=True)
        draft.mkdir(parents=True)
        draft.chmod(0o700)
        files = _snapshot(data / DATABASE, draft / DATABASE)
        left_out = _copy_all(data, draft, files) if with_files else ()
        if left_out is not None:
            break
    else:
        raise BackupError("jobs were removed all the time while their files were copied: try again")
    files = {name: size for name, size in files.items() if name not in left_out}
    contents = {"format": 1, "created_at": now, "with_files": with_files, "files": files}
    _write(draft / CONTENTS, json.dumps(contents, indent=1))
    _sync_folder(draft)
    draft.rename(folder)
    _sync_folder(folder.parent)
    return Backup(folder=folder, created_at=now, files=files, with_files=with_files, left_out=left_out)


def read_backup(folder: Path) -> Backup:
    """What is in a backup. Raises BackupError when it is none, or not whole."""
    try:
        contents: dict[str, Any] = json.loads((folder / CONTENTS).read_bytes())
        files = {str(name): int(size) for name, size in contents["files"].items()}
        backup = Backup(
            folder=folder, created_at=float(contents["created_at"]), files=files, with_files=contents["with_files"]
        )
    except (OSError, ValueError, TypeError, LookupError, AttributeError) as error:
        raise BackupError(f"{folder} is no backup: {CONTENTS}: {error}") from None
    if any(Path(name).is_absolute() or ".." in Path(name).parts for name in files):
        raise BackupError(f"{folder} is no backup: it names files outside of a data folder")
    try:
        check_whole(folder / DATABASE)
    except (DamagedDatabaseError, sqlite3.Error) as error:
        raise BackupError(f"the database of the backup {folder} cannot be used: {error}") from None
    if backup.with_files and (wrong := _missing(folder, files)):
        raise BackupError(f"the backup {folder} is not whole: {len(wrong)} files are missing or cut, as {wrong[0]}")
    return backup


def restore_backup(backup: Backup, data: Path, *, now: float) -> tuple[Path | None, list[str]]:
    """Put a backup in the place of a folder's database, and the files that are missing there; nothing may run on it.

    The database that was there is kept. Returns where, and which files the restored one names that are nowhere. A kill
    leaves the old state or one that is refused until this is done again.
    """
    data.mkdir(parents=True, exist_ok=True)
    if backup.with_files:
        for name in _missing(data, backup.files):
            _copy(backup.folder / name, data / name)
    draft = data / f".{DATABASE}{_DRAFT}"
    shutil.copyfile(backup.folder / DATABASE, draft)
    _sync_file(draft)
    kept = _set_aside(data, now)
    draft.replace(data / DATABASE)
    accept_as_it_is(data / DATABASE)
    _sync_folder(data)
    return kept, _missing(data, backup.files)


def _set_aside(data: Path, now: float) -> Path | None:
    """Keep the database that is there. Its log goes first: with another database it would be taken for part of that."""
    present = data / DATABASE
    if not present.exists():
        for name in (f"{DATABASE}-wal", f"{DATABASE}-shm"):
            (data / name).unlink(missing_ok=True)
        return None
    kept = data / BACKUPS / f"replaced-{time.strftime(_STAMP, time.gmtime(now))}"
    kept.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(present, kept / DATABASE)
    _sync_file(kept / DATABASE)
    for name in (f"{DATABASE}-wal", mark_of(present).name):
        if (data / name).exists():
            shutil.copyfile(data / name, kept / name)
    mark = Mark(present)
    mark.keep(UNFINISHED)
    mark.close()
    for name in (f"{DATABASE}-wal", f"{DATABASE}-shm"):
        (data / name).unlink(missing_ok=True)
    _sync_folder(data)
    return kept


def daily_backup(data: Path, keep: int, *, now: float) -> Path | None:
    """The database's backup of the day, unless the last one is younger than that; all but the newest `keep` go.

    Returns its folder if one was made.
    """
    folder = data / BACKUPS
    present = sorted(path for path in folder.glob(f"{DAILY}*") if path.is_dir())
    made = None
    name = f"{DAILY}{time.strftime(_STAMP, time.gmtime(now))}"
    day_before = f"{DAILY}{time.strftime(_STAMP, time.gmtime(now - _DAY_S))}"
    if not any(day_before < path.name <= name for path in present):
        for left in folder.glob(f".{DAILY}*{_DRAFT}"):
            shutil.rmtree(left, ignore_errors=True)
        made = take_backup(data, folder / name, with_files=False, now=now).folder
        present.append(made)
    for old in present[: max(0, len(present) - keep)]:
        shutil.rmtree(old, ignore_errors=True)
    return made


def _snapshot(source: Path, target: Path) -> dict[str, int]:
    """Copy a database that may be in use; the files that the copy names, with their sizes. Raises BackupError."""
    try:
        return _copied(source, target)
    except sqlite3.Error as error:
        raise BackupError(f"the database {source} cannot be copied: {error}") from None


def _copied(source: Path, target: Path) -> dict[str, int]:
    with closing(sqlite3.connect(source)) as live, closing(sqlite3.connect(target)) as copy:
        live.execute("PRAGMA busy_timeout = 10000")
        live.backup(copy)
        copy.execute("PRAGMA journal_mode = DELETE")  # one file, without a log beside it
        files = dict(copy.execute("SELECT path, bytes FROM artefact").fetchall())
        files |= dict(copy.execute("SELECT 'uploads/' || id, bytes FROM upload").fetchall())
    _sync_file(target)
    return files


def _copy_all(data: Path, draft: Path, files: dict[str, int]) -> tuple[str, ...] | None:
    """Which have not the size that the database says and were left out; None if one was not there."""
    left_out = []
    for name, size in files.items():
        try:
            _copy(data / name, draft / name)
        except FileNotFoundError:
            return None
        if (draft / name).stat().st_size != size:
            (draft / name).unlink()
            left_out.append(name)
    return tuple(left_out)


def _missing(folder: Path, files: dict[str, int]) -> list[str]:
    """Those that are not there in their size."""
    return [
        name for name, size in files.items() if not (folder / name).is_file() or (folder / name).stat().st_size != size
    ]


def _copy(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    draft = target.with_name(f".{target.name}{_DRAFT}")
    shutil.copyfile(source, draft)
    _sync_file(draft)
    draft.replace(target)


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")
    _sync_file(path)


def _sync_file(path: Path) -> None:
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def _sync_folder(path: Path) -> None:
    if os.name == "nt":
        return
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
