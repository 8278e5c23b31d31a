"""Routes for those who run the service: what a monitor reads, and clearing away old jobs."""

from __future__ import annotations

from fastapi import APIRouter, Response
from prometheus_client import CONTENT_TYPE_LATEST

from service.access import admin_only
from service.api.context import ServiceOf, documented
from service.api.schemas.operations import ClearedView, ClearRequest
from service.engine import retention

router = APIRouter(tags=["service"])


@router.get(
    "/metrics",
    operation_id="get_monitoring",
    summary="Figures for Prometheus",
    response_class=Response,
    responses={200: {"content": {"text/plain": {"schema": {"type": "string"}}}}, **documented()},
)
def get_monitoring(service: ServiceOf) -> Response:
    """Jobs by state, waiting and run times, workers, answers by route, disk, memory and build."""
    return Response(service.monitor.text(), media_type=CONTENT_TYPE_LATEST)


@router.post(
    "/api/v1/gc",
    operation_id="clear_jobs",
    summary="Clear away old jobs",
    responses=documented(400, 403, 413, 415),
    **admin_only(),
)
def clear_jobs(body: ClearRequest, service: ServiceOf) -> ClearedView:
    """Delete jobs that have ended, with their files, by age, number or size; pinned ones stay. With an age, uploads of
    that age go too that no job, campaign, schedule or model names which stays. Folders without a job go in any case."""
    policy = retention.Policy(older_than_s=body.older_than_s, keep_last=body.keep_last, max_bytes=body.max_bytes)
    cleared = retention.clear(
        service.store, service.settings.jobs, policy, dry_run=body.dry_run, uploads=service.uploads
    )
    return ClearedView.of(cleared)
