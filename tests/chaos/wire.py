"""Requests as bytes on a socket: nothing on the way corrects what is wrong with them."""

from __future__ import annotations

import gzip
import http.client
import socket
import time
from contextlib import suppress
from dataclasses import dataclass
from urllib.parse import urlsplit

PATIENCE_S = 120.0  # of a machine that has much else to do
_STREAM_BYTES = 200  # of an endless answer that are read
_ENDLESS = "text/event-stream"


@dataclass(frozen=True)
class Request:
    """One request. target, header names and values: as they go over the wire. body: None = no Content-Length.

    filler: bytes that come so many times after `body`, before `end`: thousands of large bodies are kept.
    """

    method: str
    target: str
    headers: tuple[tuple[str, str], ...] = ()
    body: bytes | None = None
    filler: tuple[bytes, int] = (b"", 0)
    end: bytes = b""

    @property
    def whole_body(self) -> bytes | None:
        """What follows the headers."""
        return None if self.body is None else self.body + self.filler[0] * self.filler[1] + self.end

    def encode(self, host: str) -> bytes:
        """The bytes; Host, Content-Length and Connection are added where they are not given."""
        given = {name.lower() for name, _ in self.headers}
        own = {"host": host, "connection": "close"}
        body = self.whole_body
        if body is not None and "transfer-encoding" not in given:
            own["content-length"] = str(len(body))
        headers = [*((name, value) for name, value in own.items() if name not in given), *self.headers]
        lines = [f"{self.method} {self.target} HTTP/1.1", *(f"{name}: {value}" for name, value in headers)]
        return "\r\n".join((*lines, "", "")).encode("latin-1", "replace") + (body or b"")


@dataclass(frozen=True)
class Answer:
    """What came back: status, media type, the body or its beginning, and how long that took."""

    status: int
    media_type: str
    body: bytes
    took_s: float


def ask(url: str, request: Request) -> Answer:
    """Send and read, of an endless answer only the beginning. Raises OSError, http.client.HTTPException."""
    place = urlsplit(url)
    started = time.monotonic()
    with socket.create_connection((place.hostname or "", place.port or 0), timeout=PATIENCE_S) as connection:
        with suppress(BrokenPipeError, ConnectionResetError):  # refused before all was sent: the answer is there
            connection.sendall(request.encode(place.netloc))
        answer = http.client.HTTPResponse(connection, method=request.method)
        answer.begin()
        kind = (answer.headers.get("content-type") or "").partition(";")[0]
        body = answer.read(_STREAM_BYTES) if kind == _ENDLESS else answer.read()
        if answer.headers.get("content-encoding") == "gzip" and kind != _ENDLESS and body:
            body = gzip.decompress(body)
        return Answer(answer.status, kind, body, time.monotonic() - started)
