"""Runners for the tests of clusters: a scenario's name says what becomes of it; marks are left in its `files`."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import Any


def insertion(spec: dict[str, Any], folder: Path) -> dict[str, Any]:
    """`ok`, `raises`, `dies`, `dies-once`, `waits` (0.3 s), `held` (until a file `go` is there), `alike` (the series of
    all are the same)."""
    name, marks = spec["scenario"]["name"], Path(spec["files"])
    with (marks / f"{spec['job_id']}.begun").open("a") as file:
        file.write(f"{os.getpid()}\n")
    begun = len((marks / f"{spec['job_id']}.begun").read_text().splitlines())
    if name == "raises":
        raise ValueError("no good")
    if name == "dies" or (name == "dies-once" and begun == 1):
        os.kill(os.getpid(), signal.SIGKILL)
    if name == "waits":
        time.sleep(0.3)
    while name == "held" and not (marks / "go").exists():
        time.sleep(0.05)
    content = "all alike" if name == "alike" else f"series of {spec['job_id']}"
    (folder / f"{spec['job_id']}.npz").write_text(content)
    return {"status": "completed", "metrics": {"stable": True, "success": True}, "digest": "d", "pid": os.getpid()}


def five_milliseconds(spec: dict[str, Any], folder: Path) -> dict[str, Any]:
    """A task of 5 ms."""
    time.sleep(0.005)
    return {"status": "completed"}


def warm_up() -> None:
    """Nothing to compile."""
