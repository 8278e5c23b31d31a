"""Puts the service together: settings, store, engine, routes."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any, cast

import anyio.to_thread
from fastapi import FastAPI

from service import api, api_campaigns, api_schedules, events, openapi, problems, results, system
from service.core import Service
from service.guard import BodyLimit, HostGuard, KeyGuard
from service.settings import Settings
from service.version import installed_version
from service.web import assets, campaigns, jobs, schedules, viewer

DESCRIPTION = """Robotic needle insertions in deforming tissue, as jobs: submit a scenario, follow it, fetch its
metrics, series and recording. Every error is `application/problem+json` (RFC 9457)."""


def create_app(service: Service) -> FastAPI:
    """The application; its lifespan starts and stops the engine."""

    @asynccontextmanager
    async def lifespan(_app: FastAPI) -> AsyncIterator[None]:
        service.engine.start()
        service.keeper.start()
        try:
            yield
        finally:
            service.changes.close()
            await anyio.to_thread.run_sync(service.keeper.stop)
            await anyio.to_thread.run_sync(service.engine.stop)
            service.store.close()

    app = FastAPI(
        title="needlebench",
        version=installed_version(),
        description=DESCRIPTION,
        lifespan=lifespan,
        docs_url=None,  # they load scripts from elsewhere
        redoc_url=None,
        redirect_slashes=False,
    )
    app.state.service = service
    app.openapi = openapi.document_of(app)  # type: ignore[method-assign]
    problems.install(app)
    for part in (api, events, results, api_campaigns, api_schedules, system):
        app.include_router(part.router)
    for page in (jobs, campaigns, schedules, viewer, assets):
        app.include_router(page.router)
    _guard(app, service.settings)
    return app


def _guard(app: FastAPI, settings: Settings) -> None:
    """The layers around the routes; the last one added sees a request first."""
    app.add_middleware(cast(Any, BodyLimit), maximum_bytes=settings.maximum_body_bytes)
    if settings.api_key is not None:
        app.add_middleware(cast(Any, KeyGuard), key=settings.api_key)
    app.add_middleware(cast(Any, HostGuard), loopback=settings.loopback)
