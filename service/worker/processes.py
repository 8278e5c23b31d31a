"""The processes of this machine that belong to a worker, as the process table tells them (Linux; elsewhere none)."""

from __future__ import annotations

import os
import signal
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Collection

_ROUNDS = 50  # of killing: each finds what was forked during the one before
_PAUSE_S = 0.01


@dataclass(frozen=True)
class Process:
    """A process, told from a later one of the same number by when it began (clock ticks since the machine did)."""

    pid: int
    began: int


def descendants(pid: int) -> list[Process]:
    """All processes that a process started, directly or not, zombies apart; parents before their children."""
    found: list[Process] = []
    waiting = [pid]
    while waiting:
        for child in _children(waiting.pop()):
            if (stat := _stat(child)) is not None and stat[0] != "Z":
                found.append(Process(child, int(stat[19])))
            waiting.append(child)
    return found


def session_members(leader: int) -> list[Process]:
    """The processes of a session, whatever became of its leader; zombies apart."""
    found = []
    for path in Path("/proc").glob("[0-9]*"):
        stat = _stat(int(path.name))
        if stat is not None and int(stat[3]) == leader and stat[0] != "Z":
            found.append(Process(int(path.name), int(stat[19])))
    return found


def end_process(process: Process) -> None:
    """Kill it, unless it is gone already."""
    stat = _stat(process.pid)
    if stat is not None and int(stat[19]) == process.began:
        with suppress(ProcessLookupError, PermissionError):
            os.kill(process.pid, signal.SIGKILL)


def end_descendants(pid: int, *, spared: Collection[int] = ()) -> int:
    """Kill whatever a process has started, until none of it lives; how many there were. spared: not these pids."""
    ended: set[Process] = set()
    for _ in range(_ROUNDS):
        living = [process for process in descendants(pid) if process.pid not in spared]
        if not living:
            break
        for process in living:  # stopped first: none of them starts another one meanwhile
            with suppress(ProcessLookupError, PermissionError):
                os.kill(process.pid, signal.SIGSTOP)
        for process in living:
            end_process(process)
        ended |= set(living)
        _reap(pid, spared)
        time.sleep(_PAUSE_S)
    _reap(pid, spared)
    return len(ended)


def _reap(pid: int, spared: Collection[int]) -> None:
    """Take note of the ends of this process's own children."""
    if pid != os.getpid():
        return
    for child in _children(pid):
        if child not in spared:
            with suppress(ChildProcessError):
                os.waitpid(child, os.WNOHANG)


def _children(pid: int) -> list[int]:
    found: list[int] = []
    with suppress(OSError):
        for task in os.listdir(f"/proc/{pid}/task"):  # noqa: PTH208  (looked at several times a second)
            with suppress(OSError), open(f"/proc/{pid}/task/{task}/children", "rb") as file:  # noqa: PTH123
                found += map(int, file.read().split())
    return found


def _stat(pid: int) -> list[str] | None:
    """The fields of its state, the first of which is R, S, Z, ...; None when it is gone."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except (OSError, ValueError):
        return None
