"""Looks after what spans jobs: ends campaigns whose jobs have ended, fires schedules, removes old jobs, backs up."""

from __future__ import annotations

import logging
import threading
import time
from typing import TYPE_CHECKING

from service.campaigns import trends
from service.store.schedule import STARTED
from service.worker.failures import described

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from service.admission.campaign_planner import Planner
    from service.engine.retention import Cleared
    from service.store.campaigns import CampaignStore
    from service.store.schedules import ScheduleStore

_log = logging.getLogger("needlebench")
_TICK_S = 1.0
SWEEP_S = 86_400.0
BACKUP_LOOK_S = 600.0  # between two looks whether the last backup is a day old


class Keeper(threading.Thread):
    """A thread of the server. What it does is in the database before anybody hears of it, so it may die at any time."""

    def __init__(
        self,
        campaigns: CampaignStore,
        schedules: ScheduleStore,
        planner: Planner,
        *,
        wake: Callable[[], None],
        sweep: Callable[[], Cleared] | None = None,
        backup: Callable[[], Path | None] | None = None,
        watch: Callable[[], None] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """wake: jobs were queued. sweep: removes old jobs, at the first tick and then once a day; None = never.

        backup: makes the backup of the day if it is due, and says where; None = no backups. watch: keeps how the
        service is now, if that is due.
        """
        super().__init__(name="keeper", daemon=True)
        self._campaigns, self._schedules, self._wake = campaigns, schedules, wake
        self._planner = planner
        self._sweep, self._clock = sweep, clock
        self._backup, self._watch = backup, watch
        self._next_sweep = self._next_backup = clock()
        self._stopping = threading.Event()

    def run(self) -> None:
        """Tick once a second until `stop`."""
        while not self._stopping.wait(_TICK_S):
            try:
                self.tick()
            except BaseException as error:  # noqa: BLE001  (a full disk, a locked database: the next tick tries again)
                _log.error("campaigns, schedules, retention: %s", described(error))

    def tick(self) -> None:
        """One round over all of them."""
        if self._watch is not None:
            self._watch()
        for campaign in self._campaigns.settle():
            trends.kept_point(self._campaigns, campaign)
            _log.info("campaign %s (%s) is %s", campaign.id, campaign.name, campaign.state)
        fired = self._schedules.fire_due(self._planner.of_stored)
        for run in fired:
            _log.info("schedule %s: tick %.0f: %s %s", run.schedule_id, run.scheduled_for, run.outcome, run.message)
        if any(run.outcome == STARTED for run in fired):
            self._wake()
        if self._sweep is not None and self._clock() >= self._next_sweep:
            self._next_sweep = self._clock() + SWEEP_S
            cleared = self._sweep()
            _log.info("retention: %d jobs removed, %d bytes", len(cleared.jobs), cleared.bytes)
        if self._backup is not None and self._clock() >= self._next_backup:
            self._next_backup = self._clock() + BACKUP_LOOK_S
            if (made := self._backup()) is not None:
                _log.info("backup of the database: %s", made)

    @property
    def ended(self) -> bool:
        """Whether the thread is gone after it was started."""
        return self.ident is not None and not self.is_alive()

    def begin_to_stop(self) -> None:
        """End the thread after what it is at; nobody is waited for."""
        self._stopping.set()

    def stop(self) -> None:
        """End the thread; on return it is gone."""
        self.begin_to_stop()
        if self.is_alive():
            self.join()
