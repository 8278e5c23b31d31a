"""Puts the service together: settings, store, engine, routes."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any, cast

import anyio.to_thread
from fastapi import FastAPI

from service.api import openapi, problems
from service.api.context import Service
from service.api.middleware.framework_errors import PlainErrors
from service.api.middleware.guard import BodyLimit, HostGuard
from service.api.middleware.head_requests import HeadAsGet
from service.api.middleware.key_guard import KeyGuard
from service.api.middleware.request_log import RequestLog
from service.api.readiness import readings
from service.api.routes import campaigns as api_campaigns
from service.api.routes import events, results, system
from service.api.routes import jobs as api
from service.api.routes import keys as key_routes
from service.api.routes import models as api_models
from service.api.routes import operations as ops
from service.api.routes import schedules as api_schedules
from service.api.routes import uploads as upload_routes
from service.store.keys import UnknownKeyError
from service.store.models import UnknownModelError
from service.store.uploads import UnknownUploadError, UploadInUseError, UploadsFullError
from service.version import installed_version
from service.web import assets, campaigns, jobs, login, models, schedules, site, viewer

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
    service.monitor.add(lambda: readings(service))
    app.openapi = openapi.document_of(app)  # type: ignore[method-assign]
    problems.install(app, page=site.problem)
    app.add_exception_handler(UnknownUploadError, problems.on_unknown)
    app.add_exception_handler(UnknownModelError, problems.on_unknown)
    app.add_exception_handler(UnknownKeyError, problems.on_unknown)
    app.add_exception_handler(UploadInUseError, problems.on_conflict)
    app.add_exception_handler(UploadsFullError, problems.on_no_room)
    for part in (
        api,
        events,
        results,
        api_campaigns,
        api_schedules,
        api_models,
        upload_routes,
        key_routes,
        system,
        ops,
        login,
    ):
        app.include_router(part.router)
    for page in (jobs, campaigns, schedules, models, viewer, assets):
        app.include_router(page.router)
    _guard(app, service)
    app.add_middleware(cast(Any, RequestLog), monitor=service.monitor)
    return app


def _guard(app: FastAPI, service: Service) -> None:
    """The layers around the routes; the last one added sees a request first."""
    limits, settings = service.settings.limits, service.settings
    uploads = {"/api/v1/uploads": limits.upload_bytes}
    app.add_middleware(cast(Any, PlainErrors))
    app.add_middleware(cast(Any, HeadAsGet))
    app.add_middleware(cast(Any, BodyLimit), maximum_bytes=limits.body_bytes, more=uploads)
    app.add_middleware(cast(Any, KeyGuard), keys=service.keys, rate_per_key=limits.rate_per_key)
    app.add_middleware(cast(Any, HostGuard), loopback=settings.loopback)
