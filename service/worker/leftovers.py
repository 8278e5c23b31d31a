"""What a job left in its process: whoever did not clean up after himself must not meet the next job."""

from __future__ import annotations

import os
import sys
import threading
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from service.worker.guard import guard_pid
from service.worker.processes import Process, descendants, end_descendants


@dataclass(frozen=True)
class Belongings:
    """What this process holds. processes: that it has started. threads: those of Python. descriptors: number and what
    it leads to."""

    processes: frozenset[Process]
    threads: frozenset[threading.Thread]
    descriptors: frozenset[tuple[str, str]]

    @classmethod
    def now(cls) -> Self:
        """At this moment; without descriptors where the system does not tell them."""
        started = frozenset(descendants(os.getpid()))
        return cls(started, frozenset(threading.enumerate()), frozenset(_descriptors()))


def end_leftovers(before: Belongings, *, strict: bool) -> tuple[str, ...]:
    """End the processes that were started since, and say what was left, as in `2 processes`; nothing is best.

    strict: threads and descriptors are looked at too, which a process keeps; else processes alone.
    """
    known = {process.pid for process in before.processes} | {guard_pid() or 0}
    left = [_counted(end_descendants(os.getpid(), spared=known), "process", "processes")]
    if strict:
        after = Belongings.now()
        left.append(_counted(len(after.threads - before.threads), "thread", "threads"))
        left.append(_counted(len(after.descriptors - before.descriptors), "descriptor", "descriptors"))
    return tuple(one for one in left if one)


def _counted(count: int, one: str, several: str) -> str:
    return "" if not count else f"{count} {one if count == 1 else several}"


def _descriptors() -> list[tuple[str, str]]:
    folder = Path("/proc/self/fd" if sys.platform == "linux" else "/dev/fd")
    found = []
    with suppress(OSError):
        for path in folder.iterdir():
            with suppress(OSError):
                found.append((path.name, str(path.readlink()) if sys.platform == "linux" else ""))
    return [one for one in found if not one[1].endswith("/fd")]  # without that of this listing
