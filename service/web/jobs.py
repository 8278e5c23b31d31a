"""The pages of jobs: the list, the form of a new one, one job with all that is known of it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response

from service.admission.cost import LEAST_LIMIT_S
from service.api.context import JobId, Service, ServiceOf
from service.api.routes.campaigns import STEP_S
from service.api.schemas.campaigns import CampaignView
from service.api.schemas.jobs import ArtefactView, EventView, JobRequest, JobSummary, JobView, State
from service.display import flat
from service.files.upload_names import UPLOAD_ID
from service.store.campaign import RUNNING as CAMPAIGN_RUNNING
from service.store.job import QUEUED, SUCCEEDED, TERMINAL, Job, UnknownJobError
from service.store.models import UnknownModelError, packaged
from service.web.form import scenario_form
from service.web.site import missing, page
from simcore.scenario.presets import preset, preset_names
from simcore.scenario.rules import without_derived

router = APIRouter(include_in_schema=False)

ROWS = 50
AXES = ("x", "y", "z")
_PLOTTED = 50_000  # steps above which the series is not drawn unasked


@router.get("/")
def get_jobs(
    request: Request,
    service: ServiceOf,
    state: State | None = None,
    cursor: Annotated[str | None, Query(pattern="^[0-9]{1,18}$")] = None,
) -> Response:
    """Jobs, newest first, and the campaigns that run."""
    found = service.store.newest(state=state, limit=ROWS + 1, before=int(cursor) if cursor else None)
    shown = found[:ROWS]
    return page(
        request,
        "jobs.html",
        jobs=[JobSummary.of(job) for job in shown],
        campaign_of=service.campaigns.of_jobs([job.id for job in shown]),
        older_than=shown[-1].seq if len(found) > ROWS else None,
        cursor=cursor,
        wanted=state,
        counts=service.store.counts(),
        campaigns=_running(service),
        again=TERMINAL - {SUCCEEDED},
    )


def _running(service: Service) -> list[CampaignView]:
    found = service.campaigns.newest(state=CAMPAIGN_RUNNING, limit=10)
    tallies = service.campaigns.tally([one.id for one in found])
    return [CampaignView.of(one, tallies[one.id], service.store.now) for one in found]


@router.get("/submit")
def get_submit(
    request: Request, service: ServiceOf, start: Annotated[str | None, Query(alias="from", max_length=100)] = None
) -> Response:
    """The form of a new job; `from`: a job, a built-in scenario or a model to start from."""
    given = _start(service, start)
    if start is not None and given is None:
        return missing(request, "job or built-in scenario to start from")
    schema = JobRequest.model_json_schema()["properties"]
    return page(
        request,
        "submit.html",
        groups=scenario_form(),
        presets=preset_names(),
        values={name: _chosen(name) for name in preset_names()},
        given=given,
        start=start,
        priority=schema["priority"],
        timeout=schema["timeout_s"] | schema["timeout_s"]["anyOf"][0],
        least_limit_s=LEAST_LIMIT_S,
        step_s=service.store.step_s() or STEP_S,
        measured=service.store.step_s() is not None,
    )


def _chosen(name: str) -> dict[str, Any]:
    """The fields that a built-in scenario sets itself."""
    return preset(name).model_dump(mode="json", by_alias=True, exclude_unset=True)


def _start(service: Service, start: str | None) -> dict[str, Any] | None:
    if start is None:
        return None
    if start in preset_names():
        return _chosen(start)
    if start in {model.id for model in packaged()} or re.fullmatch(UPLOAD_ID, start):
        return _steered(service, start)
    try:
        scenario: dict[str, Any] | None = (service.store.get(start).spec or {}).get("scenario")
    except UnknownJobError:
        return None
    return scenario and without_derived(scenario)


def _measures(part: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    """Values of a result by name, errors along x, y, z one by one; the model of a training has a page of its own."""
    for name, value in flat(part):
        if isinstance(value, list):
            yield from ((f"{name} {axis}", one) for axis, one in zip(AXES, value, strict=False))
        elif name != "model":
            yield name, value


def _steered(service: Service, model_id: str) -> dict[str, Any] | None:
    """A scenario that steers by a model."""
    try:
        model = service.models.get(model_id)
    except UnknownModelError:
        return None
    return {"controller": {"kind": model.kind, "model": model.reference}}


def _waits(service: Service, job: Job) -> str:
    """Why a job does not run yet."""
    engine = service.engine
    if engine.problem is not None:
        return f"No job is begun: {engine.problem}"
    if engine.draining:
        return "The service is about to end; the job will begin after its next start."
    if engine.ready == 0:
        return (
            "The workers start. The first start compiles the simulation, which takes up to a minute; later ones do not."
        )
    before = service.store.before(job)
    if before == 0:
        return "It is the next one to begin."
    return f"{before} {'job is' if before == 1 else 'jobs are'} before it; {engine.slots} run at a time."


@router.get("/jobs/{job_id}")
def get_job(job_id: JobId, request: Request, service: ServiceOf) -> Response:
    """One job: where it is, what it measured, where that comes from, its files and its log."""
    try:
        job = service.store.get(job_id)
    except UnknownJobError:
        return missing(request, f"job {job_id}")
    view = JobView.of(job)
    result = view.result or {}
    asked = view.scenario or view.training or {}
    timing = result.get("timing") or {}
    origin = {name: value for name, value in (result.get("provenance") or {}).items() if name != "scenario"}
    artefacts = [ArtefactView.of(job.id, one) for one in service.store.artefacts(job.id)]
    return page(
        request,
        "job.html",
        job=view,
        result=result,
        terminal=job.state in TERMINAL,
        again=job.state in TERMINAL - {SUCCEEDED},
        campaign=service.campaigns.of_jobs([job.id]).get(job.id),
        waits=_waits(service, job) if job.state == QUEUED else "",
        course=service.engine.trace(job),
        cancelling=job.cancel_requested and job.state not in TERMINAL,
        cpu_s=job.cpu_s,
        memory_mb=job.max_rss_mb,
        measures=[(name, value) for part in ("metrics", "solver") for name, value in _measures(result.get(part) or {})],
        parts={name: part for name, part in timing.items() if isinstance(part, dict)},
        spans={name: value for name, value in timing.items() if not isinstance(value, dict)},
        origin=list(flat(origin)),
        artefacts=artefacts,
        recorded=(view.scenario or {}).get("recording", {}).get("enabled", False)
        and (any(one.name == "recording.rrd" for one in artefacts) if job.state in TERMINAL else True),
        plotted=any(one.name == "series.npz" for one in artefacts) and job.state == SUCCEEDED,
        unasked=job.steps <= _PLOTTED,
        events=[EventView.of(event) for event in service.store.events(job.id)],
        asked=list(flat({k: v for k, v in asked.items() if k != "schema"})),
    )
