"""Looks after what spans jobs: ends campaigns whose jobs have ended, fires schedules, removes old jobs."""

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

    from service.admission.campaign_planner import Planner
    from service.engine.retention import Cleared
    from service.store.campaigns import CampaignStore
    from service.store.schedules import ScheduleStore

_log = logging.getLogger("needlebench")
_TICK_S = 1.0
SWEEP_S = 86_400.0


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
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """wake: jobs were queued. sweep: removes old jobs, at the first tick and then once a day; None = never."""
        super().__init__(name="keeper", daemon=True)
        self._campaigns, self._schedules, self._wake = campaigns, schedules, wake
        self._planner = planner
        self._sweep, self._clock = sweep, clock
        self._next_sweep = clock()
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

    @property
    def ended(self) -> bool:
        """Whether the thread is gone after it was started."""
        return self.ident is not None and not self.is_alive()

    def stop(self) -> None:
        """End the thread; on return it is gone."""
        self._stopping.set()
        if self.is_alive():
            self.join()
