"""Events of jobs as they happen: a stream of server-sent events that can be resumed, or a list.

A stream that falls too far behind ends with the event `dropped`, which says after which event it may begin again.

The log of a job holds its changes of state. Progress is in the stream only, without a number: a client that resumes
after the last event it has seen gets each later change of state once, and the current progress.
"""

from __future__ import annotations

import json
from collections.abc import AsyncIterator
from typing import Annotated, Any

from fastapi import APIRouter, Header, Query, Request, Response
from fastapi.sse import KEEPALIVE_COMMENT, EventSourceResponse, format_sse_event
from starlette.concurrency import run_in_threadpool

from service.api.context import Service, ServiceOf
from service.api.event_hub import BATCH, EncodedEvent, progress_event
from service.api.openapi import documented
from service.api.parameters import JobId
from service.api.schemas.jobs import EventList, EventView
from service.store.job import ASIDE, TERMINAL, Job

router = APIRouter(prefix="/api/v1", tags=["events"])

STREAM = "text/event-stream"
KEEP_ALIVE_S = 10.0
_RETRY_MS = 1000  # what a browser waits before it connects again

After = Annotated[int | None, Query(ge=0, le=2**62, description="Only events after this number.")]
LastEventId = Annotated[
    str | None,
    Header(alias="Last-Event-ID", pattern="^[0-9]{1,18}$", description="As `after`; browsers send it on their own."),
]
_BOTH: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "A list; with `Accept: text/event-stream` a stream.",
        "content": {STREAM: {"schema": {"type": "string"}}},
    }
}
_NO_MORE: dict[int | str, dict[str, Any]] = {204: {"description": "The job has ended and all of its events were sent."}}


@router.get(
    "/jobs/{job_id}/events",
    operation_id="get_job_events",
    summary="Events of a job",
    response_model=EventList,
    responses={**_BOTH, **_NO_MORE, **documented(404)},
)
async def get_job_events(
    job_id: JobId,
    service: ServiceOf,
    request: Request,
    after: After = None,
    last_event_id: LastEventId = None,
    accept: Annotated[str | None, Header()] = None,
) -> Response:
    """Kinds: queued, started, progress, requeued, crashed, cancel_requested, finished, failed, cancelled, timed_out.

    As a stream it ends after the event that ends the job. Progress comes at most twice a second and has no id.
    """
    job = await run_in_threadpool(service.store.get_summary, job_id)
    known = int(last_event_id) if last_event_id is not None else after or 0
    if not _streams(accept):
        return await _list(service, job_id, known)
    reconnected = job.terminal and last_event_id is not None
    if reconnected and not await run_in_threadpool(service.store.events, job_id, after=known, limit=1):
        return Response(status_code=204)  # tells a browser to stop connecting again
    return _stream(service, request, job_id, known)


@router.get(
    "/events",
    operation_id="get_events",
    summary="Events of all jobs",
    response_model=EventList,
    responses={**_BOTH, **documented()},
)
async def get_events(
    service: ServiceOf,
    request: Request,
    after: After = None,
    last_event_id: LastEventId = None,
    accept: Annotated[str | None, Header()] = None,
) -> Response:
    """Of every job, later ones included; a stream without `after` begins with the next event."""
    known = int(last_event_id) if last_event_id is not None else after
    if not _streams(accept):
        return await _list(service, None, known or 0)
    if known is None:
        known = await run_in_threadpool(service.store.last_event)
    return _stream(service, request, None, known)


def _streams(accept: str | None) -> bool:
    return STREAM in (accept or "").lower()


async def _list(service: Service, job_id: str | None, after: int) -> Response:
    events = await run_in_threadpool(service.store.events, job_id, after=after)
    listed = EventList(items=[EventView.of(event) for event in events])
    return Response(listed.model_dump_json(), media_type="application/json")


def _stream(service: Service, request: Request, job_id: str | None, after: int) -> Response:
    headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
    return EventSourceResponse(_events(service, request, job_id, after), headers=headers)


async def _events(service: Service, request: Request, job_id: str | None, after: int) -> AsyncIterator[bytes]:
    """The events after number `after`, with progress between them, until there can be no more."""
    yield format_sse_event(comment="needlebench", retry=_RETRY_MS)
    with service.events.subscribe(job_id) as waiting:
        await service.events.ready()
        async for earlier in _before(service, job_id, after):
            after = earlier.seq
            yield earlier.data
            if job_id is not None and await _is_last(service, earlier):
                return
        for job in await run_in_threadpool(_running, service, job_id):
            yield progress_event(job)
        while not (waiting.dropped or service.changes.closed or await request.is_disconnected()):
            if (event := waiting.next_event(after)) is not None:
                after = event.seq
                yield event.data
                if job_id is not None and await _is_last(service, event):
                    return
            elif waiting.progress:
                yield waiting.progress.pop(next(iter(waiting.progress)))
            elif not await waiting.more(KEEP_ALIVE_S):
                yield KEEPALIVE_COMMENT
        if not service.changes.closed:
            yield format_sse_event(event="dropped", data_str=json.dumps({"after": after}))


async def _before(service: Service, job_id: str | None, after: int) -> AsyncIterator[EncodedEvent]:
    """What was committed when the stream began, batch by batch."""
    while True:
        events = await run_in_threadpool(service.store.events, job_id, after=after, limit=BATCH)
        for event in events:
            after = event.seq
            yield EncodedEvent.of(event)
        if len(events) < BATCH:
            return


def _running(service: Service, job_id: str | None) -> list[Job]:
    """The jobs that run now and have shown progress."""
    return [job for job in service.store.running() if job.progress and job_id in (None, job.id)]


async def _is_last(service: Service, event: EncodedEvent) -> bool:
    """Whether this event ended the job for good: it has not been queued again since."""
    if event.kind == "deleted":
        return True
    if event.kind not in TERMINAL:
        return False
    later = await run_in_threadpool(service.store.events, event.job_id, after=event.seq)
    return not any(one.kind not in ASIDE for one in later)
