"""Addresses of a service that a proxy shows under a path of its own, as in https://lab.example/needles.

Within the service every address begins with /. In what leaves it, links, redirects and pages, the proxy's path comes
first.
"""

from __future__ import annotations

import re
from contextvars import ContextVar

from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

_root: ContextVar[str] = ContextVar("root_path", default="")
_ADDRESS = re.compile(r'(?<=\s)((?:href|src|action|data-action|data-url|data-goto)=")(/(?!/)[^"]*)')


def root() -> str:
    """The proxy's path, without a slash at its end; empty without one."""
    return _root.get()


def rooted(path: str) -> str:
    """A path of the service as others see it."""
    return _root.get() + path


def rooted_page(html: str) -> str:
    """A page whose addresses are as others see them, also those that were already."""
    if not (before := _root.get()):
        return html

    def full(found: re.Match[str]) -> str:
        known = found[2] == before or found[2].startswith((f"{before}/", f"{before}?"))
        return found[0] if known else f"{found[1]}{before}{found[2]}"

    return _ADDRESS.sub(full, html)


class RootPath:
    """Takes the proxy's path off each request, whether the proxy did so or not, and puts it before each redirect.

    A plain ASGI layer.
    """

    def __init__(self, app: ASGIApp, *, root: str) -> None:
        self._app = app
        self._path = root

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request (ASGI)."""
        if scope["type"] != "http" or not self._path:
            await self._app(scope, receive, send)
            return
        path = scope["path"]
        if path == self._path or path.startswith(f"{self._path}/"):
            scope = {**scope, "path": path[len(self._path) :] or "/", "raw_path": None}

        async def redirected(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(raw=message["headers"])
                if (location := headers.get("location", "")).startswith("/"):
                    headers["location"] = self._path + location
            await send(message)

        token = _root.set(self._path)
        try:
            await self._app(scope, receive, redirected)
        finally:
            _root.reset(token)
