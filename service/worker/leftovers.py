"""What a job left in its process: whoever did not clean up after himself must not meet the next job."""

from __future__ import annotations

import os
import signal
import sys
import threading
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from service.worker.guard import guard_pid
from service.worker.processes import Process, descendants, end_descendants

_OF_LIBRARIES = ("KMP_DUPLICATE_LIB_OK", "KMP_INIT_AT_FORK")  # that scikit-learn and joblib set when they are imported


@dataclass(frozen=True)
class Belongings:
    """What this process holds. processes: that it has started. threads: those of Python. descriptors: number and what
    it leads to. settings: of the whole process, by name: what any code in it may change for all that comes after."""

    processes: frozenset[Process]
    threads: frozenset[threading.Thread]
    descriptors: frozenset[tuple[str, str]]
    settings: tuple[tuple[str, str], ...]

    @classmethod
    def now(cls) -> Self:
        """At this moment; without descriptors where the system does not tell them."""
        started = frozenset(descendants(os.getpid()))
        return cls(started, frozenset(threading.enumerate()), frozenset(_descriptors()), tuple(_settings().items()))


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
        left += [f"another {name}" for name, value in after.settings if (name, value) not in before.settings]
    return tuple(one for one in left if one)


def _settings() -> dict[str, str]:
    """What holds for this whole process, each as text that differs when it does."""
    streams = (sys.stdin, sys.stdout, sys.stderr, sys.__stdout__, sys.__stderr__, sys.excepthook, sys.unraisablehook)
    numbers = set(signal.Signals) - {signal.SIGTERM}  # which belongs to the attempt
    found = {
        "folder": _folder(),
        "environment": str(hash(frozenset(one for one in os.environ.items() if one[0] not in _OF_LIBRARIES))),
        "stream or hook": str([id(one) for one in streams]),
        "signal handler": str([(number, id(signal.getsignal(number))) for number in sorted(numbers)]),
        "trace": str((id(sys.gettrace()), id(sys.getprofile()))),
        "path of modules": str(sys.path),
    }
    if hasattr(signal, "getitimer"):
        found["alarm"] = str(signal.getitimer(signal.ITIMER_REAL)[0] > 0)
    if sys.platform != "win32":
        import resource

        limits = [getattr(resource, name) for name in sorted(dir(resource)) if name.startswith("RLIMIT_")]
        found["limit"] = str([resource.getrlimit(limit) for limit in limits])
        mask = os.umask(0o77)
        os.umask(mask)
        found["file mode mask"] = str(mask)
    return found


def _folder() -> str:
    try:
        return str(Path.cwd())
    except OSError:  # it was removed
        return ""


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
