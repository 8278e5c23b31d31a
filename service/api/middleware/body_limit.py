"""Refuses bodies that are too long or compressed, and lets large ones in one at a time. A plain ASGI layer."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping

from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.api.problems import problem_response

LARGE_BYTES = 65_536  # above: checking such a body may take a second of the processor
WAITING_BYTES = 64_000_000  # of bodies that have arrived and are not answered yet, all together
_NOT_COMPRESSED = ("", "identity")


class BodyLimit:
    """Refuses a body above `maximum_bytes`, by its declared length or as it arrives. exceptions: path -> its limit.

    A body arrives as a whole before anything looks at it, and large ones are then looked at one after the other, so
    that the requests of others are answered meanwhile. Those of `exceptions` are passed on as they arrive.
    """

    def __init__(self, app: ASGIApp, *, maximum_bytes: int, exceptions: Mapping[str, int]) -> None:
        self._app = app
        self._maximum_bytes = maximum_bytes
        self._exceptions = exceptions
        self._large = asyncio.Semaphore(1)
        self._waiting_bytes = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request (ASGI)."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        if headers.get("content-encoding", "").strip().lower() not in _NOT_COMPRESSED:
            detail = "compressed bodies are not taken: send it as it is, without Content-Encoding"
            accepted = {"Accept-Encoding": "identity"}
            refusal = problem_response(415, detail, instance=scope["path"], headers=accepted, code="body-encoding")
            await refusal(scope, receive, send)
            return
        if headers.get("transfer-encoding", "chunked").strip().lower() != "chunked":
            detail = "the only transfer coding that is taken is chunked"
            await problem_response(501, detail, instance=scope["path"])(scope, receive, send)
            return
        most = self._exceptions.get(scope["path"], self._maximum_bytes)
        length = headers.get("content-length", "0")
        if not length.isascii() or not length.isdigit() or int(length[:20]) > most:
            await problem_response(413, _too_long(most), instance=scope["path"])(scope, receive, send)
        elif scope["path"] in self._exceptions:
            await self._app(scope, _counted(receive, most), send)
        else:
            await self._whole(scope, receive, send)

    async def _whole(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Hand the request on once its body is there."""
        body = bytearray()
        more = True
        try:
            while more:
                message = await receive()
                if message["type"] == "http.disconnect":
                    return
                part = message.get("body", b"")
                body += part
                self._waiting_bytes += len(part)
                more = message.get("more_body", False)
                if len(body) > self._maximum_bytes:
                    detail = _too_long(self._maximum_bytes)
                    await problem_response(413, detail, instance=scope["path"])(scope, receive, send)
                    return
                if self._waiting_bytes > max(WAITING_BYTES, 2 * self._maximum_bytes):
                    await _busy(scope["path"])(scope, receive, send)
                    return
            answer = self._app(scope, _replayed(bytes(body), receive), send)
            if len(body) <= LARGE_BYTES:
                await answer
                return
            async with self._large:
                await answer
        finally:
            self._waiting_bytes -= len(body)


def _replayed(body: bytes, receive: Receive) -> Receive:
    """The body at once, then whatever the connection says."""
    given = False

    async def replay() -> Message:
        nonlocal given
        if given:
            return await receive()
        given = True
        return {"type": "http.request", "body": body, "more_body": False}

    return replay


def _counted(receive: Receive, most: int) -> Receive:
    received = 0

    async def counted() -> Message:
        nonlocal received
        message = await receive()
        received += len(message.get("body", b""))
        if received > most:
            raise HTTPException(413, _too_long(most))
        return message

    return counted


def _too_long(most: int) -> str:
    return f"the body is longer than {most} bytes"


def _busy(path: str) -> ASGIApp:
    detail = "too many large requests have arrived at once: try again"
    return problem_response(503, detail, instance=path, headers={"Retry-After": "5"}, code="busy")
