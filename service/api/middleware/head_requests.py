"""HEAD: the answer of GET without its body, for every route. A plain ASGI layer."""

from __future__ import annotations

import asyncio

from starlette.types import ASGIApp, Message, Receive, Scope, Send


class HeadAsGet:
    """Runs GET, passes on status and headers, and ends an answer that would go on, such as a stream of events."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request (ASGI)."""
        if scope["type"] != "http" or scope["method"] != "HEAD":
            await self._app(scope, receive, send)
            return
        enough = False

        async def head_only(message: Message) -> None:
            nonlocal enough
            if message["type"] == "http.response.start":
                await send(message)
                await send({"type": "http.response.body", "body": b"", "more_body": False})
            elif message.get("more_body"):
                enough = True
                answering.cancel()
                await asyncio.sleep(0)

        answering = asyncio.ensure_future(self._app({**scope, "method": "GET"}, receive, head_only))
        try:
            await answering
        except asyncio.CancelledError:
            if not enough:
                raise
