"""What is refused unseen: foreign Hosts and Origins, long addresses, headers and bodies. Plain ASGI layers."""

from __future__ import annotations

from collections.abc import Mapping
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.access import SAFE_METHODS
from service.api.problems import problem_response
from service.settings import is_loopback

MAXIMUM_HEADER_BYTES = 16_000  # below what the HTTP server itself takes, which refuses without a problem+json
MAXIMUM_URL_BYTES = 8_000
_FOR_ALL_ANSWERS = {"X-Content-Type-Options": "nosniff", "Cross-Origin-Resource-Policy": "same-origin"}


class HostGuard:
    """Refuses what a web page of elsewhere makes a browser send, and keeps answers out of such pages.

    On loopback the Host must be a loopback name, against DNS rebinding. Everywhere, a request that changes
    something and says where it comes from must come from the service's own page; one that reads may come from
    elsewhere only as a link that somebody follows.
    """

    def __init__(self, app: ASGIApp, *, loopback: bool) -> None:
        self._app = app
        self._loopback = loopback

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            return await self._app(scope, receive, send)

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(_FOR_ALL_ANSWERS)
            await send(message)

        refusal = _size_refusal(scope) or self._refusal(scope["method"], Headers(scope=scope))
        if refusal is None:
            return await self._app(scope, receive, with_headers)
        status, detail = refusal
        await problem_response(status, detail, instance=scope["path"][:200])(scope, receive, with_headers)

    def _refusal(self, method: str, headers: Headers) -> tuple[int, str] | None:
        host = headers.get("host", "")
        if self._loopback and not is_loopback(_name(f"//{host}")):
            return 421, f"the Host header {host[:100]!r} is not a name of this machine, such as localhost"
        site = headers.get("sec-fetch-site", "none")
        if method in SAFE_METHODS:
            if site == "cross-site" and headers.get("sec-fetch-mode") != "navigate":
                return 403, "a page of elsewhere may not read this"
            return None
        origin = headers.get("origin")
        if origin is not None and not same_origin(headers):
            return 403, f"a page of {origin[:100]!r} may not change anything here"
        if origin is None and site not in ("none", "same-origin"):
            return 403, "a page of elsewhere may not change anything here"
        return None


def same_origin(headers: Mapping[str, str]) -> bool:
    """Whether the Origin header is there and has the host and port that the request was sent to."""
    origin = _place(headers.get("origin", ""))
    return bool(origin) and origin == headers.get("host", "").lower()


def _size_refusal(scope: Scope) -> tuple[int, str] | None:
    if len(scope.get("raw_path") or b"") + len(scope["query_string"]) > MAXIMUM_URL_BYTES:
        return 414, f"the address is longer than {MAXIMUM_URL_BYTES} bytes"
    if sum(len(name) + len(value) for name, value in scope["headers"]) > MAXIMUM_HEADER_BYTES:
        return 431, f"the headers are longer than {MAXIMUM_HEADER_BYTES} bytes"
    return None


def _name(url: str) -> str:
    try:
        return urlsplit(url).hostname or ""
    except ValueError:
        return ""


def _place(url: str) -> str:
    """Host and port of a URL, in lower case; empty when it has none or is broken."""
    try:
        return urlsplit(url).netloc.lower()
    except ValueError:
        return ""


class BodyLimit:
    """Refuses a body above `maximum_bytes`, by its stated length or while it arrives. more: paths with another one."""

    def __init__(self, app: ASGIApp, *, maximum_bytes: int, more: Mapping[str, int]) -> None:
        self._app = app
        self._maximum_bytes = maximum_bytes
        self._more = more

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            return await self._app(scope, receive, send)
        most = self._more.get(scope["path"], self._maximum_bytes)
        detail = f"the body is longer than {most} bytes"
        length = Headers(scope=scope).get("content-length", "0")
        if not length.isascii() or not length.isdigit() or int(length[:20]) > most:
            return await problem_response(413, detail, instance=scope["path"])(scope, receive, send)
        received = 0

        async def counted() -> Message:
            nonlocal received
            message = await receive()
            received += len(message.get("body", b""))
            if received > most:
                raise HTTPException(413, detail)
            return message

        await self._app(scope, counted, send)
