"""A runner whose jobs leave things behind, as a scenario's name says; the ids of what they started are in `pids`."""

from __future__ import annotations

import io
import os
import resource
import signal
import sys
import threading
import time
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pathlib import Path

_kept: list[Any] = []


def insertion(spec: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Do what the name of the scenario says, then end as any other; `... and exits` ends the process instead."""
    name = spec["scenario"]["name"]
    _ACTIONS[name.removesuffix(" and exits")](folder)
    if name.endswith(" and exits"):
        os._exit(0)
    return {"status": "completed", "pid": os.getpid()}


def warm_up() -> None:
    """Nothing to compile."""


def _fork(folder: Path, *, apart: bool = False, hoards_mb: int = 0) -> None:
    """A child that stays; apart: of its own session, with another one between that ends at once."""
    pid = os.fork()
    if pid and apart:
        os.waitpid(pid, 0)
    if pid:
        while not (folder / "pids").exists():
            time.sleep(0.01)
        return
    if apart:
        os.setsid()
        if os.fork():
            os._exit(0)
    hoard = os.urandom(hoards_mb << 20)
    (folder / "pids.new").write_text(str(os.getpid()))
    (folder / "pids.new").rename(folder / "pids")
    time.sleep(600)
    os._exit(len(hoard) % 2)


def _hoard(folder: Path) -> None:
    _fork(folder, hoards_mb=400)
    time.sleep(600)


def _fork_and_wait(folder: Path) -> None:
    _fork(folder, apart=True)
    time.sleep(600)


def _thread(_folder: Path) -> None:
    threading.Thread(target=time.sleep, args=(600,), daemon=True).start()


def _flood(_folder: Path) -> None:
    block = (b"x" * 99 + b"\n") * 10_000
    for _ in range(40):
        os.write(1, block)


def _say(_folder: Path) -> None:
    os.write(1, b"by descriptor\n")
    os.write(2, b"in error")
    print("by Python, without an end", end="")


def _descriptor(folder: Path) -> None:
    _kept.append((folder / "kept").open("w"))


def _ignore_signals(_folder: Path) -> None:
    signal.signal(signal.SIGUSR1, signal.SIG_IGN)


def _replace_output(_folder: Path) -> None:
    sys.stdout = io.StringIO()


class _Hostile:
    """Raises where it is looked at, and where it ends."""

    def __repr__(self) -> str:
        raise SystemExit(4)

    __str__ = __repr__

    def __del__(self) -> None:
        raise RuntimeError("in its end")


def _hostile_error(_folder: Path) -> None:
    raise ValueError(_Hostile())


_ACTIONS: dict[str, Any] = {
    "nothing": lambda _folder: None,
    "forks": _fork,
    "forks apart": lambda folder: _fork(folder, apart=True),
    "forks apart and waits": _fork_and_wait,
    "hoards in a child": _hoard,
    "thread": _thread,
    "folder": lambda folder: os.chdir(folder),
    "environment": lambda _folder: os.environ.update(LEFT="behind"),
    "signals": _ignore_signals,
    "output": _replace_output,
    "mask": lambda _folder: os.umask(0),
    "alarm": lambda _folder: signal.setitimer(signal.ITIMER_REAL, 500),
    "limit": lambda _folder: resource.setrlimit(resource.RLIMIT_CORE, (0, 0)),
    "modules": lambda folder: sys.path.insert(0, str(folder)),
    "closes": lambda _folder: os.close(1),
    "hostile": _hostile_error,
    "descriptor": _descriptor,
    "floods": _flood,
    "says": _say,
}
