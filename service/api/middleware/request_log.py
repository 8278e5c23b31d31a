"""The outermost layer around the routes: gives each request an id, counts it, and tells it to the log."""

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
        if scope["type"] != "http":
            return await self._app(scope, receive, send)
        asked = Headers(scope=scope).get(_HEADER, "")
        name = asked if _GOOD.fullmatch(asked) else secrets.token_hex(8)
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
            told = {"method": scope["method"], "path": scope["path"], "status": status, "duration_ms": duration_ms}
            _log.info("%s %s %d", scope["method"], scope["path"], status, extra={**told, "request_id": name})
            request_id.reset(token)


def _method(scope: Scope, status: int) -> str:
    """The method, if the route takes it: anybody can try others, and each would be counted apart for ever, on every
    route, at 4 kB a histogram."""
    known = scope["method"] in _METHODS and status != HTTPStatus.METHOD_NOT_ALLOWED
    return str(scope["method"]) if known else "other"


def _route(scope: Scope) -> str:
    """The address with its parameters unnamed, so that there are not more of them than routes."""
    return str(getattr(scope.get("route"), "path", "none"))
