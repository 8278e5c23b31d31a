"""How the service was lately: a bounded number of moments in memory, fine for the last hour, coarse for a day."""

from __future__ import annotations

import os
import time
from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

from service.files.disk import free_bytes
from service.worker.memory import available_mb, group_mb
from service.worker.processes import descendants

if TYPE_CHECKING:
    from collections.abc import Callable

    from service.engine.engine import Engine
    from service.settings import Settings
    from service.store.jobs import Store

EVERY_S = 10.0
FINE = 360  # moments: an hour
COARSE_EVERY = 30  # of the fine moments one is kept longer: every five minutes
COARSE = 288  # moments: a day


@dataclass(frozen=True, kw_only=True)
class Moment:
    """at: UTC seconds since 1970. busy, ready: workers. disk_free_gb, memory_mb of the service with its workers,
    available_mb of the machine: None where the system does not say; GB and MB are powers of ten."""

    at: float
    queued: int
    running: int
    busy: int
    ready: int
    disk_free_gb: float | None
    memory_mb: float | None
    available_mb: float | None


class History:
    """Looks every ten seconds when it is ticked more often. Read and ticked from any thread."""

    def __init__(self, look: Callable[[], Moment], *, clock: Callable[[], float] = time.monotonic) -> None:
        self._look, self._clock = look, clock
        self._fine: deque[Moment] = deque(maxlen=FINE)
        self._coarse: deque[Moment] = deque(maxlen=COARSE)
        self._next, self._count = clock(), 0

    def tick(self) -> None:
        """Keep the present moment if one is due."""
        if self._clock() < self._next:
            return
        self._next = self._clock() + EVERY_S
        moment = self._look()
        self._fine.append(moment)
        if self._count % COARSE_EVERY == 0:
            self._coarse.append(moment)
        self._count += 1

    def moments(self) -> list[Moment]:
        """Oldest first: the coarse ones, then the fine ones of the last hour."""
        fine = list(self._fine)
        begin = fine[0].at if fine else 0.0
        return [moment for moment in list(self._coarse) if moment.at < begin] + fine


def look_at(engine: Engine, store: Store, settings: Settings) -> Moment:
    """How it is now."""
    counts = store.counts()
    free = None
    with suppress(OSError):
        free = free_bytes(settings.data) / 1e9
    own = os.getpid()
    return Moment(
        at=store.now,
        queued=counts["queued"],
        running=counts["running"],
        busy=engine.busy,
        ready=engine.ready,
        disk_free_gb=free,
        memory_mb=group_mb(own, [process.pid for process in descendants(own)]),
        available_mb=available_mb(),
    )
