"""Who may change what: one rule for every route that changes something that exists.

It is asked before each route, and goes by the names of the parameters in its address: a route cannot forget it. What
state or a pin forbid is asked by the stores, within the transaction that makes the change.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from fastapi import Request

from service.access import ADMIN, SAFE_METHODS, Caller
from service.api.context import Service, ServiceOf

Owner = Callable[[Service, str], str | None]

OWNERS: Mapping[str, tuple[str, Owner]] = {  # parameter of an address -> what it names, and which key made that
    "job_id": ("job", lambda service, name: service.store.get_summary(name).owner),
    "campaign_id": ("campaign", lambda service, name: service.campaigns.get(name).owner),
    "schedule_id": ("schedule", lambda service, name: service.schedules.get(name).owner),
    "upload_id": ("upload", lambda service, name: service.uploads.get(name).owner),
}
FOR_ADMINS = frozenset({"key_id"})  # what such a parameter names belongs to nobody


def check_owner(request: Request, service: ServiceOf) -> None:
    """A dependency of every route. Raises ForbiddenError for a change of what another key made, and 404s."""
    if request.method in SAFE_METHODS:
        return
    caller = request.state.caller
    for name, value in request.path_params.items():
        if name in OWNERS:
            require_owner(caller, service, name, value)
        elif name in FOR_ADMINS:
            caller.require(ADMIN, f"{request.method} {request.url.path[:100]}")
        else:
            raise LookupError(f"{request.url.path[:100]}: nobody knows who owns {name}")


def require_owner(caller: Caller, service: Service, name: str, value: str) -> None:
    """The same rule for one of many things that a body names. Raises ForbiddenError, and 404s."""
    thing, owner_of = OWNERS[name]
    caller.require_owner(owner_of(service, value), f"{thing} {value}")
