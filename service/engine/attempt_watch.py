"""What a slot looks at while an attempt runs: when its progress is published, and when it must be ended.

Nothing here waits, reads a clock or starts a thread: the slot's loop does, and hands in what it saw.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

from service.logs import ROOT
from service.store.errors import SQLAlchemyError
from service.store.job import CANCELLED, FAILED, TIMED_OUT, Job
from service.worker.progress import INTERVAL_S

if TYPE_CHECKING:
    from service.engine.attempt_trace import AttemptTrace

BEAT_S = 10.0  # between two stored heartbeats of an attempt without news
_log = logging.getLogger(ROOT)


@dataclass(frozen=True)
class Ending:
    """Why an attempt must end: the state that it ends in, and kind and message of the error, if it is one."""

    state: str
    error_kind: str | None = None
    error: str | None = None


@dataclass
class AttemptWatch:
    """What may become of one attempt. Times are seconds of one clock that never goes back.

    begun_s: now, at its beginning. timeout_s: wall time it may take. memory_mb: what its worker may hold, 10^6 bytes.
    """

    begun_s: float
    timeout_s: float
    memory_mb: float
    _published: dict[str, Any] | None = field(default=None, init=False)
    _published_s: float = field(init=False)
    _beat_s: float = field(init=False)

    def __post_init__(self) -> None:
        self._beat_s = self.begun_s
        self._published_s = self.begun_s  # who looks within the first half second finds it running, which is enough

    def due(self, now_s: float, progress: dict[str, Any] | None) -> dict[str, Any] | None:
        """The progress, if it is to be published now: it has changed, and the last time was half a second ago."""
        if progress is None or progress == self._published or now_s - self._published_s < INTERVAL_S:
            return None
        self._published, self._published_s = progress, now_s
        self._beat_s = now_s
        return progress

    def beats(self, now_s: float) -> bool:
        """Whether the heartbeat is to be stored now: nothing was for ten seconds."""
        if now_s - self._beat_s < BEAT_S:
            return False
        self._beat_s = now_s
        return True

    def ending(self, now_s: float, *, cancelled: bool, held_mb: float | None, where: str = "") -> Ending | None:
        """Why it must end now; None when it may go on. held_mb: of its worker, None where the system does not say.
        where: how far it was, for the message."""
        if cancelled:
            return Ending(CANCELLED)
        if now_s - self.begun_s > self.timeout_s:
            return Ending(TIMED_OUT, "timed_out", f"it did not end within timeout_s = {self.timeout_s:g}{where}")
        if held_mb is not None and held_mb > self.memory_mb:
            return Ending(FAILED, "out_of_memory", f"it held {held_mb:.0f} MB, at most {self.memory_mb} are allowed")
        return None


class ProgressStore(Protocol):
    """The part of the store that a running attempt needs."""

    def beat(self, job: Job, progress: dict[str, Any] | None = None) -> None:
        """Store that a running attempt is looked after, and its progress."""

    def cancel_requested(self, job_id: str) -> bool:
        """Whether somebody wants the job to stop."""


def publish_progress(
    store: ProgressStore,
    trace: AttemptTrace,
    job: Job,
    due: dict[str, Any] | None,
    *,
    beats: bool = False,
    asks: bool = True,
) -> bool:
    """Store the progress that is due, if any is, or that the attempt is looked after; whether it is to be cancelled.

    asks: whether to look for a request to cancel it, which costs more than all else here.
    A database that refuses (full disk, lock) is logged: the job goes on, and the next call tries again.
    """
    try:
        if due is not None:
            trace.add(job, due)
            store.beat(job, due)
        elif beats:
            store.beat(job)
        return asks and store.cancel_requested(job.id)
    except SQLAlchemyError as error:
        _log.warning("job %s: %s", job.id, error)
        return False
