"""The parts of a running service, and what its routes share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, cast

from fastapi import Depends, Path, Request

from service.admission.campaign_planner import Planner
from service.api.job_view_cache import Statuses
from service.api.problems import MEDIA_TYPE, HttpProblem
from service.api.schemas.jobs import ProblemDetails
from service.engine import retention
from service.engine.change_notifier import Changes
from service.engine.engine import Engine
from service.engine.housekeeper import Keeper
from service.engine.metrics import Monitor
from service.settings import Settings
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
    statuses: Statuses
    monitor: Monitor
    keys: Keys
    uploads: Uploads
    models: Models
    campaigns: CampaignStore
    schedules: ScheduleStore
    keeper: Keeper
    planner: Planner

    @classmethod
    def open(cls, settings: Settings) -> Service:
        """The service on its data folder, not yet running. Raises ForeignDatabaseError."""
        changes, monitor = Changes(), Monitor()
        store = Store(open_database(settings.database), limits=settings.limits)
        statuses = Statuses(store)
        store.listen(statuses.forget, changes.notify)  # in this order: who is woken reads anew
        keys = Keys(store, environment_key=settings.api_key, always=not settings.loopback)
        uploads = Uploads(settings.uploads, store, settings.limits)
        engine, campaigns = Engine(settings, store, monitor, uploads), CampaignStore(store)
        schedules = ScheduleStore(store, campaigns)
        planner = Planner(uploads.lookup, settings.limits)
        keeper = Keeper(campaigns, schedules, planner, wake=engine.wake, sweep=_sweep_of(settings, store, uploads))
        return cls(
            settings=settings,
            store=store,
            engine=engine,
            changes=changes,
            statuses=statuses,
            monitor=monitor,
            keys=keys,
            uploads=uploads,
            models=Models(uploads, store),
            campaigns=campaigns,
            schedules=schedules,
            keeper=keeper,
            planner=planner,
        )

    @property
    def closing(self) -> bool:
        """Whether it takes no new work any more: it drains, or goes down."""
        return self.changes.closed or self.engine.draining

    def refuse_when_closing(self) -> None:
        """Raises a problem of status 503 once no new work is taken."""
        if self.closing:
            raise HttpProblem(503, "the service is going down", headers={"Retry-After": "10"})


def _sweep_of(settings: Settings, store: Store, uploads: Uploads) -> Callable[[], retention.Cleared] | None:
    """What the settings say about clearing away old jobs and unused uploads; None if they say nothing."""
    if settings.keep_days is None and settings.keep_gb is None:
        return None
    policy = retention.Policy(
        older_than_s=None if settings.keep_days is None else settings.keep_days * 86_400,
        max_bytes=None if settings.keep_gb is None else int(settings.keep_gb * 2**30),
    )
    return lambda: retention.clear(store, settings.jobs, policy, dry_run=False, uploads=uploads)


async def _service_of(request: Request) -> Service:
    return cast(Service, request.app.state.service)


ServiceOf = Annotated[Service, Depends(_service_of)]
JobId = Annotated[str, Path(description="Id of a job.", min_length=1, max_length=32, pattern="^[0-9a-z]+$")]


def matches(if_none_match: str | None, tag: str) -> bool:
    """Whether an If-None-Match header names this entity tag."""
    known = [item.strip().removeprefix("W/") for item in (if_none_match or "").split(",")]
    return tag in known or "*" in known


_CAUSES = {
    400: "The request cannot be read.",
    401: "The key is missing or wrong.",
    403: "The scope of the key does not reach this, or a page of elsewhere sent the request.",
    404: "There is no such thing.",
    409: "It is not in a state for this.",
    412: "It was changed since it was read.",
    413: "The body is too long.",
    414: "The address is too long.",
    415: "The body is not of a type that is taken.",
    416: "The Range header asks for bytes that the file does not have.",
    421: "The Host header is not a name of this machine.",
    422: "A field is missing or out of its range; `errors` names field, value and range.",
    429: "Too many requests of this key, or too many queued jobs; Retry-After says when to ask again.",
    431: "The headers are too long.",
    503: "Not now; Retry-After says when to ask again.",
    507: "There is no room for more uploads; delete some.",
}
_ANYWHERE = (401, 403, 414, 421, 422, 429, 431)


def documented(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """OpenAPI entries of the errors of a route, in their one shape."""
    schema = {"$ref": f"#/components/schemas/{ProblemDetails.__name__}"}
    content = {MEDIA_TYPE: {"schema": schema}}
    return {status: {"description": _CAUSES[status], "content": content} for status in sorted({*statuses, *_ANYWHERE})}
