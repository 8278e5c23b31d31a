"""The pages of jobs: the list, the form of a new one, one job in full."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Annotated, Any

from fastapi import APIRouter, Query, Request, Response

from benchmarks.paper.table import ARM_NAMES
from service.admission.cost import LEAST_LIMIT_S
from service.api.context import Service, ServiceOf
from service.api.job_archive import archive_parts
from service.api.parameters import JobId
from service.api.schemas.campaigns import CampaignView
from service.api.schemas.jobs import ArtefactView, EventView, JobRequest, JobSummary, JobView
from service.campaigns.overview import overviews
from service.display import flat
from service.store.campaign import RUNNING as CAMPAIGN_RUNNING
from service.store.job import FINISHED, QUEUED, RUNNING, TERMINAL, Job, UnknownJobError
from service.store.job_lists import JobOrder
from service.store.models import UnknownModelError
from service.web.form import scenario_form
from service.web.job_facts import differences, measures, path_words, ways_to_run
from service.web.job_list import COLUMNS, JobList, grouped
from service.web.site import missing, page
from service.web.still import still
from simcore.scenario.point_rules import without_derived
from simcore.scenario.presets import preset, preset_names

if TYPE_CHECKING:
    from pathlib import Path

router = APIRouter(include_in_schema=False)

ROWS = 50
CAMPAIGNS = 3  # that have ended and are shown above the jobs
_PLOTTED = 50_000  # steps up to which the series is drawn without a click


@router.get("/")
def get_jobs(request: Request, service: ServiceOf, shown: Annotated[JobList, Query()]) -> Response:
    """Jobs, newest first, on the first page those that run before all others; or in the order that was chosen. A
    campaign is one line: its jobs are listed where something is searched for or chosen, with `all`, and grouped."""
    listed = service.store.page(shown.filter(), shown.order(), size=ROWS, cursor=shown.cursor)
    running = (
        service.store.page(shown.filter(state=RUNNING), JobOrder(), size=ROWS).items if shown.running_first else []
    )
    ahead = {job.id for job in running}
    jobs = [*running, *(job for job in listed.items if job.id not in ahead)]
    campaign_of = service.campaigns.of_jobs([job.id for job in jobs])
    return page(
        request,
        "jobs.html",
        shown=shown,
        columns=shown.columns(),
        all_columns=COLUMNS,
        groups=grouped([JobSummary.of(job) for job in jobs], campaign_of, shown),
        campaign_of=campaign_of,
        following=listed.next_cursor,
        counts=service.store.counts(),
        outcomes=service.store.outcomes(),
        campaigns=_latest_campaigns(service) if shown.running_first and not shown.filtered else [],
        retriable=TERMINAL - {FINISHED},
    )


def _latest_campaigns(service: Service) -> list[CampaignView]:
    """Those that run, and the latest that have ended."""
    running = service.campaigns.newest(state=CAMPAIGN_RUNNING, limit=10)
    known = {one.id for one in running}
    ended = [one for one in service.campaigns.newest(limit=CAMPAIGNS) if one.id not in known]
    return [CampaignView.of(one) for one in overviews(service.campaigns, [*running, *ended], now=service.store.now)]


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
        values={name: _own_fields(name) for name in preset_names()},
        given=given,
        start=start,
        priority=schema["priority"],
        timeout=schema["timeout_s"] | schema["timeout_s"]["anyOf"][0],
        least_limit_s=LEAST_LIMIT_S,
    )


def _own_fields(name: str) -> dict[str, Any]:
    """The fields that a built-in scenario sets itself."""
    return preset(name).model_dump(mode="json", by_alias=True, exclude_unset=True)


def _start(service: Service, start: str | None) -> dict[str, Any] | None:
    """The fields to start from; None without a start, or if there is no such job, scenario or model."""
    if start is None:
        return None
    if start in preset_names():
        return _own_fields(start)
    with suppress(UnknownModelError):
        model = service.models.get(start)
        return {"controller": {"kind": model.kind, "model": model.reference}}
    with suppress(UnknownJobError):
        scenario: dict[str, Any] | None = (service.store.get(start).spec or {}).get("scenario")
        return scenario and without_derived(scenario)
    return None


def _waiting_reason(service: Service, job: Job) -> str:
    """Why a job does not run yet."""
    engine = service.engine
    if engine.problem is not None:
        return f"No job can start: {engine.problem}"
    if engine.draining:
        return "The service is shutting down; the job will start after its next start."
    if engine.ready == 0:
        return "The workers are starting. Their first start compiles the simulation, which takes one to two minutes."
    ahead = service.store.before(job)
    if ahead == 0:
        return "It is the next one to start."
    return f"{ahead} {'job is' if ahead == 1 else 'jobs are'} ahead of it; {engine.slots} run at a time."


@router.get("/jobs/{job_id}")
def get_job(job_id: JobId, request: Request, service: ServiceOf) -> Response:
    """One job: progress, results, provenance, files, log and events."""
    try:
        job = service.store.get(job_id)
    except UnknownJobError:
        return missing(request, f"job {job_id}")
    stored = {one.name: one for one in service.store.artefacts(job.id)}
    artefacts = [ArtefactView.of(job.id, one) for one in stored.values()]
    view = JobView.of(job)
    drawable = _drawable(job, view, set(stored))
    return page(
        request,
        "job.html",
        job=view,
        terminal=job.terminal,
        retriable=job.state in TERMINAL - {FINISHED},
        campaign=service.campaigns.of_jobs([job.id]).get(job.id),
        waiting_reason=_waiting_reason(service, job) if job.state == QUEUED else "",
        course=service.engine.trace(job),
        depth_mm=_planned_depth_mm(job),
        cancelling=job.cancel_requested and not job.terminal,
        cpu_s=job.cpu_s,
        memory_mb=job.max_rss_mb,
        artefacts=artefacts,
        archive=archive_parts(service, job) if job.terminal else [],
        events=[EventView.of(event) for event in service.store.events(job.id)],
        **_what_ran(view),
        ways=ways_to_run(view.scenario, str(request.base_url).rstrip("/")) if view.scenario else {},
        **_result_values(view.result or {}),
        **drawable,
        still=_still(view, service.settings.data / stored["series.npz"].path) if drawable["plotted"] else None,
    )


def _still(view: JobView, series: Path) -> dict[str, Any] | None:
    """What is drawn of a finished insertion; None for a training."""
    if view.scenario is None:
        return None
    return still(view.scenario, ((view.result or {}).get("held") or {}).get("faces") or [], series)


def _what_ran(view: JobView) -> dict[str, Any]:
    """What the page says of the inputs: controller and path in words, what was set, every field."""
    scenario = view.scenario
    inputs = list(flat({k: v for k, v in (scenario or view.training or {}).items() if k != "schema"}))
    if scenario is None:
        return {"controller": "", "path_text": "", "set_fields": [], "inputs": inputs}
    controller = scenario["controller"]
    name = controller.get("name") or ARM_NAMES.get(controller["kind"], controller["kind"])
    changed = differences(scenario)
    named = {one.field for one in changed}
    unset = [(field, value) for field, value in inputs if field not in named]
    return {"controller": name, "path_text": path_words(scenario), "set_fields": changed, "inputs": unset}


def _planned_depth_mm(job: Job) -> float | None:
    """How far the path leads; None where there is none."""
    scenario = (job.spec or {}).get("scenario") or {}
    speed_mm_s = scenario.get("trajectory", {}).get("speed_mm_s")
    return None if speed_mm_s is None else job.steps * scenario["dt_s"] * speed_mm_s


def _result_values(result: dict[str, Any]) -> dict[str, Any]:
    """What the page shows of a result: measures, timing by part, other timing, provenance."""
    timing = result.get("timing") or {}
    origin = {name: value for name, value in (result.get("provenance") or {}).items() if name != "scenario"}
    return {
        "result": result,
        "measures": [item for part in ("metrics", "solver") for item in measures(part, result.get(part) or {})],
        "parts": {name: part for name, part in timing.items() if isinstance(part, dict)},
        "spans": {name: value for name, value in timing.items() if not isinstance(value, dict)},
        "origin": list(flat(origin)),
    }


def _drawable(job: Job, view: JobView, files: set[str]) -> dict[str, bool]:
    """Whether there is a recording to open and a series to plot, and whether it is drawn without a click."""
    recorded = (view.scenario or {}).get("recording", {}).get("enabled", False)
    return {
        "recorded": recorded and ("recording.rrd" in files or not job.terminal),
        "plotted": "series.npz" in files and job.state == FINISHED,
        "plot_at_once": job.steps <= _PLOTTED,
    }
