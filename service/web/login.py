"""The login of a browser: a key becomes a cookie, since event streams and frames cannot send a Bearer header."""

from __future__ import annotations

import secrets
from functools import cache
from pathlib import Path
from typing import Annotated, Any
from urllib.parse import parse_qs

from fastapi import APIRouter, Query, Request
from jinja2 import Environment, FileSystemLoader
from starlette.concurrency import run_in_threadpool
from starlette.responses import HTMLResponse, RedirectResponse, Response

from service.access import SESSION_COOKIE
from service.api.context import ServiceOf
from service.api.middleware.key_guard import PEER
from service.api.root_path import rooted, rooted_page
from service.store.keys import SESSION_S
from service.version import installed_version

router = APIRouter(include_in_schema=False)

_MAXIMUM_FORM_BYTES = 10_000
_WRONG = "This key is unknown or was revoked."


@cache
def templates() -> Environment:
    """The pages of the service; values are escaped."""
    return Environment(loader=FileSystemLoader(Path(__file__).parent / "templates"), autoescape=True)


@router.get("/login")
async def get_login(
    request: Request, service: ServiceOf, goal: Annotated[str, Query(alias="next", max_length=8000)] = "/"
) -> Response:
    """The form; straight to the goal where no key is required and it is known who asks."""
    peer = request.scope.get(PEER)
    known = peer is None or await run_in_threadpool(peer) is not None
    if known and not await run_in_threadpool(service.keys.wanted):
        return RedirectResponse(inside(goal), status_code=303)
    return _form(goal)


@router.post("/login")
async def log_in(request: Request, service: ServiceOf) -> Response:
    """The cookie, and on to the goal; or the form again."""
    form = await _fields(request)
    token = await run_in_threadpool(service.keys.log_in, form.get("key", "").strip())
    if token is None:
        return _form(form.get("next", "/"), problem=_WRONG)
    answer = RedirectResponse(inside(form.get("next", "/")), status_code=303)
    secure = request.url.scheme == "https" or (service.settings.public_url or "").startswith("https:")
    options: dict[str, Any] = {"path": rooted("/"), "httponly": True, "samesite": "strict", "secure": secure}
    answer.set_cookie(SESSION_COOKIE, token, max_age=int(SESSION_S), **options)
    return answer


@router.post("/logout")
async def log_out(request: Request, service: ServiceOf) -> Response:
    """End the session and forget the cookie."""
    if token := request.cookies.get(SESSION_COOKIE):
        await run_in_threadpool(service.keys.log_out, token)
    answer = RedirectResponse("/login", status_code=303)
    answer.delete_cookie(SESSION_COOKIE, path=rooted("/"), httponly=True, samesite="strict")
    return answer


def inside(goal: str) -> str:
    """A path of this service; the start page instead of the address of another site."""
    foreign = goal.startswith(("//", "/\\")) or not goal.startswith("/") or not goal.isprintable()
    return "/" if foreign or "\\" in goal or not goal.isascii() else goal


async def _fields(request: Request) -> dict[str, str]:
    """The fields of a posted form."""
    body = b""
    async for chunk in request.stream():
        body += chunk
        if len(body) > _MAXIMUM_FORM_BYTES:
            return {}
    try:
        given = parse_qs(body.decode("utf-8", "replace"), max_num_fields=20)
    except ValueError:
        return {}
    return {name: values[-1] for name, values in given.items()}


def _form(goal: str, *, problem: str = "") -> Response:
    nonce = secrets.token_urlsafe(16)
    page = templates().get_template("login.html")
    html = rooted_page(page.render(nonce=nonce, goal=inside(goal), problem=problem, version=installed_version()))
    policy = (
        f"default-src 'none'; style-src 'nonce-{nonce}'; img-src data:; form-action 'self'; "
        "base-uri 'none'; frame-ancestors 'none'"
    )
    headers = {"Content-Security-Policy": policy, "Referrer-Policy": "same-origin", "Cache-Control": "no-store"}
    return HTMLResponse(html, status_code=401 if problem else 200, headers=headers)
