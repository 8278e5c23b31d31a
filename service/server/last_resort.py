"""Ends the process however long something in it takes: a stop is bounded, and loses nothing that is in the store."""

from __future__ import annotations

import logging
import os
import sys
import threading
import time
import traceback
from pathlib import Path
from typing import TYPE_CHECKING

from service.logs import ROOT

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

STOP_S = 20.0  # from the end of the draining to that of the process, at most
_log = logging.getLogger(ROOT)


class LastResort:
    """What happens to a process that does not end within its time: it says what it is at, and ends.

    Jobs that still run by then are found by the next start, and their workers end with this process.
    seconds: how long it waits from `begin` on. end: what ends the process at once.
    """

    def __init__(self, seconds: float, *, end: Callable[[], None] = lambda: os._exit(0)) -> None:
        self._seconds, self._end = seconds, end
        self._before = frozenset(threading.enumerate())
        self._begun_s: float | None = None
        self._over = threading.Event()

    def begin(self) -> None:
        """From now on the time counts. From any thread, any number of times."""
        if self._begun_s is None:
            self._begun_s = time.monotonic()
            threading.Thread(target=self._wait, name="last-resort", daemon=True).start()

    def join_threads(self) -> None:
        """Wait for the threads that the interpreter would wait for at its end, and began since; then nothing is left
        to be bounded."""
        for thread in set(threading.enumerate()) - self._before:
            if not thread.daemon and thread is not threading.current_thread():
                thread.join()
        self._over.set()

    def _wait(self) -> None:
        if self._over.wait(self._seconds):
            return
        _log.warning("not everything ended within %g s: %s", self._seconds, "; ".join(_at_work(self._before)))
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        self._end()


def _at_work(without: Collection[threading.Thread]) -> list[str]:
    """What the threads are at that began since, one line each."""
    frames = sys._current_frames()  # noqa: SLF001  (documented, and the only way)
    told = []
    for thread in threading.enumerate():
        frame = frames.get(thread.ident or 0)
        if thread is threading.current_thread() or frame is None or (thread.daemon and thread in without):
            continue
        place = traceback.extract_stack(frame)[-1]
        told.append(f"{thread.name} in {place.name} ({Path(place.filename).name}:{place.lineno})")
    return told
