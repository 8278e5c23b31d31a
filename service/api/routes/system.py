"""Routes about the service itself: health, version, built-in scenarios."""

from __future__ import annotations

import platform
from typing import Annotated

from fastapi import APIRouter, Path

from service.api.context import ServiceOf
from service.api.openapi import documented
from service.api.problems import HttpError
from service.api.readiness import checks
from service.api.schemas.system import CheckView, Health, Readiness, ScenarioInfo, ScenarioList, Version
from service.version import installed_version
from simcore.errors import ScenarioError
from simcore.scenario.presets import preset_names, start
from simcore.scenario.scenario import SCHEMA

router = APIRouter(tags=["service"])


@router.get("/healthz", operation_id="get_health", summary="Is it alive?")
def get_health() -> Health:
    """Answers as long as the process is alive."""
    return Health()


@router.get("/readyz", operation_id="get_readiness", summary="Is it ready?", responses=documented(503))
def get_readiness(service: ServiceOf) -> Readiness:
    """Writes to the data folder and the database, checks the disk and counts warm workers. Jobs are accepted while
    workers start. A problem of status 503 has the same `checks`."""
    results = checks(service)
    views = [CheckView.of(check) for check in results]
    bad = [f"{check.name}: {check.found}" for check in results if check.level == "bad"]
    if bad:
        more = {"checks": [view.model_dump() for view in views]}
        raise HttpError(503, "; ".join(bad), more=more, headers={"Retry-After": "10"}, code="not-ready")
    engine = service.engine
    ready = engine.ready == engine.slots
    return Readiness(
        status="ready" if ready else "starting",
        workers=engine.slots,
        workers_ready=engine.ready,
        problem=engine.problem,
        warnings=[f"{check.name}: {check.found}; {check.advice}" for check in results if check.level == "warn"],
        checks=views,
    )


@router.get("/version", operation_id="get_version", summary="Version", responses=documented())
def get_version() -> Version:
    """Of the program, of Python and of the scenario format."""
    return Version(version=installed_version(), python=platform.python_version(), scenario_schema=SCHEMA)


@router.get(
    "/api/v1/scenarios",
    operation_id="list_scenarios",
    summary="Built-in scenarios",
    responses=documented(),
)
def list_scenarios() -> ScenarioList:
    """Each with every field, null where it follows from others: a starting point for your own."""
    return ScenarioList(items=[_info(name) for name in preset_names()])


@router.get(
    "/api/v1/scenarios/{name}",
    operation_id="get_scenario",
    summary="A built-in scenario",
    responses=documented(404),
)
def get_scenario(name: Annotated[str, Path(max_length=100)]) -> ScenarioInfo:
    """One of them, with every field."""
    try:
        return _info(name)
    except ScenarioError as error:
        raise HttpError(404, str(error.problems[0].message)) from None


def _info(name: str) -> ScenarioInfo:
    return ScenarioInfo(name=name, scenario=start(name), description=preset_names()[name])
