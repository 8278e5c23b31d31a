"""What is overridden inside uvicorn, the HTTP server; written for the versions named here."""

from __future__ import annotations

import asyncio
import logging
import math
import time
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, cast

import httptools
import uvicorn
from uvicorn.protocols.http.httptools_impl import STATUS_LINE, HttpToolsProtocol

from service import logs
from service.api.middleware.key_guard import PEER
from service.api.problems import problem_response
from service.app import create_app
from service.files.endpoint import write_endpoint
from service.server.peer_account import Peer

if TYPE_CHECKING:
    import socket
    from collections.abc import Callable
    from types import FrameType

    from service.api.context import Service
    from service.server.last_resort import LastResort

WRITTEN_FOR = ("uvicorn", "0.54", "0.55")  # from this version, below that one
_log = logging.getLogger(logs.ROOT)
_GRACE_S = 3
_IDLE_S = 75  # that a connection is kept: who asks every few seconds need not connect again
MAXIMUM_OVERHEAD_BYTES = 65_536  # of a request: what it is beside its body; the parser itself would take any amount


@dataclass(frozen=True, kw_only=True)
class ConnectionLimits:
    """How many connections there may be, and how long each may keep the service waiting, s.

    header_s: until a request's headers are there. body_s: in each such span at least `body_bytes` of a body arrive.
    stall_s: without the other end taking anything of an answer that does not fit into the buffers any more.
    """

    connections: int = 2000
    header_s: float = 15.0
    body_s: float = 30.0
    body_bytes: int = 30_000
    stall_s: float = 60.0


class Protocol(HttpToolsProtocol):
    """Refuses bytes that are no request, and requests that do not come to their end, with a problem; then closes.

    When there are too many connections, the one that has waited longest without a request makes room for a new one.
    """

    _left = MAXIMUM_OVERHEAD_BYTES

    def __init__(self, *arguments: Any, limits: ConnectionLimits | None = None, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self._limits = limits or ConnectionLimits()
        self._deadline: asyncio.TimerHandle | None = None  # for the headers or the body of a request
        self._stall: asyncio.TimerHandle | None = None
        self._body_bytes = 0  # since the last look
        self._headers_known = False  # of the request at hand
        self.waiting_since = self.loop.time()
        self._peer: Peer | None = None

    # -- connections

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Make room if need be; the first request must come soon."""
        super().connection_made(transport)
        if len(self.connections) > self._limits.connections and not self._make_room():
            self._refuse(503, "too many connections", code="busy")
            return
        if self.client is not None and self.server is not None and self.server[1] is not None:
            self._peer = Peer(self.client, (self.server[0], self.server[1]))
        self._await(self._limits.header_s, self._no_request)

    def _make_room(self) -> bool:
        """Close the connection that has waited longest for a request; whether there was one."""
        waiting = [one for one in self.connections if one is not self and isinstance(one, Protocol) and one.waits]
        if waiting:
            oldest = min(waiting, key=lambda one: one.waiting_since)
            self.connections.discard(oldest)  # at once: the loop gets round to its end later
            oldest.transport.abort()
        return bool(waiting)

    @property
    def waits(self) -> bool:
        """Whether no request of it is being answered."""
        return self.cycle is None or self.cycle.response_complete

    def connection_lost(self, exc: Exception | None) -> None:
        """Nothing is waited for any more."""
        self._await(None)
        self.resume_writing()
        super().connection_lost(exc)

    # -- time

    def _await(self, seconds: float | None, otherwise: Callable[[], None] | None = None) -> None:
        """Call `otherwise` after so many seconds, in place of what was waited for before; None = of nothing."""
        if self._deadline is not None:
            self._deadline.cancel()
        self._deadline = None if seconds is None or otherwise is None else self.loop.call_later(seconds, otherwise)

    def _no_request(self) -> None:
        self._deadline = None
        if self._left == MAXIMUM_OVERHEAD_BYTES:  # not a byte: nobody to be told
            self.transport.close()
        else:
            self._refuse(408, f"the headers did not arrive within {self._limits.header_s:g} s")

    def _look_at_body(self) -> None:
        """Whether enough of the body came since the last look; as long as the service itself does not read, it has."""
        if self._body_bytes < self._limits.body_bytes and not self.flow.read_paused:
            self._deadline = None
            self._refuse(408, f"the body came to a halt: less than {self._limits.body_bytes} bytes in a span")
            return
        self._body_bytes = 0
        self._await(self._limits.body_s, self._look_at_body)

    def pause_writing(self) -> None:
        """The other end takes nothing: it may do so for a while."""
        super().pause_writing()
        if self._stall is None:
            self._stall = self.loop.call_later(self._limits.stall_s, self.transport.abort)

    def resume_writing(self) -> None:
        """It goes on."""
        if self._stall is not None:
            self._stall.cancel()
            self._stall = None
        super().resume_writing()

    # -- requests

    def data_received(self, data: bytes) -> None:
        """Count what is no body; refuse too much of it."""
        self._left -= len(data)
        super().data_received(data)
        if self._left < 0 and not self.transport.is_closing():
            self._refuse(431, f"the headers are longer than {MAXIMUM_OVERHEAD_BYTES} bytes")

    def on_message_begin(self) -> None:
        """A request begins: its headers must come soon."""
        super().on_message_begin()
        self._headers_known = False
        if self._deadline is None and not self.transport.is_closing():
            self._await(self._limits.header_s, self._no_request)

    def on_header(self, name: bytes, value: bytes) -> None:
        """One field of the header; those after the body are dropped, which nobody has looked at who guards it."""
        if not self._headers_known:
            super().on_header(name, value)

    def on_headers_complete(self) -> None:
        """The request is known; what is waited for now is its body."""
        self._headers_known = True
        self._take_target()
        self.scope[PEER] = self._peer  # type: ignore[literal-required]
        self._body_bytes = 0
        self._await(self._limits.body_s, self._look_at_body)
        super().on_headers_complete()

    def _take_target(self) -> None:
        """Of an address with a host, that host counts and not the Host header (RFC 9112, 3.2.2)."""
        if self.url.startswith(b"/"):
            return
        parsed = httptools.parse_url(self.url)
        if parsed.host is None or parsed.path is None:
            raise httptools.HttpParserError("the address is no path")
        port = b"" if parsed.port is None else b":%d" % parsed.port
        host = b"[%s]" % parsed.host if b":" in parsed.host else parsed.host
        self.headers[:] = [(name, value) for name, value in self.headers if name != b"host"]
        self.headers.append((b"host", host + port))

    def on_body(self, body: bytes) -> None:
        """A body pays for itself."""
        self._left += 2 * len(body)  # as much again for the marks between its chunks
        self._body_bytes += len(body)
        super().on_body(body)

    def on_message_complete(self) -> None:
        """The next request of the connection counts from zero."""
        self._left = MAXIMUM_OVERHEAD_BYTES
        self._await(None)
        super().on_message_complete()

    def on_response_complete(self) -> None:
        """From now on it waits."""
        self.waiting_since = self.loop.time()
        super().on_response_complete()

    def send_400_response(self, msg: str) -> None:  # noqa: ARG002  (uvicorn's signature)
        """A problem in place of uvicorn's own text."""
        self._refuse(400, "this is not a valid HTTP request")

    def _refuse(self, status: int, detail: str, *, code: str | None = None) -> None:
        if self.cycle is None or self.cycle.response_complete or not self.cycle.response_started:
            answer = problem_response(status, detail, headers={"Connection": "close"}, code=code)
            fields = (name + b": " + value + b"\r\n" for name, value in answer.raw_headers)
            self.transport.write(b"".join((STATUS_LINE[status], *fields, b"\r\n", bytes(answer.body))))
        if self.cycle is not None and not self.cycle.response_complete:
            self.cycle.disconnected = True  # whoever answers it writes nothing more
            self.cycle.message_event.set()
        self._await(None)
        self.transport.close()


class Server(uvicorn.Server):
    """uvicorn, which announces where it listens, drains as long as the settings say and ends long polls at once.

    announce: hears `url` once the service listens and the data folder says so. last_resort: what bounds its shutdown.
    most_connections: at a time.
    """

    def __init__(
        self,
        service: Service,
        url: str,
        announce: Callable[[str], None],
        last_resort: LastResort,
        *,
        most_connections: int = 2000,
    ) -> None:
        limits = ConnectionLimits(connections=most_connections)
        config = uvicorn.Config(
            create_app(service),
            http=cast("type[asyncio.Protocol]", partial(Protocol, limits=limits)),
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
        self._last_resort = last_resort
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
        """End jobs, streams, long polls and live recordings, all at once; then the rest."""
        self._last_resort.begin()
        self._service.begin_to_stop()
        await super().shutdown(sockets=sockets)
