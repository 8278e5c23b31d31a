"""Puts the service together: settings, store, engine, routes."""

from __future__ import annotations

from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, Any, cast

import anyio
import anyio.to_thread
from fastapi import Depends, FastAPI

from service.api import openapi, problems
from service.api.middleware.body_limit import BodyLimit
from service.api.middleware.compression import Compression
from service.api.middleware.framework_errors import PlainTextErrors
from service.api.middleware.head_requests import HeadAsGet
from service.api.middleware.host_guard import HostGuard
from service.api.middleware.key_guard import KeyGuard
from service.api.middleware.request_log import RequestLog
from service.api.ownership import check_owner
from service.api.readiness import readings
from service.api.root_path import RootPath
from service.api.routes import (
    campaigns,
    events,
    job_edits,
    jobs,
    keys,
    models,
    operations,
    results,
    schedules,
    system,
    uploads,
)
from service.version import installed_version
from service.web import api_page, assets, login, side_by_side, site, viewer
from service.web import campaigns as campaign_pages
from service.web import jobs as job_pages
from service.web import keys as key_pages
from service.web import models as model_pages
from service.web import schedules as schedule_pages
from service.web import service as service_pages
from service.web import suites as suite_pages
from service.web import uploads as upload_pages

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

    from service.api.context import Service

DESCRIPTION = """Robotic needle insertions in deforming tissue, as jobs: submit a scenario, follow it, fetch its
metrics, series and recording. Every error is `application/problem+json` (RFC 9457)."""

ROUTES = (jobs, job_edits, events, results, campaigns, schedules, models, uploads, keys, system, operations)
PAGES = (
    *(login, job_pages, side_by_side, api_page, campaign_pages, suite_pages, schedule_pages, model_pages),
    *(upload_pages, service_pages, key_pages, viewer, assets),
)


def create_app(service: Service) -> FastAPI:
    """The application; its lifespan starts and stops the engine."""

    @asynccontextmanager
    async def lifespan(_app: FastAPI) -> AsyncIterator[None]:
        service.engine.start()
        service.keeper.start()
        try:
            yield
        finally:
            service.begin_to_stop()
            own = anyio.CapacityLimiter(1)  # requests may hold every thread of the common one
            await anyio.to_thread.run_sync(service.engine.stop, limiter=own)
            await anyio.to_thread.run_sync(service.keeper.stop, limiter=own)
            service.store.close()

    app = FastAPI(
        title="needlebench",
        version=installed_version(),
        description=DESCRIPTION,
        lifespan=lifespan,
        docs_url=None,  # its page loads scripts from another server
        redoc_url=None,
        redirect_slashes=False,
    )
    app.state.service = service
    service.monitor.add(lambda: readings(service))
    app.openapi = openapi.document_builder(app)  # type: ignore[method-assign]
    problems.install(app, page=site.problem)
    for part in (*ROUTES, *PAGES):
        app.include_router(part.router, dependencies=[Depends(check_owner)])
    app.state.every_route = [route for part in (*ROUTES, *PAGES) for route in part.router.routes]
    _guard(app, service)
    app.add_middleware(cast("Any", RequestLog), monitor=service.monitor)
    return app


def _guard(app: FastAPI, service: Service) -> None:
    """The layers around the routes; the last one added sees a request first."""
    limits, settings = service.settings.limits, service.settings
    uploads = {"/api/v1/uploads": limits.upload_bytes}
    app.add_middleware(cast("Any", PlainTextErrors))
    app.add_middleware(cast("Any", Compression))
    app.add_middleware(cast("Any", HeadAsGet))
    app.add_middleware(cast("Any", BodyLimit), maximum_bytes=limits.body_bytes, exceptions=uploads)
    app.add_middleware(
        cast("Any", KeyGuard), keys=service.keys, rate_per_key=limits.rate_per_key, public=settings.public_host
    )
    app.add_middleware(cast("Any", HostGuard), loopback=settings.loopback, public=settings.public_host)
    app.add_middleware(cast("Any", RootPath), root=settings.root_path)
