"""Two to six jobs side by side: their series in one plot, their numbers and what differs between them."""

from __future__ import annotations

import shutil
import tempfile
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from fastapi import APIRouter, Query, Request, Response
from fastapi import Path as PathParameter
from starlette.background import BackgroundTask
from starlette.responses import FileResponse

from service.api.context import Service, ServiceOf
from service.api.problems import HttpError
from service.api.schemas.jobs import JobView
from service.display import flat, size_text
from service.recording.together import FEWEST, MOST, TogetherError, combine, distinct
from service.recording.viewer import ViewerError
from service.store.job import FINISHED, UnknownJobError
from service.web.job_facts import measures, path_words
from service.web.site import missing, page

if TYPE_CHECKING:
    from collections.abc import Sequence

    from service.store.job import Job

router = APIRouter(include_in_schema=False)

MOST_BYTES = 300 * 2**20  # of recordings that the service puts together
RRD = "application/vnd.rerun.rrd"
_combining = threading.Lock()  # one at a time: it takes a process and memory
_APART = ("name", "schema")


class Line(NamedTuple):
    """A field or a number of every job, None where it has none. apart: they are not all the same."""

    name: str
    unit: str
    values: list[Any]
    apart: bool


@router.get("/side-by-side")
def get_side_by_side(
    request: Request,
    service: ServiceOf,
    chosen: Annotated[list[str] | None, Query(alias="job", max_length=MOST)] = None,
) -> Response:
    """The jobs of these ids, in the given order; each once."""
    wanted = list(dict.fromkeys(chosen or ()))
    try:
        jobs = [service.store.get(job_id) for job_id in wanted]
    except UnknownJobError as error:
        return missing(request, str(error).removeprefix("there is no "))
    jobs = [job for job in jobs if (job.spec or {}).get("scenario")]
    if len(jobs) < FEWEST:
        return missing(request, f"comparison of fewer than {FEWEST} insertions: choose them in the list of jobs")
    results = [job.result or {} for job in jobs]
    digests = {result.get("digest") for result in results}
    return page(
        request,
        "side_by_side.html",
        jobs=[JobView.of(job) for job in jobs],
        along=[path_words((job.spec or {})["scenario"]) for job in jobs],
        fields=fields_apart([(job.spec or {})["scenario"] for job in jobs]),
        numbers=numbers(results),
        same=len(digests) == 1 and None not in digests,
        plotted=[job.id for job in jobs if _has(service, job, "series.npz")],
        recorded=[job.id for job in jobs if _has(service, job, "recording.rrd")],
    )


@router.get("/side-by-side/{jobs}.rrd")
def get_recording(
    jobs: Annotated[str, PathParameter(pattern="^[0-9a-z]+(-[0-9a-z]+){1,5}$", max_length=200)], service: ServiceOf
) -> Response:
    """The recordings of jobs that have finished, as one. jobs: their ids with hyphens between them."""
    chosen = [service.store.get(job_id) for job_id in dict.fromkeys(jobs.split("-"))]
    files = [_recording(service, job) for job in chosen]
    if sum(path.stat().st_size for path in files) > MOST_BYTES:
        raise HttpError(413, f"the recordings are more than {size_text(MOST_BYTES)}: needlebench recording together")
    names = distinct([job.name for job in chosen])
    with _combining:
        folder = Path(tempfile.mkdtemp(prefix="together-"))
        try:
            combine(list(zip(names, files, strict=True)), folder / "together.rrd")
        except (TogetherError, ViewerError) as error:
            shutil.rmtree(folder, ignore_errors=True)
            raise HttpError(422, str(error)) from None
    away = BackgroundTask(shutil.rmtree, folder, ignore_errors=True)
    headers = {"Cache-Control": "no-store"}
    return FileResponse(
        folder / "together.rrd", media_type=RRD, filename="together.rrd", headers=headers, background=away
    )


def _recording(service: Service, job: Job) -> Path:
    """The file of a job's recording. Raises HttpError."""
    found = next((one for one in service.store.artefacts(job.id) if one.name == "recording.rrd"), None)
    if job.state != FINISHED or found is None or not (path := service.settings.data / found.path).is_file():
        raise HttpError(404, f"job {job.id} has no recording", code="result-absent")
    return path


def fields_apart(scenarios: Sequence[dict[str, Any]]) -> list[Line]:
    """The fields in which scenarios differ, in the order in which they occur."""
    known = [dict(flat(scenario)) for scenario in scenarios]
    lines = [
        _line(name, "", [one.get(name) for one in known]) for name in dict.fromkeys(n for one in known for n in one)
    ]
    return [line for line in lines if line.apart and line.name not in _APART]


def numbers(results: Sequence[dict[str, Any]]) -> list[Line]:
    """The metrics of results, one below the other."""
    known = [{one.name: one for one in measures("metrics", result.get("metrics") or {})} for result in results]
    names = dict.fromkeys(name for one in known for name in one)
    units = {name: measure.unit for one in known for name, measure in one.items()}
    return [_line(name, units[name], [one[name].value if name in one else None for one in known]) for name in names]


def _line(name: str, unit: str, values: list[Any]) -> Line:
    return Line(name, unit, values, any(value != values[0] for value in values))


def _has(service: Service, job: Job, name: str) -> bool:
    return job.state == FINISHED and any(one.name == name for one in service.store.artefacts(job.id))
