"""Looks after the slots: one that is gone or does not get on is replaced, its job goes back into the queue or fails.

Time is counted in looks, one a second, not read from a clock: a machine that slept, or a process that was stopped,
makes nobody late.
"""

from __future__ import annotations

import logging
import threading
from typing import TYPE_CHECKING

from service.logs import ROOT
from service.store.job import IllegalTransitionError
from service.worker.failures import described

if TYPE_CHECKING:
    from collections.abc import Callable

    from service.engine.slot import Slot
    from service.store.job import Job
    from service.store.jobs import Store

_log = logging.getLogger(ROOT)
LOOK_S = 1.0
SILENT_LOOKS = 60  # without a beat, after which readiness says so; the longest pause of a slot is 30 s
STALLED_LOOKS = 180  # after which the slot is replaced
ORPHANED_LOOKS = 5  # at which no slot answers for a running job; a slot does from a moment after it took one
MOST_ABANDONED = 8  # threads that are still there after their slots were replaced; above, no more are


class Watchdog(threading.Thread):
    """A thread beside the slots. slots: changed in place. new_slot: makes the one of this number, not yet started."""

    def __init__(
        self,
        store: Store,
        slots: list[Slot],
        new_slot: Callable[[int], Slot],
        stopping: threading.Event,
        wake: Callable[[], None],
    ) -> None:
        super().__init__(name="watchdog", daemon=True)
        self._store, self._slots, self._new_slot = store, slots, new_slot
        self._stopping, self._wake = stopping, wake
        self._abandoned: list[Slot] = []
        self._heard: dict[str, tuple[Slot, int, int]] = {}  # name -> slot, its beats, looks since they changed
        self._orphaned: dict[tuple[str, int], int] = {}  # attempt -> looks at which nobody answered for it

    def run(self) -> None:
        """Look once a second until the engine stops."""
        while not self._stopping.wait(LOOK_S):
            try:
                self.look()
            except BaseException as error:  # noqa: BLE001  (a locked database, a full disk: the next look tries again)
                _log.error("watchdog: %s", described(error))

    def look(self) -> None:
        """One look at every slot and at every job that runs."""
        for number, slot in enumerate(list(self._slots)):
            self._listen(slot)
            if slot.ended:
                self._replace(number, slot, "its thread has ended")
            elif self.silent_looks(slot) >= STALLED_LOOKS:
                self._replace(number, slot, f"it has not got on for {STALLED_LOOKS * LOOK_S:g} s")
        self._requeue_orphans(self._store.running())

    def silent_looks(self, slot: Slot) -> int:
        """At how many looks in a row the slot had not got on."""
        known, _, looks = self._heard.get(slot.name, (None, 0, 0))
        return looks if known is slot else 0

    @property
    def silent(self) -> list[str]:
        """The slots that have not been heard of for a minute, by name."""
        return [slot.name for slot in list(self._slots) if self.silent_looks(slot) >= SILENT_LOOKS]

    def _listen(self, slot: Slot) -> None:
        known, beats, looks = self._heard.get(slot.name, (None, 0, 0))
        unchanged = known is slot and beats == slot.beats
        self._heard[slot.name] = (slot, slot.beats, looks + 1 if unchanged else 0)

    def _replace(self, number: int, slot: Slot, reason: str) -> None:
        self._abandoned = [old for old in self._abandoned if old.is_alive()]
        if len(self._abandoned) >= MOST_ABANDONED:
            return
        _log.error("%s is replaced: %s", slot.name, reason)
        slot.abandon()
        self._abandoned.append(slot)
        fresh = self._new_slot(number)
        fresh.start()
        self._slots[number] = fresh

    def _requeue_orphans(self, running: list[Job]) -> None:
        """What runs and nobody answers for has lost its slot: another attempt, or failed after its last one."""
        answered = {attempt for slot in list(self._slots) for attempt in slot.attempts}
        orphans = [job for job in running if (job.id, job.attempt) not in answered]
        self._orphaned = {key: self._orphaned.get(key, 0) + 1 for key in ((job.id, job.attempt) for job in orphans)}
        for job in orphans:
            if self._orphaned[job.id, job.attempt] < ORPHANED_LOOKS:
                continue
            try:
                now = self._store.requeue(job, reason="the slot that ran it was lost", crashed=True)
            except IllegalTransitionError as error:  # it ended meanwhile
                _log.warning("%s", error)
            else:
                _log.error("job %s ran without a slot: it is %s now", job.id, now.state)
                self._wake()
