"""An exclusive lock on a file: one engine a data folder, one warming worker at a time."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from simcore.errors import NeedlebenchError

_POLL_S = 0.05


class LockHeldError(NeedlebenchError):
    """Another process holds the lock; the message is what it wrote about itself, or empty."""


@contextmanager
def file_lock(path: Path, *, wait: bool = False) -> Iterator[None]:
    """Hold the lock on `path`; the system releases it when the process ends, however it ends.

    Raises LockHeldError unless `wait`.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    # preserve_lock_file: never a lock that is only a file which exists; a killed process would leave it behind
    lock = FileLock(path, poll_interval=_POLL_S, preserve_lock_file=True)
    try:
        lock.acquire(blocking=wait)
    except Timeout:
        raise LockHeldError(_holder(path)) from None
    try:
        if os.name != "nt":  # Windows locks are mandatory: nobody could read it
            path.write_text(f"process {os.getpid()}\n", encoding="utf-8")
        yield
    finally:
        lock.release()


def _holder(path: Path) -> str:
    return "" if os.name == "nt" else path.read_text(encoding="utf-8", errors="replace").strip()
