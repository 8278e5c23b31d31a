"""A package of a controller that misbehaves as its settings say, laid down as pip would install it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simcore.plugins import GROUP

if TYPE_CHECKING:
    from pathlib import Path

NAME = "misbehaves"
_MODULE = """
import ctypes, os, sys, threading, time


def fork(apart=False):
    if os.fork():
        return
    if apart:
        os.setsid()
        if os.fork():
            os._exit(0)
    time.sleep(3600)


def fork_many():
    for _ in range(30):
        fork()


def flood():
    block = (b"x" * 99 + b"\\n") * 10_000
    for _ in range(200):
        os.write(1, block)
        os.write(2, block)


def flood_without_lines():
    for _ in range(2000):
        print("x" * 100_000, end="")


ACTIONS = {
    "nothing": lambda: None,
    "raises": lambda: 1 / 0,
    "exits": lambda: sys.exit(3),
    "ends its process": lambda: os._exit(0),
    "kills itself": lambda: os.kill(os.getpid(), 9),
    "kills its group": lambda: os.killpg(0, 9),
    "forks": fork,
    "forks apart": lambda: fork(apart=True),
    "forks many": fork_many,
    "forks and ends its process": lambda: (fork(), os._exit(3)),
    "leaves a thread": lambda: threading.Thread(target=time.sleep, args=(3600,), daemon=True).start(),
    "leaves files open": lambda: globals().setdefault("kept", []).extend(open(__file__) for _ in range(50)),
    "closes everything": lambda: os.closerange(0, 3),
    "floods": flood,
    "floods without lines": flood_without_lines,
    "hangs": lambda: time.sleep(3600),
    "hangs in C": lambda: ctypes.PyDLL(None).sleep(3600),
}


class Misbehaves:
    def __init__(self, scenario, entry_m, needle_length_m, settings):
        self.does = settings["does"]

    def command(self, observation):
        if observation.step == 3:
            ACTIONS[self.does]()
        return observation.base
"""

FAILS = ("exits", "ends its process", "kills itself", "kills its group", "forks and ends its process")
HANGS = ("hangs", "hangs in C")
LEAVES = ("forks", "forks apart", "forks many", "leaves a thread", "leaves files open")
OTHERS = ("nothing", "raises", "closes everything", "floods", "floods without lines")
ALL = (*FAILS, *HANGS, *LEAVES, *OTHERS)
SHORT = ("ends its process", "forks apart", "leaves files open", "floods", "hangs in C")


def install(folder: Path, name: str = NAME) -> Path:
    """Into a folder that is then to be on the path of every process; the folder."""
    info = folder / f"{name}-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[{GROUP}]\n{name} = {name}_package:Misbehaves\n")
    (folder / f"{name}_package.py").write_text(_MODULE)
    return folder
