"""Wakes coroutines of the server that wait for a job to change."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from contextlib import contextmanager

EVERYTHING = ""  # watched by those who want to hear of every job


class Changes:
    """A notice board: any thread says that a job changed, coroutines wait for it. Holds no state of its own."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._waiting: dict[str, list[tuple[asyncio.AbstractEventLoop, asyncio.Event]]] = {}
        self._closed = False

    @property
    def closed(self) -> bool:
        """Whether the server is going down: nobody should wait any longer."""
        return self._closed

    def notify(self, job_id: str) -> None:
        """Wake everybody who waits for this job, or for any. From any thread."""
        with self._lock:
            waiting = [*self._waiting.get(job_id, ()), *self._waiting.get(EVERYTHING, ())]
        self._wake(waiting)

    def close(self) -> None:
        """Wake everybody, for good."""
        with self._lock:
            self._closed = True
            waiting = [entry for entries in self._waiting.values() for entry in entries]
        self._wake(waiting)

    @staticmethod
    def _wake(waiting: list[tuple[asyncio.AbstractEventLoop, asyncio.Event]]) -> None:
        for loop, event in waiting:
            if not loop.is_closed():
                loop.call_soon_threadsafe(event.set)

    @contextmanager
    def watch(self, job_id: str) -> Iterator[asyncio.Event]:
        """An event that is set by each change of the job, or of any job. Begin watching before reading the job."""
        entry = (asyncio.get_running_loop(), asyncio.Event())
        with self._lock:
            self._waiting.setdefault(job_id, []).append(entry)
        try:
            yield entry[1]
        finally:
            with self._lock:
                self._waiting[job_id].remove(entry)
                if not self._waiting[job_id]:
                    del self._waiting[job_id]
