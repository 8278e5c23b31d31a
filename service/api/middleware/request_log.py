"""The outermost layer around the routes: gives each request an id, counts it and logs it. A plain ASGI layer."""

from __future__ import annotations

import logging
import re
import secrets
import time
from http import HTTPStatus

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.engine.metrics import Monitor
from service.logs import ROOT, request_id

_log = logging.getLogger(f"{ROOT}.http")
_HEADER = "X-Request-Id"
_METHODS = frozenset({"GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"})
_GOOD = re.compile(r"[A-Za-z0-9._-]{1,64}")


class RequestLog:
    """Takes the `X-Request-Id` of the request, or makes one; the answer carries it, and so does every log line."""

    def __init__(self, app: ASGIApp, *, monitor: Monitor) -> None:
        self._app = app
        self._monitor = monitor

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request (ASGI)."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        given = Headers(scope=scope).get(_HEADER, "")
        name = given if _GOOD.fullmatch(given) else secrets.token_hex(8)
        started = time.perf_counter()
        status = 500

        async def named(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                MutableHeaders(scope=message)[_HEADER] = name
                self._monitor.answered(_method(scope, status), _route(scope), status, time.perf_counter() - started)
            await send(message)

        token = request_id.set(name)
        try:
            await self._app(scope, receive, named)
        finally:
            duration_ms = round(1e3 * (time.perf_counter() - started), 1)
            fields = {"method": scope["method"], "path": scope["path"], "status": status, "duration_ms": duration_ms}
            _log.info("%s %s %d", scope["method"], scope["path"], status, extra={**fields, "request_id": name})
            request_id.reset(token)


def _method(scope: Scope, status: int) -> str:
    """The method if the route takes it, else `other`: anybody can send any, and each would take 4 kB for good."""
    known = scope["method"] in _METHODS and status != HTTPStatus.METHOD_NOT_ALLOWED
    return str(scope["method"]) if known else "other"


def _route(scope: Scope) -> str:
    """The address with its parameters as names, so that there are no more of them than routes."""
    return str(getattr(scope.get("route"), "path", "none"))
