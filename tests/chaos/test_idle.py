"""Connections that say nothing, half a header or half a body, and streams that nobody reads, beside real work."""

from __future__ import annotations

import os
import socket
from contextlib import ExitStack
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import pytest

from tests.acceptance.server import running_server, until
from tests.chaos.conftest import CLIENTS
from tests.chaos.flat import Held

if TYPE_CHECKING:
    from pathlib import Path

_SHORT, _LONG = 60, 1000  # connections; half as many streams
_SPARE_DESCRIPTORS = 40  # the ten connections to the database that are kept hold three each
_BEGINNINGS = (
    b"",
    b"GET /api/v1/jobs HTTP/1.1\r\nHost: {host}\r\nX-Half",
    b"POST /api/v1/jobs HTTP/1.1\r\nHost: {host}\r\nContent-Type: application/json\r\nContent-Length: 500\r\n\r\n{",
)
_STREAM = b"GET /api/v1/events HTTP/1.1\r\nHost: {host}\r\nAccept: text/event-stream\r\n\r\n"


@pytest.fixture
def connections() -> int:
    """How many there are."""
    return _LONG if CLIENTS in os.environ else _SHORT


def test_idle_connections_and_streams(tmp_path: Path, connections: int, figures: dict[str, object]) -> None:
    with running_server(tmp_path) as server, ExitStack() as stack:
        address = urlsplit(server.url)
        client, host = server.client, address.netloc.encode()
        done = [client.wait(client.submit({"name": "quick"}).id, timeout_s=600)]
        before = Held.by(server.process.pid)

        def connect(beginning: bytes) -> None:
            one = stack.enter_context(socket.create_connection((str(address.hostname), address.port or 0), timeout=60))
            one.sendall(beginning.replace(b"{host}", host))

        for number in range(connections):
            connect(_BEGINNINGS[number % len(_BEGINNINGS)])
        for _ in range(connections // 2):
            connect(_STREAM)
        during = Held.by(server.process.pid)
        done += [client.wait(client.submit({"name": "quick"}).id, timeout_s=600) for _ in range(20)]
        assert {job.state for job in done} == {done[0].state}
        assert all(job.result is not None for job in done)
        assert client.ready()["status"] == "ready"
        stack.close()
        until(lambda: Held.by(server.process.pid).descriptors <= before.descriptors + _SPARE_DESCRIPTORS, pause_s=0.2)
        assert client.wait(client.submit({"name": "quick"}).id, timeout_s=600).result is not None
        after = Held.by(server.process.pid)
    figures.update(connections=connections, streams=connections // 2, jobs=len(done) + 1, lost=0)
    figures.update(descriptors=[before.descriptors, during.descriptors, after.descriptors])
    figures.update(memory_mb=[before.memory_mb, during.memory_mb, after.memory_mb])
