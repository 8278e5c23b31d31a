"""A small process beside each worker: writes what a job prints by descriptor into its log, and ends the worker's group.

It is forked before anything else happens in the worker, and needs nothing of it afterwards: neither code that keeps the
interpreter's lock nor a kill of the worker keeps it from its work. Where there is no fork (Windows) there is no guard.
"""

from __future__ import annotations

import ctypes
import os
import select
import signal
import socket
import sys
import time
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from service.logs import FULL, MAXIMUM_BYTES, moment

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_PR_SET_CHILD_SUBREAPER = 36
_PATIENCE_S = 2.0  # for what a job printed last to be in its log
_LOOK_S = 1.0  # between two looks at the parent, where the system does not announce its end
_CHUNK = 1 << 16
_guard: Guard | None = None


@dataclass(frozen=True)
class Guard:
    """The guard of this process. pid: its own; control: what it has to read comes by it, and its answer at the end."""

    pid: int
    control: socket.socket


def lead_group() -> None:
    """Make this process the first of a session of its own, which ends with it, and start its guard.

    Processes whose parents die meanwhile become children of this one (Linux), so that none of them is lost sight of.
    """
    global _guard
    if not hasattr(os, "fork"):
        return
    os.setsid()
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_CHILD_SUBREAPER, 1)
    _closed_input()
    ours, theirs = socket.socketpair()
    worker = os.getpid()
    try:
        pid = os.fork()
    except OSError:  # no more processes: descriptors stay as they are
        ours.close()
        theirs.close()
        return
    if pid == 0:
        _be_guard(theirs, worker)
    theirs.close()
    _guard = Guard(pid, ours)


def guard_pid() -> int | None:
    """Of the guard of this process, if it has one."""
    return None if _guard is None else _guard.pid


@dataclass
class Capture:
    """whole: whether all that was written by descriptor is in the log; else somebody still holds the other end."""

    whole: bool = field(default=True)


@contextmanager
def captured_descriptors(log: Path) -> Iterator[Capture]:
    """Within, what this process and its children write to descriptors 1 and 2 becomes lines of the log, bounded.

    Without a guard nothing is changed.
    """
    capture = Capture()
    guard = _guard
    if guard is None:
        yield capture
        return
    _drop_answers(guard)
    _flush()
    saved = [os.dup(number) for number in (1, 2)]
    try:
        _hand_over(guard, log)
        yield capture
    finally:
        _flush()
        for number, before in zip((1, 2), saved, strict=True):
            os.dup2(before, number)
            os.close(before)
        capture.whole = _answered(guard)


def _hand_over(guard: Guard, log: Path) -> None:
    """Point descriptors 1 and 2 into a pipe that the guard reads."""
    read, write = os.pipe()
    target = os.open(log, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o600)
    try:
        socket.send_fds(guard.control, [b"log"], [read, target])
        os.dup2(write, 1)
        os.dup2(write, 2)
    finally:
        for number in (read, write, target):
            os.close(number)


def _answered(guard: Guard) -> bool:
    try:
        if select.select([guard.control], [], [], _PATIENCE_S)[0]:
            return guard.control.recv(1) == b"."
    except OSError:
        pass
    return False


def _drop_answers(guard: Guard) -> None:
    """Late ones, of an attempt before."""
    with suppress(OSError):
        while select.select([guard.control], [], [], 0)[0] and guard.control.recv(1):
            pass


def _flush() -> None:
    """What C and Python hold back for descriptors 1 and 2."""
    for stream in (sys.__stdout__, sys.__stderr__):
        with suppress(OSError, ValueError, AttributeError):
            stream.flush()  # type: ignore[union-attr]
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).fflush(None)


def _closed_input() -> None:
    """Nobody answers questions here."""
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)


# -- in the guard


def _be_guard(control: socket.socket, worker: int) -> None:
    """Never returns: ends the worker's whole group once the worker has ended, this process with it."""
    try:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        _keep_only(control.fileno())
        _guard_loop(control, worker)
    finally:
        with suppress(OSError):
            os.killpg(worker, signal.SIGKILL)
        os._exit(0)


def _keep_only(kept: int) -> None:
    """Close whatever else the worker had open: its end must be seen by who waits for it."""
    nothing = os.open(os.devnull, os.O_RDWR)
    for number in (0, 1, 2):
        os.dup2(nothing, number)
    most = os.sysconf("SC_OPEN_MAX") if hasattr(os, "sysconf") else 1024
    os.closerange(3, kept)
    os.closerange(kept + 1, min(most, 1 << 16))


def _guard_loop(control: socket.socket, worker: int) -> None:
    """Until the worker ends: read what is written to the pipe that was handed over last."""
    end = _end_of(worker)
    output: _Output | None = None
    while os.getppid() == worker:
        watched: list[Any] = [control, *([end] if end is not None else []), *([output.read] if output else [])]
        ready = select.select(watched, [], [], None if end is not None else _LOOK_S)[0]
        if end is not None and end in ready:
            return
        if control in ready:
            _, numbers, _, _ = socket.recv_fds(control, 16, 2)
            if output is not None:
                output.close()
            output = _Output(*numbers) if len(numbers) == 2 else None
            if output is None:
                return
        elif output is not None and output.read in ready and not output.take():
            output.close()
            output = None
            control.send(b".")


def _end_of(worker: int) -> int | None:
    """A descriptor that can be read once the process has ended; None where the system has none."""
    try:
        return os.pidfd_open(worker)  # type: ignore[attr-defined,unused-ignore]
    except (AttributeError, OSError):
        return None


class _Output:
    """A pipe, and the log that its lines are written to as far as that has room."""

    def __init__(self, read: int, log: int) -> None:
        self.read, self._log = read, log
        self._rest = b""
        self._full = False

    def take(self) -> bool:
        """Read once; False at the end."""
        try:
            chunk = os.read(self.read, _CHUNK)
        except OSError:
            chunk = b""
        *lines, self._rest = (self._rest + chunk).split(b"\n")
        if self._rest and (not chunk or len(self._rest) > _CHUNK):
            lines.append(self._rest)
            self._rest = b""
        if lines and not self._full:
            self._write(lines)
        return bool(chunk)

    def _write(self, lines: list[bytes]) -> None:
        head = f"{moment(time.time())} INFO ".encode()
        text = b"".join(head + line + b"\n" for line in lines)
        with suppress(OSError):  # a full disk is no reason to stop a job
            self._full = os.fstat(self._log).st_size + len(text) > MAXIMUM_BYTES
            os.write(self._log, f"{FULL}\n".encode() if self._full else text)

    def close(self) -> None:
        """Both ends."""
        for number in (self.read, self._log):
            with suppress(OSError):
                os.close(number)
