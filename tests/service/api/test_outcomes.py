"""Outcomes of jobs that finished: in the API, its lists and the page of jobs."""

from __future__ import annotations

from typing import TYPE_CHECKING, get_args

import pytest

from service.api.schemas import jobs as jobs_schema
from service.store.job import OUTCOMES, Outcome
from tests.service.http import idle_service

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from starlette.testclient import TestClient

    from service.api.context import Service


@pytest.fixture
def both(tmp_path: Path) -> Iterator[tuple[TestClient, Service]]:
    with idle_service(tmp_path) as pair:
        yield pair


def submit(http: TestClient) -> None:
    assert http.post("/api/v1/jobs", json={"scenario": "line"}).status_code == 202


def end_with(service: Service, status: str, *, success: bool = False) -> str:
    """End the next job with this status; its id."""
    job = service.store.claim()
    assert job is not None
    result = {"status": status, "metrics": {"success": success}, "timing": {}, "digest": "ab"}
    service.store.finish(job, Outcome(state="finished", result=result))
    return job.id


def test_every_status_of_a_run_is_an_outcome() -> None:
    assert get_args(jobs_schema.Outcome) == OUTCOMES


@pytest.mark.slow
def test_jobs_are_listed_by_outcome(both: tuple[TestClient, Service]) -> None:
    http, service = both
    for _ in range(4):
        submit(http)
    ends = [end_with(service, "completed", success=True), end_with(service, "completed"), end_with(service, "buckled")]
    for outcome, job_id in zip(("success", "missed", "buckled"), ends, strict=True):
        (found,) = http.get("/api/v1/jobs", params={"outcome": outcome}).json()["items"]
        assert (found["id"], found["state"], found["outcome"]) == (job_id, "finished", outcome)
    assert http.get("/api/v1/jobs", params={"outcome": "inverted"}).json()["items"] == []
    assert http.get("/api/v1/jobs", params={"state": "queued"}).json()["items"][0]["outcome"] is None
    refused = http.get("/api/v1/jobs", params={"outcome": "succeeded"})
    assert refused.status_code == 422
    assert "target_lost" in refused.text


@pytest.mark.slow
def test_the_page_of_jobs_filters_by_outcome(both: tuple[TestClient, Service]) -> None:
    http, service = both
    for _ in range(2):
        submit(http)
    lost, won = end_with(service, "target_lost"), end_with(service, "completed", success=True)
    page = http.get("/?outcome=target_lost").text
    assert lost in page
    assert won not in page
    assert 'href="/?outcome=success"' in page
    assert "target lost" in page
