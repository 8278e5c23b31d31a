"""What is overridden inside uvicorn, the HTTP server; written for the versions named here."""

from __future__ import annotations

import asyncio
import logging
import math
import socket
import time
from collections.abc import Callable
from types import FrameType

import uvicorn
from uvicorn.protocols.http.httptools_impl import STATUS_LINE, HttpToolsProtocol

from service import logs
from service.api.context import Service
from service.api.problems import problem_response
from service.app import create_app
from service.server.endpoint import write_endpoint

WRITTEN_FOR = ("uvicorn", "0.54", "0.55")  # from this version, below that one
_log = logging.getLogger(logs.ROOT)
_GRACE_S = 3
_IDLE_S = 75  # that a connection is kept: who asks every few seconds need not connect again
MAXIMUM_OVERHEAD_BYTES = 65_536  # of a request: what it is beside its body; the parser itself would take any amount


class Protocol(HttpToolsProtocol):
    """Refuses bytes that are no request, and requests that do not come to their body, with a problem; then closes."""

    _left = MAXIMUM_OVERHEAD_BYTES

    def data_received(self, data: bytes) -> None:
        """Count what is no body; refuse too much of it."""
        self._left -= len(data)
        super().data_received(data)
        if self._left < 0 and not self.transport.is_closing():
            self._refuse(431, f"the headers are longer than {MAXIMUM_OVERHEAD_BYTES} bytes")

    def on_body(self, body: bytes) -> None:
        """A body pays for itself."""
        self._left += 2 * len(body)  # as much again for the marks between its chunks
        super().on_body(body)

    def on_message_complete(self) -> None:
        """The next request of the connection counts from zero."""
        self._left = MAXIMUM_OVERHEAD_BYTES
        super().on_message_complete()

    def send_400_response(self, msg: str) -> None:
        """A problem in place of uvicorn's own text."""
        self._refuse(400, "this is not a valid HTTP request")

    def _refuse(self, status: int, detail: str) -> None:
        if self.cycle is None or self.cycle.response_complete or not self.cycle.response_started:
            answer = problem_response(status, detail, headers={"Connection": "close"})
            fields = (name + b": " + value + b"\r\n" for name, value in answer.raw_headers)
            self.transport.write(b"".join((STATUS_LINE[status], *fields, b"\r\n", bytes(answer.body))))
        self.transport.close()


class Server(uvicorn.Server):
    """uvicorn, which announces where it listens, drains as long as the settings say and ends long polls at once.

    announce: hears `url` once the service listens and the data folder says so.
    """

    def __init__(self, service: Service, url: str, announce: Callable[[str], None]) -> None:
        config = uvicorn.Config(
            create_app(service),
            http=Protocol,
            ws="none",
            log_config=None,
            log_level="warning",
            access_log=False,
            server_header=False,
            timeout_graceful_shutdown=_GRACE_S,
            timeout_keep_alive=_IDLE_S,
            lifespan="on",
        )
        super().__init__(config)
        self._service, self._url, self._announce = service, url, announce
        self._drain_until = -math.inf

    async def on_tick(self, counter: int) -> bool:
        """Whether to shut down: asked to, and what was to be waited for has ended."""
        return await super().on_tick(counter) and self._drained()

    def _drained(self) -> bool:
        engine, now = self._service.engine, time.monotonic()
        if not engine.draining:
            engine.drain()
            self._drain_until = now + self._service.settings.drain_s
        return engine.busy == 0 or now >= self._drain_until

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """A second signal ends the waiting for running jobs, a third one uvicorn's."""
        if self.should_exit and time.monotonic() < self._drain_until:
            self._drain_until = -math.inf
            return
        super().handle_exit(sig, frame)

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Listen, then say where."""
        await super().startup(sockets=sockets)
        if self.started:
            data = self._service.settings.data
            try:
                await asyncio.to_thread(write_endpoint, data, self._url)
            except OSError as error:  # a full disk: clients must then be given the address by hand
                _log.warning("the address cannot be written to the data folder: %s", error)
            self._announce(self._url)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End long polls and live recordings, then the rest."""
        self._service.changes.close()
        await super().shutdown(sockets=sockets)
