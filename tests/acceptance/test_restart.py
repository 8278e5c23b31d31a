"""The server is stopped and killed; nothing is lost and nobody is left behind."""

from __future__ import annotations

import signal
import socket
import sys
from typing import TYPE_CHECKING

import pytest

from service.server.server import ServiceStartError, serve
from service.settings import Settings
from service.store.job import MAXIMUM_DEATHS, SUSPECT_DEATHS
from tests.acceptance.server import Server, alive, children, running_server, until

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.slow

linux = pytest.mark.skipif(sys.platform != "linux", reason="reads the process table")


@linux
@pytest.mark.slow
def test_after_kill_9_everything_is_found_again_and_nobody_is_left(tmp_path: Path) -> None:
    server = Server(tmp_path)
    finished = server.client.wait(server.client.submit({"name": "quick"}).id)
    running = server.running("long")
    blocker = server.running("long")
    queued = server.client.submit({"name": "quick"})
    family = children(server.process.pid)
    assert len(family) >= 2
    assert server.stop(signal.SIGKILL) == -signal.SIGKILL
    until(lambda: not any(alive(pid) for pid in family))

    with running_server(tmp_path) as again:
        assert again.client.job(finished.id).result == finished.result
        assert again.client.series(finished.id, tmp_path / "s.npz").stat().st_size > 0
        for job in (running, blocker):
            until(lambda job=job: again.client.job(job.id).attempt == 2)  # type: ignore[misc]
            again.client.cancel(job.id)
        assert again.client.wait(queued.id).attempt == 1


@linux
@pytest.mark.slow
def test_sigterm_puts_running_jobs_back_and_ends_with_0(tmp_path: Path) -> None:
    server = Server(tmp_path)
    job = server.running("long")
    worker, family = server.worker_of(job), children(server.process.pid)
    assert server.stop(signal.SIGTERM) == 0
    assert not alive(worker)
    until(lambda: not any(alive(pid) for pid in family))  # multiprocessing's own tracker ends a moment after the server
    with running_server(tmp_path) as again:
        until(lambda: again.client.job(job.id).attempt == 2)
        again.client.cancel(job.id)
        assert again.client.wait(job.id, timeout_s=30).state == "cancelled"


@linux
@pytest.mark.slow
def test_a_job_that_fells_the_server_is_given_up_and_lets_the_others_run_first(tmp_path: Path) -> None:
    server = Server(tmp_path, workers=1)
    poison = server.client.submit({"name": "fells the server"})
    other = server.client.submit({"name": "quick"})
    deaths = []
    for _ in range(MAXIMUM_DEATHS):
        deaths.append(server.ended())
        server = Server(tmp_path, workers=1)
        if len(deaths) == SUSPECT_DEATHS:
            until(lambda: server.client.job(other.id).state == "finished", pause_s=0.01)  # noqa: B023
    try:
        assert deaths == [-signal.SIGKILL] * MAXIMUM_DEATHS
        done = server.client.job(poison.id)
        assert (done.state, done.attempt) == ("failed", MAXIMUM_DEATHS)
        assert "the server died" in (done.error or {})["message"]
        assert server.client.wait(server.client.submit({"name": "quick"}).id).state == "finished"
    finally:
        server.stop()


@linux
@pytest.mark.slow
def test_a_job_that_fells_its_worker_is_given_up_after_three_attempts_across_restarts(tmp_path: Path) -> None:
    with running_server(tmp_path, workers=1) as server:
        job = server.client.submit({"name": "dies late"})
        until(lambda: server.client.job(job.id).attempt == 2)
    with running_server(tmp_path, workers=1) as again:
        done = again.client.wait(job.id, timeout_s=60)
        assert (done.state, (done.error or {})["kind"]) == ("failed", "worker_died")
        assert done.attempt in (3, 4)  # one attempt more where the stop came before the crash
        kinds = [event["kind"] for event in again.client._json("GET", f"/api/v1/jobs/{job.id}/events")["items"]]
        assert kinds.count("crashed") == 2
        assert again.client.wait(again.client.submit({"name": "quick"}).id).state == "finished"


def test_two_services_never_share_a_data_folder(tmp_path: Path) -> None:
    with running_server(tmp_path) as server, pytest.raises(ServiceStartError, match="is in use by another") as caught:
        serve(Settings(data=tmp_path, port=0), announce=print)
    assert server.url in str(caught.value)
    assert "--data" in str(caught.value)


def test_a_taken_port_is_refused_when_it_was_asked_for(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as holder, pytest.raises(ServiceStartError, match="--port"):
        serve(Settings(data=tmp_path, port=holder.getsockname()[1]), announce=print)
