"""Whether a file is still what was written: its length, and its digest unless nothing has touched it since a look."""

from __future__ import annotations

import hashlib
import threading
import time
from collections import OrderedDict
from typing import TYPE_CHECKING

from simcore.errors import NeedlebenchError

if TYPE_CHECKING:
    from pathlib import Path

_SETTLED_S = 2.0  # since the last change, from when on a later change has another time
_MOST = 2000  # files of which the last look is remembered


class DamagedFileError(NeedlebenchError):
    """A file that is not what its digest says."""


class IntactFiles:
    """Looks at files before they are served. One that was read through is read again only after a change."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._seen: OrderedDict[tuple[str, str], tuple[int, int, int]] = OrderedDict()

    def check(self, path: Path, *, sha256: str, size: int) -> None:
        """Raises DamagedFileError unless the file has this length and digest; OSError."""
        found = path.stat()
        if found.st_size != size:
            raise DamagedFileError(f"{path.name} has {found.st_size} bytes, and was written with {size}: it is damaged")
        mark = (found.st_size, found.st_mtime_ns, found.st_ino)
        key = (str(path), sha256)
        with self._lock:
            if self._seen.get(key) == mark:
                self._seen.move_to_end(key)
                return
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        if digest != sha256:
            raise DamagedFileError(f"{path.name} is not what was written: its SHA-256 is {digest}")
        if time.time() - found.st_mtime < _SETTLED_S:
            return  # a change within the same tick of the clock would not be seen
        with self._lock:
            self._seen[key] = mark
            if len(self._seen) > _MOST:
                self._seen.popitem(last=False)
