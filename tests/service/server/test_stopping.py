"""A service that is asked to stop ends, whatever its threads, workers and clients are at, and loses no job."""

from __future__ import annotations

import signal
import socket
import threading
from contextlib import suppress
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import httpx2
import pytest

from service.server.last_resort import LastResort
from tests.acceptance.server import Server, alive, running_server, until

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

STUCK = "tests.service.server.stuck_server"
FROZEN = "tests.service.server.frozen_server"


@pytest.fixture
def stuck() -> Iterator[threading.Thread]:
    """A thread that goes on until the test is over."""
    over = threading.Event()
    thread = threading.Thread(target=over.wait, name="stuck-one")
    yield thread
    over.set()
    thread.join()


def test_a_process_that_does_not_end_says_what_it_is_at_and_is_ended(
    stuck: threading.Thread, caplog: pytest.LogCaptureFixture
) -> None:
    ended = threading.Event()
    resort = LastResort(0.01, end=ended.set)
    stuck.start()
    resort.begin()
    assert ended.wait(30)
    assert "stuck-one in wait (threading.py:" in caplog.text


def test_a_process_whose_threads_end_is_left_alone(stuck: threading.Thread) -> None:
    stuck.start()
    ended = threading.Event()
    resort = LastResort(3600.0, end=ended.set)  # what began before is not waited for
    worker = threading.Thread(target=lambda: None)
    worker.start()
    resort.begin()
    resort.join_threads()
    until(lambda: all(thread.name != "last-resort" for thread in threading.enumerate()))
    assert not ended.is_set()
    assert not worker.is_alive()


def unread(url: str, path: str) -> socket.socket:
    """A connection that asks and takes nothing of the answer."""
    split = urlsplit(url)
    assert split.hostname
    connection = socket.create_connection((split.hostname, split.port or 80))
    connection.sendall(f"GET {path} HTTP/1.1\r\nHost: {split.netloc}\r\nAccept: text/event-stream\r\n\r\n".encode())
    return connection


@pytest.mark.slow
def test_a_stop_does_not_wait_for_threads_that_hang_and_puts_running_jobs_back(tmp_path: Path) -> None:
    server = Server(tmp_path, workers=1, main=STUCK)
    job = server.running("deaf")
    worker = server.worker_of(job)
    streams = [unread(server.url, path) for path in ("/api/v1/events", f"/api/v1/jobs/{job.id}?wait=60")]
    with suppress(httpx2.TimeoutException):
        httpx2.get(f"{server.url}/api/v1/keys", timeout=0.5, trust_env=False)
    server.process.send_signal(signal.SIGTERM)
    assert server.ended() == 0
    until(lambda: not alive(worker))
    for stream in streams:
        stream.close()
    with running_server(tmp_path, workers=1) as again:
        events = again.client._json("GET", f"/api/v1/jobs/{job.id}/events")["items"]
        assert [event["kind"] for event in events][:3] == ["queued", "started", "requeued"]
        again.client.cancel(job.id)


@pytest.mark.slow
def test_a_stop_spares_itself_the_last_collection_of_the_interpreter(tmp_path: Path) -> None:
    server = Server(tmp_path, workers=1, main=FROZEN)
    assert server.stop(signal.SIGTERM) == 0
    assert int((tmp_path / "frozen").read_text()) > 10_000
