"""How much room the data folder has, and how little is too little."""

from __future__ import annotations

import errno
import os
import shutil
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

WARNED_BYTES = 2 * 2**30  # below: readiness and the page warn
MINIMUM_BYTES = 256 * 2**20  # below: no job is started; a long recording has some 100 MB
WARNED_FILES = 10_000  # that can still be made; below: readiness and the page warn
MINIMUM_FILES = 1_000  # below: no job is started; a job makes about ten
REFUSALS = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EROFS})  # of a disk that is full or read-only


def free_bytes(folder: Path) -> int:
    """What a user may still write to the disk of `folder`. Raises OSError."""
    return shutil.disk_usage(folder).free


def free_files(folder: Path) -> int | None:
    """How many more files (inodes) a user may make on the disk of `folder`; None where they are not counted.

    Raises OSError.
    """
    if not hasattr(os, "statvfs"):
        return None
    disk = os.statvfs(folder)
    return disk.f_favail if disk.f_files else None


def size_bytes(folder: Path) -> int:
    """What the files below `folder` hold; 0 when there is none."""
    return sum(path.stat(follow_symlinks=False).st_size for path in folder.rglob("*") if path.is_file())


def readable(count: float) -> str:
    """1536 -> '1.5 KB'."""
    for unit in ("bytes", "KB", "MB", "GB"):
        if abs(count) < 1024 or unit == "GB":
            break
        count /= 1024
    return f"{count:.0f} {unit}" if unit == "bytes" else f"{count:.1f} {unit}"
