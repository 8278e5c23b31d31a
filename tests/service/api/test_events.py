"""The log of jobs as a list; the stream is tested against a real server."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from service.api.routes.events import _advanced
from service.store.job import Outcome
from tests.service.http import finish, idle_service

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from starlette.testclient import TestClient

    from service.api.context import Service

JOBS = "/api/v1/jobs"


@pytest.fixture
def both(tmp_path: Path) -> Iterator[tuple[TestClient, Service]]:
    with idle_service(tmp_path) as pair:
        yield pair


def submit(http: TestClient) -> str:
    return str(http.post(JOBS, json={"scenario": "line"}).json()["id"])


def test_the_events_of_a_job_are_listed_from_any_number_on(both: tuple[TestClient, Service]) -> None:
    http, service = both
    other, job = submit(http), submit(http)
    http.post(f"{JOBS}/{other}/cancel")
    finish(service)
    items = http.get(f"{JOBS}/{job}/events").json()["items"]
    assert [item["kind"] for item in items] == ["queued", "started", "finished"]
    assert {item["job"] for item in items} == {job}
    rest = http.get(f"{JOBS}/{job}/events", params={"after": items[0]["id"]}).json()["items"]
    assert rest == items[1:]
    everything = http.get("/api/v1/events").json()["items"]
    assert [item["id"] for item in everything] == sorted(item["id"] for item in everything)
    assert {item["job"] for item in everything} == {job, other}


def test_a_browser_that_knows_all_of_an_ended_job_is_told_to_stop(both: tuple[TestClient, Service]) -> None:
    http, service = both
    job = submit(http)
    finish(service)
    last = http.get(f"{JOBS}/{job}/events").json()["items"][-1]["id"]
    headers = {"Accept": "text/event-stream", "Last-Event-ID": str(last)}
    assert http.get(f"{JOBS}/{job}/events", headers=headers).status_code == 204
    assert http.get(f"{JOBS}/{job}/events", headers={**headers, "Last-Event-ID": "x"}).status_code == 422


def test_an_ended_job_streams_its_whole_log_and_ends(both: tuple[TestClient, Service]) -> None:
    http, service = both
    job = submit(http)
    finish(service)
    answer = http.get(f"{JOBS}/{job}/events", headers={"Accept": "text/event-stream"})
    assert answer.headers["content-type"].startswith("text/event-stream")
    kinds = [line.removeprefix("event: ") for line in answer.text.splitlines() if line.startswith("event: ")]
    assert kinds == ["queued", "started", "finished"]
    assert answer.text.count("\nid: ") == 3


def test_a_job_that_failed_is_queued_again_and_one_that_did_not_is_refused(both: tuple[TestClient, Service]) -> None:
    http, service = both
    job = submit(http)
    url = f"{JOBS}/{job}"
    assert http.post(f"{url}/retry").status_code == 409
    running = service.store.claim()
    assert running is not None
    service.store.finish(running, Outcome(state="failed", error_kind="exception", error="x"))
    again = http.post(f"{url}/retry")
    assert (again.status_code, again.json()["state"], again.json()["error"]) == (202, "queued", None)
    done = finish(service)
    assert (done.id, done.attempt) == (job, 2)
    assert http.post(f"{url}/retry").status_code == 409
    kinds = [item["kind"] for item in http.get(f"{url}/events").json()["items"]]
    assert kinds == ["queued", "started", "failed", "queued", "started", "finished"]


def test_a_pinned_job_is_kept(both: tuple[TestClient, Service]) -> None:
    http, service = both
    url = f"{JOBS}/{submit(http)}"
    finish(service)
    for _ in range(2):
        assert http.post(f"{url}/pin").json()["pinned"] is True
    assert http.delete(url).status_code == 409
    for _ in range(2):
        assert http.delete(f"{url}/pin").status_code == 204
    assert http.get(url).json()["pinned"] is False
    assert http.delete(url).status_code == 204


def test_a_stream_tells_each_progress_once_and_remembers_no_job_that_has_ended(
    both: tuple[TestClient, Service],
) -> None:
    http, service = both
    versions: dict[str, int] = {}
    for _ in range(3):
        submit(http)
        started = service.store.claim()
        assert started is not None
        assert _advanced([started], versions) == []
        for step in (1, 2):
            service.store.beat(started, {"step": step, "steps": 2, "fraction": 0.5 * step})
            running = service.store.newest(state="running")
            assert [job.id for job in _advanced(running, versions)] == [started.id]
            assert _advanced(running, versions) == []
        assert list(versions) == [started.id]
        service.store.finish(started, Outcome(state="finished", result={}))
        assert _advanced(service.store.newest(state="running"), versions) == []
        assert versions == {}
