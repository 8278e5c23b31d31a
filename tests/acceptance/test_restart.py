"""The server is stopped and killed; nothing is lost and nobody is left behind."""

from __future__ import annotations

import signal
import socket
import sys
from pathlib import Path

import pytest

from service.server.server import ServiceStartError, serve
from service.settings import Settings
from tests.acceptance.server import Server, alive, children, running_server, until

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


def test_two_services_never_share_a_data_folder(tmp_path: Path) -> None:
    with running_server(tmp_path) as server, pytest.raises(ServiceStartError, match="is in use by another") as caught:
        serve(Settings(data=tmp_path, port=0), announce=print)
    assert server.url in str(caught.value)
    assert "--data" in str(caught.value)


def test_a_taken_port_is_refused_when_it_was_asked_for(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as holder, pytest.raises(ServiceStartError, match="--port"):
        serve(Settings(data=tmp_path, port=holder.getsockname()[1]), announce=print)
