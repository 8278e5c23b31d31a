"""Schedules: when a campaign is due, and what becomes of ticks that were missed or that meet the one before.

A tick is a moment of the cron line in the schedule's time zone; it is stored in UTC. A tick that cannot be fired within
a minute of its moment was missed; `catchup` says which of the missed ones are fired late.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import islice
from typing import Any, Literal
from zoneinfo import ZoneInfo

from cronsim import CronSim, CronSimError

from simcore.errors import NeedlebenchError, Problem, ScenarioError

Catchup = Literal["skip", "latest", "all"]
Overlap = Literal["forbid", "allow", "replace"]

STARTED, MISSED, OVERLAP, FAILED = "started", "missed", "overlap", "failed"
GRACE_S = 60.0
MOST_TICKS = 1000  # that one look at the clock turns into runs; a longer gap is caught up by the next looks


class UnknownScheduleError(NeedlebenchError, LookupError):
    """There is no schedule of this id."""


class ScheduleExistsError(NeedlebenchError):
    """There is a schedule of this name already."""


class ScheduleChangedError(NeedlebenchError):
    """Somebody else changed the schedule meanwhile."""


@dataclass(frozen=True, kw_only=True)
class Schedule:
    """One row of the schedule table; `request` is of the campaign that each tick starts. Times: UTC s since 1970."""

    seq: int
    id: str
    name: str
    cron: str
    timezone: str
    catchup: Catchup
    overlap: Overlap
    request: dict[str, Any]
    enabled: bool
    next_run_at: float | None
    created_at: float
    version: int
    owner: str | None = None


@dataclass(frozen=True, kw_only=True)
class ScheduleRun:
    """What became of one tick. outcome: started, missed, overlap or failed; message: why it was not started."""

    seq: int
    schedule_id: str
    scheduled_for: float
    fired_at: float
    outcome: str
    campaign_id: str | None
    message: str | None


def next_tick(cron: str, timezone: str, after: float) -> float:
    """The first moment of the cron line after `after`; UTC seconds. Raises ScenarioError for a line without any."""
    line = _line(cron, timezone, after)
    try:
        return next(line).timestamp()
    except StopIteration:
        raise ScenarioError([Problem("cron", cron, "never comes: no date is like that in the next 50 years")]) from None


def ticks(cron: str, timezone: str, first: float, now: float) -> list[float]:
    """The moments from `first`, itself one, to `now`, at most MOST_TICKS; the next one after these comes last."""
    found = [first]
    while found[-1] <= now and len(found) <= MOST_TICKS:
        found.append(next_tick(cron, timezone, found[-1]))
    return found


def next_ticks(cron: str, timezone: str, after: float, count: int) -> list[float]:
    """The first moments of the cron line after `after`, fewer where there are no more. Raises ScenarioError."""
    return [moment.timestamp() for moment in islice(_line(cron, timezone, after), count)]


def in_words(cron: str, timezone: str) -> str:
    """The cron line as a sentence, as in "At 02:00 every day". Raises ScenarioError."""
    return str(_line(cron, timezone, 0.0).explain())


def check(cron: str, timezone: str) -> None:
    """Raises ScenarioError when the line or the zone cannot be understood."""
    next_tick(cron, timezone, 0.0)


def _line(cron: str, timezone: str, after: float) -> CronSim:
    start = datetime.fromtimestamp(after, UTC).astimezone(_zone(timezone))
    if len(cron.split()) != 5:
        raise ScenarioError([Problem("cron", cron, "must be five fields: minute hour day month weekday, as 0 3 * * *")])
    try:
        return CronSim(cron, start)
    except CronSimError as error:
        raise ScenarioError([Problem("cron", cron, f"is not a cron line: {error}")]) from None


def _zone(name: str) -> ZoneInfo:
    try:
        return ZoneInfo(name)
    except (KeyError, ValueError, OSError):
        message = "is not a time zone of the IANA database, as in Europe/Paris or UTC"
        raise ScenarioError([Problem("timezone", name, message)]) from None


def to_fire(due: list[float], now: float, catchup: Catchup) -> set[float]:
    """Which of the due ticks are fired: those in time, and of the missed ones those that `catchup` asks for."""
    in_time = {tick for tick in due if now - tick <= GRACE_S}
    if catchup == "all":
        return set(due)
    if catchup == "latest" and due:
        return {due[-1]} | in_time
    return in_time
