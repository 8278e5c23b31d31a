"""The parts of a running service, and what its routes share."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Annotated, Any, cast

from fastapi import Depends, Path, Request

from service.campaign_store import CampaignStore
from service.changes import Changes
from service.database import open_database
from service.engine import Engine
from service.keeper import Keeper
from service.problems import MEDIA_TYPE, HttpProblem
from service.schedule_store import ScheduleStore
from service.schemas import ProblemDetails
from service.settings import Settings
from service.store import Store
from simcore.files import Lookup, names_mean, nothing


@dataclass(frozen=True)
class Service:
    """What the routes work with."""

    settings: Settings
    store: Store
    engine: Engine
    changes: Changes
    campaigns: CampaignStore
    schedules: ScheduleStore
    keeper: Keeper
    lookup: Lookup  # what the names of files in scenarios mean here

    @classmethod
    def open(cls, settings: Settings) -> Service:
        """The service on its data folder, not yet running. Raises DatabaseTooNew."""
        changes, lookup = Changes(), nothing
        store = Store(open_database(settings.database), notify=changes.notify)
        engine, campaigns = Engine(settings, store), CampaignStore(store)
        schedules = ScheduleStore(store, campaigns)
        keeper = Keeper(campaigns, schedules, poke=engine.poke, lookup=lookup)
        return cls(settings, store, engine, changes, campaigns, schedules, keeper, lookup)

    @contextmanager
    def file_names(self) -> Iterator[None]:
        """Within, scenarios name files as they may over HTTP."""
        with names_mean(self.lookup):
            yield

    @property
    def closing(self) -> bool:
        """Whether it takes no new work any more: it drains, or goes down."""
        return self.changes.closed or self.engine.draining

    def refuse_when_closing(self) -> None:
        """Raises a problem of status 503 once no new work is taken."""
        if self.closing:
            raise HttpProblem(503, "the service is going down", headers={"Retry-After": "10"})


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
    403: "The page that sent this may not change anything.",
    404: "There is no such thing.",
    409: "The job is not in a state for this.",
    412: "It was changed since it was read.",
    413: "The body is too long.",
    415: "The body is not declared as JSON.",
    421: "The Host header is not a name of this machine.",
    422: "A field is missing or out of its range; `errors` names field, value and range.",
    503: "Not now.",
}


def documented(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """OpenAPI entries of the errors of a route, in their one shape."""
    schema = {"$ref": f"#/components/schemas/{ProblemDetails.__name__}"}
    content = {MEDIA_TYPE: {"schema": schema}}
    return {status: {"description": _CAUSES[status], "content": content} for status in (*statuses, 401, 421, 422)}
