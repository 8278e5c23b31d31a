"""Routes for operators: figures for a monitor, and the removal of old jobs."""

from __future__ import annotations

from fastapi import APIRouter, Response
from prometheus_client import CONTENT_TYPE_LATEST

from service.api.context import ServiceOf, admin_only
from service.api.json_bodies import JsonBodyRoute
from service.api.openapi import documented
from service.api.schemas.operations import ClearedView, ClearRequest
from service.engine import retention

router = APIRouter(tags=["service"], route_class=JsonBodyRoute)


@router.get(
    "/metrics",
    operation_id="get_monitoring",
    summary="Figures for Prometheus",
    response_class=Response,
    responses={200: {"content": {"text/plain": {"schema": {"type": "string"}}}}, **documented()},
)
def get_monitoring(service: ServiceOf) -> Response:
    """Jobs by state, waiting and run times, workers, responses by route, disk, memory and build."""
    return Response(service.monitor.text(), media_type=CONTENT_TYPE_LATEST)


@router.post(
    "/api/v1/gc",
    operation_id="clear_jobs",
    summary="Remove old jobs",
    responses=documented(400, 403, 413, 415),
    **admin_only(),
)
def clear_jobs(body: ClearRequest, service: ServiceOf) -> ClearedView:
    """Delete jobs that have ended, with their files, by age, number or size; pinned ones are kept. With an age, uploads
    of that age are deleted too unless a remaining job, campaign, schedule or model uses them. Folders without a job
    are deleted in any case."""
    policy = retention.Policy(older_than_s=body.older_than_s, keep_last=body.keep_last, max_bytes=body.max_bytes)
    cleared = retention.clear(
        service.store, service.settings.jobs, policy, dry_run=body.dry_run, uploads=service.uploads
    )
    return ClearedView.of(cleared)
