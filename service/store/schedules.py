"""All SQL of schedules: a tick, its campaign and the next moment are written in one transaction, so it fires once."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields
from typing import TYPE_CHECKING, Any

from sqlalchemy import Connection, Row, delete, insert, select, update
from sqlalchemy.exc import IntegrityError

from service.store.campaign import RUNNING, CampaignPlan
from service.store.errors import VersionChangedError
from service.store.job import QueueFullError
from service.store.schedule import (
    FAILED,
    MISSED,
    OVERLAP,
    STARTED,
    Schedule,
    ScheduleExistsError,
    ScheduleRun,
    UnknownScheduleError,
    next_tick,
    ticks,
    to_fire,
)
from service.store.schema import campaign as _campaign
from service.store.schema import schedule as _schedule
from service.store.schema import schedule_run as _run
from simcore.errors import NeedlebenchError

if TYPE_CHECKING:
    from service.store.campaigns import CampaignStore
    from service.store.jobs import Store

_COLUMNS = [_schedule.c[field.name] for field in fields(Schedule)]
_RUN_COLUMNS = [_run.c[field.name] for field in fields(ScheduleRun)]

Planner = Callable[[dict[str, Any]], CampaignPlan]


class ScheduleStore:
    """Schedules and their history, on the job store's connections and clock."""

    def __init__(self, store: Store, campaigns: CampaignStore) -> None:
        self._store = store
        self._campaigns = campaigns

    def create(self, values: dict[str, Any]) -> Schedule:
        """values: the fields of a schedule that are given. Raises ScheduleExistsError, ScenarioError."""
        now = self._store.now
        first = next_tick(values["cron"], values["timezone"], now)
        row = {**values, "id": secrets.token_hex(8), "next_run_at": first, "created_at": now, "version": 1}
        with self._writing_one(values["name"]) as connection:
            return _to_schedule(connection.execute(insert(_schedule).values(row).returning(*_COLUMNS)).one())

    def change(self, schedule_id: str, values: dict[str, Any], *, version: int | None) -> Schedule:
        """Other values for some fields; version: the one that the caller has seen. The next tick is computed again.

        Raises UnknownScheduleError, VersionChangedError, ScheduleExistsError, ScenarioError.
        """
        with self._writing_one(values.get("name", "")) as connection:  # nobody writes between reading and writing
            now = self._read(connection, schedule_id)
            if version is not None and version != now.version:
                raise VersionChangedError(
                    f"schedule {schedule_id} is at version {now.version}, not at {version}: read it again"
                )
            timing = {name: values.get(name, getattr(now, name)) for name in ("cron", "timezone")}
            moved = timing != {"cron": now.cron, "timezone": now.timezone} or (
                values.get("enabled") and not now.enabled
            )
            if moved:
                values = {**values, "next_run_at": next_tick(timing["cron"], timing["timezone"], self._store.now)}
            statement = update(_schedule).where(_schedule.c.id == schedule_id)
            statement = statement.values(**values, version=_schedule.c.version + 1)
            return _to_schedule(connection.execute(statement.returning(*_COLUMNS)).one())

    @contextmanager
    def _writing_one(self, name: str) -> Iterator[Connection]:
        """A transaction that writes a schedule called `name`. Raises ScheduleExistsError if another has that name."""
        try:
            with self._store.writing() as connection:
                yield connection
        except IntegrityError:
            raise ScheduleExistsError(f"there is a schedule named {name!r} already") from None

    def get(self, schedule_id: str) -> Schedule:
        """Raises UnknownScheduleError."""
        with self._store.reading() as connection:
            return self._read(connection, schedule_id)

    def _read(self, connection: Connection, schedule_id: str) -> Schedule:
        row = connection.execute(select(*_COLUMNS).where(_schedule.c.id == schedule_id)).one_or_none()
        if row is None:
            raise UnknownScheduleError(f"there is no schedule {schedule_id}")
        return _to_schedule(row)

    def all(self) -> list[Schedule]:
        """Every schedule, by name."""
        with self._store.reading() as connection:
            return [_to_schedule(row) for row in connection.execute(select(*_COLUMNS).order_by(_schedule.c.name))]

    def delete(self, schedule_id: str) -> None:
        """Forget a schedule and its history; campaigns that it started stay. Raises UnknownScheduleError."""
        with self._store.writing() as connection:
            self._read(connection, schedule_id)
            connection.execute(delete(_schedule).where(_schedule.c.id == schedule_id))

    def runs(self, schedule_id: str, *, limit: int = 50) -> list[ScheduleRun]:
        """What became of its ticks, newest first. Raises UnknownScheduleError."""
        query = select(*_RUN_COLUMNS).where(_run.c.schedule_id == schedule_id).order_by(_run.c.seq.desc()).limit(limit)
        with self._store.reading() as connection:
            self._read(connection, schedule_id)
            return [ScheduleRun(**row._mapping) for row in connection.execute(query)]

    # -- firing

    def next_moment(self) -> float | None:
        """When the next schedule is due."""
        query = select(_schedule.c.next_run_at).where(_schedule.c.enabled, _schedule.c.next_run_at.is_not(None))
        with self._store.reading() as connection:
            return connection.execute(query.order_by(_schedule.c.next_run_at).limit(1)).scalar_one_or_none()

    def fire_due(self, plan: Planner) -> list[ScheduleRun]:
        """Fire every schedule whose moment has come; what became of each tick. plan: request -> campaign."""
        now = self._store.now
        query = select(_schedule.c.id).where(_schedule.c.enabled, _schedule.c.next_run_at <= now)
        with self._store.reading() as connection:
            due = connection.execute(query).scalars().all()
        return [run for schedule_id in due for run in self._fire(schedule_id, now, plan)]

    def _fire(self, schedule_id: str, now: float, plan: Planner) -> list[ScheduleRun]:
        one = self.get(schedule_id)
        if not one.enabled or one.next_run_at is None or one.next_run_at > now:
            return []
        *due, following = ticks(one.cron, one.timezone, one.next_run_at, now)
        if one.catchup == "all" and one.overlap == "forbid":
            due, following = due[:1], [*due, following][1]  # one after the other: the rest waits for its end
        wanted = to_fire(due, now, one.catchup)
        if wanted and one.catchup == "all" and one.overlap == "forbid" and self._running(schedule_id):
            return []
        made = self._planned(one, plan) if wanted else None
        with self._store.writing() as connection:
            moved = update(_schedule).where(_schedule.c.id == one.id, _schedule.c.version == one.version)
            if not connection.execute(moved.values(next_run_at=following, version=one.version + 1)).rowcount:
                return []  # changed or fired by somebody else meanwhile
            return [self._tick(connection, one, tick, made if tick in wanted else None) for tick in due]

    def _planned(self, one: Schedule, plan: Planner) -> CampaignPlan | str:
        """The campaign of a tick, or why there is none."""
        try:
            return plan(one.request)
        except NeedlebenchError as error:
            return str(error)

    def _tick(self, connection: Connection, one: Schedule, tick: float, made: CampaignPlan | str | None) -> ScheduleRun:
        outcome, campaign_id, message = STARTED, None, None
        if made is None:
            outcome, message = MISSED, f"the service was not running; catchup is {one.catchup}"
        elif isinstance(made, str):
            outcome, message = FAILED, made
        else:
            running = self._running_within(connection, one.id)
            if running and one.overlap == "forbid":
                outcome, message = OVERLAP, f"campaign {running[0]} was still running; overlap is forbid"
            else:
                if one.overlap == "replace":
                    for old in running:
                        self._campaigns.cancel_within(connection, old)
                try:
                    campaign_id = self._campaigns.create_within(
                        connection, made, owner=one.owner, schedule_id=one.id, scheduled_for=tick
                    ).id
                except QueueFullError as full:  # nothing of it was written
                    outcome, message = FAILED, str(full)
        values = {"schedule_id": one.id, "scheduled_for": tick, "fired_at": self._store.now, "outcome": outcome}
        row = connection.execute(
            insert(_run).values(**values, campaign_id=campaign_id, message=message).returning(*_RUN_COLUMNS)
        ).one()
        return ScheduleRun(**row._mapping)

    def trigger(self, schedule_id: str, plan: Planner) -> ScheduleRun:
        """Start the campaign of a schedule now, whatever its time; the overlap rule holds. Raises ScenarioError."""
        one = self.get(schedule_id)
        made = plan(one.request)
        with self._store.writing() as connection:
            return self._tick(connection, one, self._store.now, made)

    def _running(self, schedule_id: str) -> list[str]:
        with self._store.reading() as connection:
            return self._running_within(connection, schedule_id)

    def _running_within(self, connection: Connection, schedule_id: str) -> list[str]:
        query = select(_campaign.c.id).where(_campaign.c.schedule_id == schedule_id, _campaign.c.state == RUNNING)
        return list(connection.execute(query).scalars())


def _to_schedule(row: Row[Any]) -> Schedule:
    return Schedule(**row._mapping)
