"""The parts of a running service, and what its routes share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, cast

from fastapi import Depends, Request

from service.access import ADMIN
from service.admission.campaign_planner import Planner
from service.admission.pace import PaceMeter
from service.api.event_hub import EventHub
from service.api.job_view_cache import JobViewCache
from service.api.openapi import SCOPE_FIELD
from service.api.problems import HttpError
from service.campaigns.measured import MeasuredCampaigns
from service.engine import retention
from service.engine.change_notifier import Changes
from service.engine.engine import Engine
from service.engine.history import History, look_at
from service.engine.housekeeper import Keeper
from service.engine.metrics import Monitor
from service.settings import Settings
from service.store.backups import daily_backup
from service.store.campaigns import CampaignStore
from service.store.database import open_database
from service.store.jobs import Store
from service.store.keys import Keys
from service.store.models import Models
from service.store.schedules import ScheduleStore
from service.store.uploads import Uploads


@dataclass(frozen=True)
class Service:
    """What the routes work with."""

    settings: Settings
    store: Store
    engine: Engine
    changes: Changes
    job_views: JobViewCache
    monitor: Monitor
    keys: Keys
    uploads: Uploads
    models: Models
    campaigns: CampaignStore
    measured: MeasuredCampaigns
    schedules: ScheduleStore
    keeper: Keeper
    history: History
    planner: Planner
    pace: PaceMeter
    events: EventHub

    @classmethod
    def open(cls, settings: Settings) -> Service:
        """The service on its data folder, not yet running. Raises ForeignDatabaseError."""
        changes, monitor = Changes(), Monitor()
        store = Store(open_database(settings.database), limits=settings.limits)
        job_views = JobViewCache(store)
        keys = Keys(store, environment_key=settings.api_key, always=settings.exposed)
        uploads = Uploads(settings.uploads, store, settings.limits)
        engine, campaigns = Engine(settings, store, monitor, uploads), CampaignStore(store)
        store.listen(job_views.forget, engine.hear, changes.notify)  # in this order: who is woken reads the new state
        schedules = ScheduleStore(store, campaigns)
        planner = Planner(settings.uploads, settings.limits)
        history = History(lambda: look_at(engine, store, settings))
        keeper = Keeper(
            campaigns,
            schedules,
            planner,
            wake=engine.wake,
            sweep=_sweep_of(settings, store, uploads),
            backup=_backup_of(settings, store),
            watch=history.tick,
        )
        return cls(
            settings=settings,
            store=store,
            engine=engine,
            changes=changes,
            job_views=job_views,
            monitor=monitor,
            keys=keys,
            uploads=uploads,
            models=Models(uploads, store),
            campaigns=campaigns,
            measured=MeasuredCampaigns(campaigns),
            schedules=schedules,
            keeper=keeper,
            history=history,
            planner=planner,
            pace=PaceMeter(store),
            events=EventHub(store, changes),
        )

    @property
    def closing(self) -> bool:
        """Whether it takes no more work: it is draining or shutting down."""
        return self.changes.closed or self.engine.draining

    def begin_to_stop(self) -> None:
        """Tell everything that works or waits to end; nobody is waited for."""
        self.engine.begin_to_stop()
        self.keeper.begin_to_stop()
        self.changes.close()

    def refuse_when_closing(self) -> None:
        """Raises HttpError 503 once no more work is taken."""
        if self.closing:
            raise HttpError(503, "the service is shutting down", headers={"Retry-After": "10"}, code="closing")


def _sweep_of(settings: Settings, store: Store, uploads: Uploads) -> Callable[[], retention.Cleared] | None:
    """The removal of old jobs and unused uploads that the settings ask for; None if they ask for none."""
    if settings.keep_days is None and settings.keep_gb is None:
        return None
    policy = retention.Policy(
        older_than_s=None if settings.keep_days is None else settings.keep_days * 86_400,
        max_bytes=None if settings.keep_gb is None else int(settings.keep_gb * 2**30),
    )
    return lambda: retention.clear(store, settings.jobs, policy, dry_run=False, uploads=uploads)


def _backup_of(settings: Settings, store: Store) -> Callable[[], Path | None] | None:
    """The backup of the day; None when the settings want none."""
    if not settings.backups:
        return None
    return lambda: daily_backup(settings.data, settings.backups, now=store.now)


async def _service_of(request: Request) -> Service:
    return cast(Service, request.app.state.service)


ServiceOf = Annotated[Service, Depends(_service_of)]


async def _admin(request: Request) -> None:
    request.state.caller.require(ADMIN, f"{request.method} {request.url.path[:100]}")


def admin_only() -> dict[str, Any]:
    """Options of a route that needs the scope admin: `@router.get(..., **admin_only())`."""
    return {"dependencies": [Depends(_admin)], "openapi_extra": {SCOPE_FIELD: ADMIN}}


def etag_matches(if_none_match: str | None, tag: str) -> bool:
    """Whether an If-None-Match header names this entity tag."""
    known = [item.strip().removeprefix("W/") for item in (if_none_match or "").split(",")]
    return tag in known or "*" in known
