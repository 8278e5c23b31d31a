"""Two to six jobs side by side: their series in one plot, their numbers and what differs between them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from fastapi import APIRouter, Query, Request, Response

from service.api.context import Service, ServiceOf
from service.api.schemas.jobs import JobView
from service.display import flat
from service.store.job import FINISHED, UnknownJobError
from service.web.job_facts import measures, path_words
from service.web.site import missing, page

if TYPE_CHECKING:
    from collections.abc import Sequence

    from service.store.job import Job

router = APIRouter(include_in_schema=False)

FEWEST, MOST = 2, 6
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
