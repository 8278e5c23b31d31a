"""Runners for the tests of `run_many`: a scenario's name says what becomes of it."""

from __future__ import annotations

import os
import signal
import time
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pathlib import Path


def insertion(spec: dict[str, Any], folder: Path) -> dict[str, Any]:
    """`ok`, `raises`, `dies`, `dies-once` (and leaves a mark), `sleeps`; each counts its attempts in a file."""
    name = spec["scenario"]["name"]
    marks = folder / f"{spec['job_id']}.attempts"
    attempts = int(marks.read_text()) + 1 if marks.exists() else 1
    marks.write_text(str(attempts))
    if name == "raises":
        raise ValueError("no good")
    if name == "dies" or (name == "dies-once" and attempts == 1):
        os.kill(os.getpid(), signal.SIGKILL)
    if name == "sleeps":
        time.sleep(600)
    return {"status": "completed", "metrics": {"stable": True, "success": True}, "digest": "d", "pid": os.getpid()}


def warm_up() -> None:
    """Nothing to compile."""
