"""Folders and files for the account that made them alone."""

from __future__ import annotations

import os
import stat
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

FOLDER, FILE = 0o700, 0o600


def private_folder(folder: Path) -> None:
    """Make the folder, or close it to other accounts. Raises OSError.

    One that belongs to somebody else, or that everybody may write to, as /tmp, is left as it is.
    """
    folder.mkdir(parents=True, exist_ok=True, mode=FOLDER)
    if os.name == "nt":
        return
    found = folder.stat()
    if found.st_uid == os.getuid() and not found.st_mode & stat.S_ISVTX and found.st_mode & 0o077:
        folder.chmod(FOLDER)


def private_file(path: Path) -> None:
    """Make an empty file that others cannot read, unless there is one. Raises OSError."""
    os.close(os.open(path, os.O_CREAT | os.O_WRONLY, FILE))


@contextmanager
def private_files() -> Iterator[None]:
    """Within, this process and those that it starts make files and folders that others cannot read."""
    before = os.umask(0o077)
    try:
        yield
    finally:
        os.umask(before)
