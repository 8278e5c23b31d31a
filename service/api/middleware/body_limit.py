"""Refuses bodies that are too long. A plain ASGI layer."""

from __future__ import annotations

from collections.abc import Mapping

from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.api.problems import problem_response


class BodyLimit:
    """Refuses a body above `maximum_bytes`, by its declared length or as it arrives. exceptions: path -> its limit."""

    def __init__(self, app: ASGIApp, *, maximum_bytes: int, exceptions: Mapping[str, int]) -> None:
        self._app = app
        self._maximum_bytes = maximum_bytes
        self._exceptions = exceptions

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request (ASGI)."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        most = self._exceptions.get(scope["path"], self._maximum_bytes)
        detail = f"the body is longer than {most} bytes"
        length = Headers(scope=scope).get("content-length", "0")
        if not length.isascii() or not length.isdigit() or int(length[:20]) > most:
            await problem_response(413, detail, instance=scope["path"])(scope, receive, send)
            return
        received = 0

        async def counted() -> Message:
            nonlocal received
            message = await receive()
            received += len(message.get("body", b""))
            if received > most:
                raise HTTPException(413, detail)
            return message

        await self._app(scope, counted, send)
