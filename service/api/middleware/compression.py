"""Compresses answers of text for those who take it. A plain ASGI layer."""

from __future__ import annotations

import gzip
import re

from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

LEAST_BYTES = 1000
_LEVEL = 5
_TEXT = re.compile(r"(text/(?!event-stream)|application/([a-z.]+\+)?json|text/csv|image/svg)")


class Compression:
    """Gzip for a body of text that is sent in one piece; files, streams and recordings are left as they are.

    The entity tag becomes a weak one: the bytes are others, the meaning is not.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request (ASGI)."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        wanted = accepts_gzip(Headers(scope=scope).get("accept-encoding", ""))
        held: Message | None = None

        async def compressed(message: Message) -> None:
            nonlocal held
            if message["type"] == "http.response.start" and _compressible(message):
                MutableHeaders(raw=message["headers"]).add_vary_header("Accept-Encoding")
                held = message
            elif held is None:
                await send(message)
            else:
                start, held = held, None
                body = message.get("body", b"")
                if wanted and not message.get("more_body") and len(body) >= LEAST_BYTES:
                    message = {**message, "body": await _pack(start, body)}
                await send(start)
                await send(message)

        await self._app(scope, receive, compressed)


def accepts_gzip(header: str) -> bool:
    """Whether an Accept-Encoding header takes gzip, by its name or else by `*`; a quality of 0 refuses it."""
    qualities: dict[str, str] = {}
    for item in header.lower().split(","):
        coding, _, parameter = item.partition(";")
        name, _, value = parameter.partition("=")
        qualities[coding.strip()] = value.strip() if name.strip() == "q" else "1"
    try:
        return float(qualities.get("gzip", qualities.get("*", "0"))) > 0
    except ValueError:
        return False


def _compressible(start: Message) -> bool:
    headers = Headers(raw=start["headers"])
    known = _TEXT.match(headers.get("content-type", ""))
    whole = start["status"] not in (206, 304) and "accept-ranges" not in headers
    return known is not None and whole and "content-encoding" not in headers


async def _pack(start: Message, body: bytes) -> bytes:
    packed = await run_in_threadpool(gzip.compress, body, _LEVEL, mtime=0)
    headers = MutableHeaders(raw=start["headers"])
    headers["Content-Encoding"] = "gzip"
    headers["Content-Length"] = str(len(packed))
    if (tag := headers.get("etag")) is not None and not tag.startswith("W/"):
        headers["ETag"] = f"W/{tag}"
    return packed
