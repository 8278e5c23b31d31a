"""Routes of the results of a job: metrics, series, files, log, recording."""

from __future__ import annotations

import os
from collections.abc import AsyncIterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

from fastapi import APIRouter, Header, Query, Request, Response
from starlette.concurrency import run_in_threadpool
from starlette.responses import FileResponse, PlainTextResponse, StreamingResponse

from service.api.context import Service, ServiceOf
from service.api.file_tail import tail
from service.api.job_archive import archive_parts, open_parts
from service.api.openapi import documented
from service.api.parameters import JobId
from service.api.problems import HttpError
from service.api.schemas.jobs import ArtefactList, ArtefactView, MetricsView
from service.api.served_file import check_intact, served_file
from service.files import series_formats as series
from service.files.zip_stream import zip_bytes, zip_stream
from service.logs import LOG
from service.store.job import FINISHED, INSERTION, Artefact, Job
from simcore.errors import Problem

router = APIRouter()

_JOB = "/api/v1/jobs/{job_id}"
_BINARY = {"schema": {"type": "string", "format": "binary"}}
_LOG_BYTES = 2**20
RRD = "application/vnd.rerun.rrd"
NPZ = "application/x-npz"
ZIP = "application/zip"
_FORMATS = {"application/json": "json", "text/csv": "csv", NPZ: "npz", "application/octet-stream": "npz"}


@router.get(
    f"{_JOB}/metrics",
    operation_id="get_metrics",
    summary="Metrics of a finished job",
    tags=["results"],
    responses=documented(404, 409),
)
def get_metrics(job_id: JobId, service: ServiceOf) -> MetricsView:
    """Accuracy, forces, timing and digest."""
    job = _finished(service.store.get(job_id))
    result = job.result or {}
    return MetricsView(
        job=job.id,
        status=result.get("status"),
        metrics=result.get("metrics") or {},
        timing=result.get("timing"),
        digest=result.get("digest"),
    )


@router.get(
    f"{_JOB}/series",
    operation_id="get_series",
    summary="State series of a finished job",
    tags=["results"],
    response_class=Response,
    responses={
        200: {
            "description": "One row per step, row 0 the initial state; SI units, world frame.",
            "content": {
                "application/json": {"schema": {"type": "object"}},
                "text/csv": {"schema": {"type": "string"}},
                NPZ: _BINARY,
            },
        },
        **documented(400, 404, 409, 410, 416),
    },
)
def get_series(
    job_id: JobId,
    service: ServiceOf,
    request: Request,
    format: Annotated[Literal["json", "csv", "npz"] | None, Query(description="Default: by Accept, else json.")] = None,
    names: Annotated[
        str | None,
        Query(max_length=2000, description="Comma-separated arrays; default: all that have one row per step."),
    ] = None,
    accept: Annotated[str | None, Header()] = None,
) -> Response:
    """As JSON or CSV, the arrays with one row per step; as npz the whole file, tissue frames included."""
    _finished(service.store.get_summary(job_id))
    artefact = _artefact(service, job_id, "series.npz")
    wanted = format or _accepted(accept)
    if wanted == "npz":
        return _served(request, service, artefact, media_type=NPZ, filename=f"{job_id}-series.npz")
    path = service.settings.data / artefact.path
    check_intact(path, sha256=artefact.sha256, size=artefact.bytes, name=artefact.name)
    try:
        arrays = series.load(path, names.split(",") if names else None)
        if wanted == "csv":
            return Response(series.as_csv(arrays), media_type="text/csv")
        return Response(series.as_json(arrays), media_type="application/json")
    except series.DamagedSeriesError as error:
        raise HttpError(404, f"series.npz of job {job_id} {error}") from None
    except ValueError as error:
        raise HttpError(422, str(error), errors=[Problem("names", names, str(error))]) from None


def _accepted(accept: str | None) -> str:
    """The first format that an Accept header names."""
    for item in (accept or "").split(","):
        media_type = item.partition(";")[0].strip().lower()
        if media_type in _FORMATS:
            return _FORMATS[media_type]
    return "json"


@router.get(
    f"{_JOB}/artefacts",
    operation_id="list_artefacts",
    summary="Files of a job",
    tags=["results"],
    responses=documented(404),
)
def list_artefacts(job_id: JobId, service: ServiceOf) -> ArtefactList:
    """Name, size and SHA-256 of each."""
    service.store.get_summary(job_id)
    return ArtefactList(items=[ArtefactView.of(job_id, item) for item in service.store.artefacts(job_id)])


@router.get(
    f"{_JOB}/artefacts/{{name}}",
    operation_id="get_artefact",
    summary="One file of a job",
    tags=["results"],
    response_class=FileResponse,
    responses={200: {"content": {"application/octet-stream": _BINARY}}, **documented(400, 404, 410, 416)},
)
def get_artefact(job_id: JobId, name: str, service: ServiceOf, request: Request) -> Response:
    """The file as the job wrote it; its name is one of the list of artefacts."""
    service.store.get_summary(job_id)
    artefact = _artefact(service, job_id, name)
    media_type = "application/json" if artefact.name.endswith(".json") else "application/octet-stream"
    return _served(request, service, artefact, media_type=media_type, filename=artefact.name)


@router.get(
    f"{_JOB}/zip",
    operation_id="get_job_zip",
    summary="Everything of a job in one archive",
    tags=["results"],
    response_class=Response,
    responses={
        200: {"description": "A ZIP archive, made while it is sent.", "content": {ZIP: _BINARY}},
        **documented(404, 409, 410),
    },
)
def get_job_zip(job_id: JobId, service: ServiceOf) -> Response:
    """Job, scenario, result, series, recording and the log of the last attempt, whatever there is of them; of a job
    that has ended."""
    job = service.store.get(job_id)
    if not job.terminal:
        detail = f"job {job.id} is {job.state}: its archive is made once it has ended"
        raise HttpError(409, detail, headers={"Retry-After": "1"}, code="result-pending")
    entries = open_parts(archive_parts(service, job))
    headers = {"Content-Disposition": f'attachment; filename="{job_id}.zip"', "Cache-Control": "no-cache"}
    if (length := zip_bytes(entries)) is not None:
        headers["Content-Length"] = str(length)
    stream = zip_stream(entries, at=job.finished_at or job.created_at)
    return StreamingResponse(stream, media_type=ZIP, headers=headers)


@router.get(
    f"{_JOB}/log",
    operation_id="get_log",
    summary="Log of a job",
    tags=["results"],
    response_class=PlainTextResponse,
    responses={200: {"content": {"text/plain": {"schema": {"type": "string"}}}}, **documented(404)},
)
def get_log(
    job_id: JobId,
    service: ServiceOf,
    attempt: Annotated[int | None, Query(ge=1, le=10**6, description="Default: the last one.")] = None,
) -> Response:
    """What an attempt has logged, warned and printed so far; of a long log, the last megabyte."""
    job = service.store.get_summary(job_id)
    wanted = replace(job, attempt=attempt or job.attempt)
    try:
        with (service.settings.data / wanted.folder / LOG).open("rb") as file:
            file.seek(max(0, file.seek(0, os.SEEK_END) - _LOG_BYTES))
            text = file.read(_LOG_BYTES)
    except OSError:
        raise HttpError(404, f"attempt {wanted.attempt} of job {job_id} left no log", code="result-absent") from None
    return PlainTextResponse(text.decode(errors="replace"), headers={"Cache-Control": "no-cache"})


@router.get(
    "/recordings/{job_id}.rrd",
    operation_id="get_recording",
    summary="Rerun recording of a job",
    tags=["results"],
    response_class=Response,
    responses={
        200: {"description": "The whole file, or a running job's as it grows.", "content": {RRD: _BINARY}},
        206: {"description": "A range of a complete file.", "content": {RRD: _BINARY}},
        304: {"description": "Unchanged."},
        **documented(400, 404, 410, 416),
    },
)
async def get_recording(
    job_id: JobId,
    service: ServiceOf,
    request: Request,
) -> Response:
    """The complete file once the job has ended; before that, a response that follows the growing file and ends with
    the job. Open either in the Rerun viewer."""
    job = await run_in_threadpool(service.store.get, job_id)
    if job.kind != INSERTION:
        raise HttpError(404, f"job {job_id} is a {job.kind}: it has no recording", code="result-absent")
    if not (job.spec or {})["scenario"]["recording"]["enabled"]:
        raise HttpError(404, f"job {job_id} was submitted with recording.enabled = false", code="result-absent")
    if not job.terminal:
        return StreamingResponse(_live(service, request, job), media_type=RRD, headers={"Cache-Control": "no-store"})
    artefact = await run_in_threadpool(_artefact, service, job_id, "recording.rrd")
    return await run_in_threadpool(_served, request, service, artefact, media_type=RRD)


def _live(service: Service, request: Request, job: Job) -> AsyncIterator[bytes]:
    def folder_of(now: Job) -> Path:
        return service.settings.data / now.folder / "recording.rrd"

    return tail(service, request, job, folder_of)


def _finished(job: Job) -> Job:
    """The job, if it has a result."""
    if job.state == FINISHED:
        return job
    if job.terminal:
        raise HttpError(404, f"job {job.id} is {job.state}: it has no result", code="result-absent")
    detail = f"job {job.id} is {job.state}: it has no result yet"
    raise HttpError(409, detail, headers={"Retry-After": "1"}, code="result-pending")


def _artefact(service: Service, job_id: str, name: str) -> Artefact:
    for artefact in service.store.artefacts(job_id):
        if artefact.name == name:
            return artefact
    raise HttpError(404, f"job {job_id} has no {name[:100]}", code="result-absent")


def _served(
    request: Request, service: Service, artefact: Artefact, *, media_type: str, filename: str | None = None
) -> Response:
    return served_file(
        request,
        service.settings.data / artefact.path,
        sha256=artefact.sha256,
        size=artefact.bytes,
        media_type=media_type,
        filename=filename,
    )
