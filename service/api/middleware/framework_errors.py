"""Errors that the framework answers in plain text become problem+json too. A plain ASGI layer."""

from __future__ import annotations

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.api.problems import problem_response

_KEPT_HEADERS = ("content-range",)  # of a 416: how long the file is
_NO_SUCH_RANGE = "the Range header asks for bytes that the file does not have"


class PlainTextErrors:
    """Turns errors of type text/plain, such as those about a Range header, into problem+json."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request (ASGI)."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        refused: Message | None = None
        text = b""

        async def shaped(message: Message) -> None:
            nonlocal refused, text
            if message["type"] == "http.response.start" and _plain_error(message):
                refused = message
            elif refused is None:
                await send(message)
            else:
                text += message.get("body", b"")

        await self._app(scope, receive, shaped)
        if refused is not None:
            await _problem(refused, text, scope["path"])(scope, receive, send)


def _plain_error(start: Message) -> bool:
    media_type = Headers(raw=start["headers"]).get("content-type", "")
    return start["status"] >= 400 and media_type.startswith("text/plain")


def _problem(start: Message, text: bytes, path: str) -> ASGIApp:
    status, headers = start["status"], Headers(raw=start["headers"])
    kept = {name: headers[name] for name in _KEPT_HEADERS if name in headers}
    detail = text.decode(errors="replace") or (_NO_SUCH_RANGE if status == 416 else "refused")
    return problem_response(status, detail, instance=path[:200], headers=kept)
