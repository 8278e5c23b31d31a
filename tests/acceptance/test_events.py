"""Event streams through a real server: in order, resumable, ended with the job, no hindrance to a shutdown."""

from __future__ import annotations

import os
import signal
import threading
import time
from typing import TYPE_CHECKING, Any

import httpx2
import pytest

from needlebench import Client
from tests.acceptance.server import Server, running_server, until

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from service.client.client import JobEvent

pytestmark = pytest.mark.slow

STREAM = {"Accept": "text/event-stream"}


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    with running_server(tmp_path_factory.mktemp("data")) as running:
        yield running


def kinds(events: list[JobEvent]) -> list[str]:
    """Without progress."""
    return [event.kind for event in events if event.kind != "progress"]


def test_a_job_is_followed_from_its_submission_to_its_end(server: Server) -> None:
    job = server.client.submit({"name": "long"})
    seen: list[JobEvent] = []
    started = time.monotonic()
    for event in server.client.events(job.id):
        seen.append(event)
        if sum(one.kind == "progress" for one in seen) == 4:
            server.client.cancel(job.id)
    assert kinds(seen) == ["queued", "started", "cancel_requested", "cancelled"]
    told = [event for event in seen if event.kind == "progress"]
    assert len(told) <= 2 * (time.monotonic() - started) + 2
    assert all(event.id is None for event in told)
    steps = [event.progress.step for event in told if event.progress]
    assert steps == sorted(steps)
    assert steps[-1] > 0
    assert told[-1].progress is not None
    assert told[-1].progress.depth_mm == pytest.approx(0.1 * steps[-1])


def test_who_comes_back_gets_what_was_missed_and_nothing_twice(server: Server) -> None:
    job = server.client.submit({"name": "dies once"})
    first = next(server.client.events(job.id))
    until(lambda: server.client.job(job.id).terminal)
    rest = list(server.client.events(job.id, after=first.id or 0))
    assert kinds([first, *rest]) == ["queued", "started", "crashed", "started", "finished"]
    crash = next(event for event in rest if event.kind == "crashed")
    assert "exit code 9" in (crash.data or {})["reason"]


def test_all_jobs_are_followed_in_one_stream(server: Server) -> None:
    found: list[dict[str, Any]] = []
    with (
        httpx2.Client(trust_env=False) as http,
        http.stream("GET", f"{server.url}/api/v1/events", headers=STREAM) as all_,
    ):
        lines = all_.iter_lines()
        assert next(lines) == ": needlebench"
        jobs = [server.client.submit({"name": "quick"}).id for _ in range(2)]
        for line in lines:
            if line.startswith("data: "):
                found.append(httpx2.Response(200, content=line[6:].encode()).json())
            if sum(one.get("kind") == "finished" for one in found) == 2:
                break
    ids = [one["id"] for one in found if "id" in one]
    assert ids == sorted(set(ids))
    for job in jobs:
        assert [one["kind"] for one in found if one["job"] == job and "kind" in one] == [
            "queued",
            "started",
            "finished",
        ]


def test_open_streams_do_not_hold_up_a_shutdown_and_resume_after_it(tmp_path: Path) -> None:
    server = Server(tmp_path)
    port = int(server.url.rpartition(":")[2])
    job = server.running("long")
    seen: list[JobEvent] = []
    follower = Client(server.url)
    thread = threading.Thread(target=lambda: seen.extend(follower.events(job.id)))
    thread.start()
    with (
        httpx2.Client(trust_env=False) as http,
        http.stream("GET", f"{server.url}/api/v1/events", headers=STREAM) as all_,
    ):
        next(all_.iter_lines())
        assert server.stop(signal.SIGTERM) == 0
    with running_server(tmp_path, port=port) as again:
        until(lambda: again.client.job(job.id).attempt == 2)
        again.client.cancel(job.id)
        thread.join(timeout=60)
        assert not thread.is_alive()
    follower.close()
    assert kinds(seen) == ["queued", "started", "requeued", "started", "cancel_requested", "cancelled"]


def test_a_running_job_is_cancelled_before_its_end(server: Server) -> None:
    job = server.running("long")
    server.client.cancel(job.id)
    ended = server.client.wait(job.id, timeout_s=30)
    assert ended.state == "cancelled"
    assert ended.progress.step < ended.progress.steps


def test_a_worker_that_ignores_signals_is_stopped_all_the_same(server: Server) -> None:
    """The hard timeout ends the process, whatever it is doing."""
    job = server.client.submit({"name": "deaf"}, timeout_s=2)
    until(lambda: server.client.job(job.id).progress.step > 0)
    pid = server.worker_of(server.client.job(job.id))
    done = server.client.wait(job.id, timeout_s=30)
    assert (done.state, (done.error or {})["kind"]) == ("timed_out", "timed_out")
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_a_job_that_ran_out_of_time_is_run_again(server: Server) -> None:
    job = server.client.submit({"name": "long once"}, timeout_s=2)
    assert server.client.wait(job.id, timeout_s=30).state == "timed_out"
    assert server.client.retry(job.id).state == "queued"
    done = server.client.wait(job.id, timeout_s=30)
    assert (done.state, done.attempt, done.error) == ("finished", 2, None)
