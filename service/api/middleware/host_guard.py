"""Refuses foreign Hosts and Origins, long addresses and long headers. A plain ASGI layer."""

from __future__ import annotations

import re
from collections.abc import Mapping
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.access import SAFE_METHODS
from service.api.problem_codes import CODES
from service.api.problems import problem_response
from simcore.remote.link import is_loopback

MAXIMUM_HEADER_BYTES = 16_000  # below what the HTTP server itself takes, which refuses without a problem+json
MAXIMUM_URL_BYTES = 8_000
_HOST = re.compile(rb"(?:[A-Za-z0-9._~-]+|\[[0-9A-Fa-f:.]+\])(?::([0-9]{0,5}))?")
_LAST_PORT = 65_535
_HEADERS = {"X-Content-Type-Options": "nosniff", "Cross-Origin-Resource-Policy": "same-origin"}


class HostGuard:
    """Refuses what a page from another origin makes a browser send, and keeps answers out of such pages.

    On loopback the Host must be a loopback name, against DNS rebinding. Everywhere, a request that changes
    something and names its origin must come from the service's own pages; one that reads may come from another
    origin only as a link that somebody follows.
    """

    def __init__(self, app: ASGIApp, *, loopback: bool, public: str | None = None) -> None:
        """public: host and port that a proxy shows, which are the service's own too."""
        self._app = app
        self._public = public
        self._loopback = loopback

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request (ASGI)."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers.update(_HEADERS)
                headers.setdefault("Cache-Control", "no-store")
            await send(message)

        refusal = _size_refusal(scope) or _host_refusal(scope) or self._refusal(scope["method"], Headers(scope=scope))
        if refusal is None:
            await self._app(scope, receive, with_headers)
            return
        code, detail = refusal
        answer = problem_response(CODES[code][0], detail, instance=scope["path"][:200], code=code)
        await answer(scope, receive, with_headers)

    def _refusal(self, method: str, headers: Headers) -> tuple[str, str] | None:
        host = headers.get("host", "")
        if self._loopback and host.lower() != self._public and not is_loopback(_host_name(f"//{host}")):
            return "host-foreign", f"the Host header {host[:100]!r} is not a name of this machine, such as localhost"
        site = headers.get("sec-fetch-site", "none")
        if method in SAFE_METHODS:
            if site == "cross-site" and headers.get("sec-fetch-mode") != "navigate":
                return "origin-foreign", "a page from another origin may not read this"
            return None
        origin = headers.get("origin")
        if origin is not None and not same_origin(headers, self._public):
            return "origin-foreign", f"a page from {origin[:100]!r} may not change anything here"
        if origin is None and site not in ("none", "same-origin"):
            return "origin-foreign", "a page from another origin may not change anything here"
        return None


def same_origin(headers: Mapping[str, str], public: str | None = None) -> bool:
    """Whether the Origin header names the host and port that the request was sent to, or those that a proxy shows."""
    origin = _host_and_port(headers.get("origin", ""))
    return bool(origin) and origin in (headers.get("host", "").lower(), public)


def _size_refusal(scope: Scope) -> tuple[str, str] | None:
    if len(scope.get("raw_path") or b"") + len(scope["query_string"]) > MAXIMUM_URL_BYTES:
        return "address-too-long", f"the address is longer than {MAXIMUM_URL_BYTES} bytes"
    if sum(len(name) + len(value) for name, value in scope["headers"]) > MAXIMUM_HEADER_BYTES:
        return "headers-too-long", f"the headers are longer than {MAXIMUM_HEADER_BYTES} bytes"
    return None


def _host_refusal(scope: Scope) -> tuple[str, str] | None:
    """One Host header, as HTTP asks for (RFC 9112, 3.2): with two, each program on the way may believe another."""
    hosts = [value for name, value in scope["headers"] if name == b"host"]
    if len(hosts) > 1 or (not hosts and scope["http_version"] != "1.0"):
        return "bad-host", f"the request has {len(hosts)} Host headers, it must have one"
    if hosts and hosts[0] and not _is_host(hosts[0]):
        return "bad-host", "the Host header is not a name or an address, with a port at most"
    return None


def _is_host(value: bytes) -> bool:
    """Whether it is host and port as in an address, without a user."""
    found = _HOST.fullmatch(value)
    return found is not None and int(found[1] or 0) <= _LAST_PORT


def _host_name(url: str) -> str:
    try:
        return urlsplit(url).hostname or ""
    except ValueError:
        return ""


def _host_and_port(url: str) -> str:
    """In lower case; empty when the URL has none or is malformed."""
    try:
        return urlsplit(url).netloc.lower()
    except ValueError:
        return ""
