"""HEAD: the answer of GET without its body. A plain ASGI layer, so that no route has to think of it."""

from __future__ import annotations

import asyncio

from starlette.types import ASGIApp, Message, Receive, Scope, Send


class HeadAsGet:
    """Asks for GET, passes on status and headers, and ends an answer that would go on, such as a stream of events."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or scope["method"] != "HEAD":
            return await self._app(scope, receive, send)
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
