"""Who may talk to the service: the key, the Host and Origin headers, the size of a body. Plain ASGI layers."""

from __future__ import annotations

import hmac
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.problems import problem_response
from service.settings import is_loopback

OPEN_PATHS = frozenset({"/healthz", "/readyz"})  # for health checks, which carry no key; they tell nothing else
_SAFE = frozenset({"GET", "HEAD", "OPTIONS"})


class KeyGuard:
    """Asks for `Authorization: Bearer KEY`; compares in constant time."""

    def __init__(self, app: ASGIApp, *, key: str) -> None:
        self._app = app
        self._key = key.encode()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http" and scope["path"] not in OPEN_PATHS and not self._known(Headers(scope=scope)):
            detail = "this service asks for a key: send it as Authorization: Bearer KEY"
            headers = {"WWW-Authenticate": 'Bearer realm="needlebench"'}
            refusal = problem_response(401, detail, instance=scope["path"], headers=headers)
            return await refusal(scope, receive, send)
        await self._app(scope, receive, send)

    def _known(self, headers: Headers) -> bool:
        kind, _, key = headers.get("authorization", "").partition(" ")
        return kind.lower() == "bearer" and hmac.compare_digest(key.strip().encode("utf-8", "replace"), self._key)


class HostGuard:
    """Refuses what a web page of elsewhere makes a browser send.

    On loopback the Host must be a loopback name, against DNS rebinding. Everywhere, a request that changes
    something and carries an Origin must come from the service's own page.
    """

    def __init__(self, app: ASGIApp, *, loopback: bool) -> None:
        self._app = app
        self._loopback = loopback

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http" and (refusal := self._refusal(scope["method"], Headers(scope=scope))):
            status, detail = refusal
            return await problem_response(status, detail, instance=scope["path"])(scope, receive, send)
        await self._app(scope, receive, send)

    def _refusal(self, method: str, headers: Headers) -> tuple[int, str] | None:
        host = headers.get("host", "")
        if self._loopback and not is_loopback(_name(f"//{host}")):
            return 421, f"the Host header {host[:100]!r} is not a name of this machine, such as localhost"
        origin = headers.get("origin")
        if origin is not None and method not in _SAFE and urlsplit_netloc(origin) != host.lower():
            return 403, f"a page of {origin[:100]!r} may not change anything here"
        return None


def _name(url: str) -> str:
    try:
        return urlsplit(url).hostname or ""
    except ValueError:
        return ""


def urlsplit_netloc(url: str) -> str:
    """Host and port of a URL, in lower case; empty when it has none or is broken."""
    try:
        return urlsplit(url).netloc.lower()
    except ValueError:
        return ""


class BodyLimit:
    """Refuses a body above `maximum_bytes`, by its stated length or while it arrives."""

    def __init__(self, app: ASGIApp, *, maximum_bytes: int) -> None:
        self._app = app
        self._maximum_bytes = maximum_bytes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            return await self._app(scope, receive, send)
        length = Headers(scope=scope).get("content-length", "0")
        if not length.isascii() or not length.isdigit() or int(length[:20]) > self._maximum_bytes:
            return await problem_response(413, self._detail, instance=scope["path"])(scope, receive, send)
        received = 0

        async def counted() -> Message:
            nonlocal received
            message = await receive()
            received += len(message.get("body", b""))
            if received > self._maximum_bytes:
                raise HTTPException(413, self._detail)
            return message

        await self._app(scope, counted, send)

    @property
    def _detail(self) -> str:
        return f"the body is longer than {self._maximum_bytes} bytes"
