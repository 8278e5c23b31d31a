"""The page of the service itself: workers, queue, disk and memory, now and lately."""

from __future__ import annotations

from dataclasses import asdict

from fastapi import APIRouter, Request, Response

from service.access import ADMIN
from service.api.context import ServiceOf
from service.api.readiness import checks
from service.engine.history import look_at
from service.files.disk import size_bytes
from service.web.site import page

router = APIRouter(include_in_schema=False)


@router.get("/service")
def get_service(request: Request, service: ServiceOf) -> Response:
    """Everything that an operator looks at before the log."""
    engine, moments = service.engine, service.history.moments()
    now = look_at(engine, service.store, service.settings)
    oldest = service.store.oldest_queued_at()
    return page(
        request,
        "service.html",
        now=now,
        slots=engine.slot_states,
        waits_s=None if oldest is None else max(0.0, service.store.now - oldest),
        uploads_bytes=size_bytes(service.settings.uploads),
        checks=checks(service),
        moments=[asdict(moment) for moment in moments],
        may_see_keys=request.state.caller.may(ADMIN),
    )
