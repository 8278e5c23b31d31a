"""Looks after what spans jobs: ends campaigns whose jobs have ended, fires schedules whose moment has come."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable

from service import trends
from service.campaign_plan import Planner
from service.campaign_store import CampaignStore
from service.schedule_store import ScheduleStore
from service.schedules import STARTED

_log = logging.getLogger("needlebench")
_LOOK_S = 1.0


class Keeper(threading.Thread):
    """A thread of the server. What it does is in the database before anybody hears of it, so it may die at any time."""

    def __init__(
        self, campaigns: CampaignStore, schedules: ScheduleStore, planner: Planner, *, poke: Callable[[], None]
    ) -> None:
        super().__init__(name="keeper", daemon=True)
        self._campaigns, self._schedules, self._poke = campaigns, schedules, poke
        self._planner = planner
        self._stopping = threading.Event()

    def run(self) -> None:
        while not self._stopping.wait(_LOOK_S):
            try:
                self.look()
            except Exception as error:  # a full disk, a locked database: the next look tries again
                _log.error("campaigns and schedules: %s: %s", type(error).__name__, error)

    def look(self) -> None:
        """One look at all of them."""
        for campaign in self._campaigns.settle():
            trends.kept_point(self._campaigns, campaign)
            _log.info("campaign %s (%s) is %s", campaign.id, campaign.name, campaign.state)
        fired = self._schedules.fire_due(self._planner.of_stored)
        for run in fired:
            _log.info("schedule %s: tick %.0f: %s %s", run.schedule_id, run.scheduled_for, run.outcome, run.message)
        if any(run.outcome == STARTED for run in fired):
            self._poke()

    def stop(self) -> None:
        """End the thread; on return it is gone."""
        self._stopping.set()
        if self.is_alive():
            self.join()
