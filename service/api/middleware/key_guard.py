"""Admits callers with a key, by Bearer header or login cookie, within its scope and rate. A plain ASGI layer."""

from __future__ import annotations

import math
import time
from urllib.parse import quote

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.types import ASGIApp, Receive, Scope, Send

from service.access import ADMIN, OPEN_PATHS, READ, SAFE_METHODS, SESSION_COOKIE, Caller, refusal, scope_of
from service.api.middleware.host_guard import same_origin
from service.api.middleware.rate_limit import RateLimit
from service.api.problems import database_refusal, problem_response
from service.store.errors import OperationalError
from service.store.keys import Keys

PEER = "needlebench.peer"  # in the scope of a request: says whether the service's own account is at the other end
_SESSION = f"{SESSION_COOKIE}=".encode()
_OF_EVERY_SCOPE = frozenset({"/logout"})
_NO_KEY = (
    "this service requires a key: send it as Authorization: Bearer KEY, or log in at /login; "
    "commands and scripts of needlebench take it from NEEDLEBENCH_API_KEY"
)
_NO_ACCOUNT = (
    "this service has no keys and serves the account that started it alone, and this system does not say which "
    "account is asking: send the token in endpoint.json of its data folder as Authorization: Bearer TOKEN, or log in "
    "with it at /login; needlebench's own commands do so"
)
_FOREIGN = (
    "this service has no keys and serves the account of this machine that started it alone; its owner can make you a "
    "key: needlebench key create"
)
_BEARER = {"WWW-Authenticate": 'Bearer realm="needlebench"'}


class KeyGuard:
    """Puts the `Caller` into the request's state, or refuses: 401 unknown, 403 not allowed, 429 too many requests."""

    def __init__(self, app: ASGIApp, *, keys: Keys, rate_per_key: float, public: str | None = None) -> None:
        self._app = app
        self._public = public
        self._keys = keys
        self._rate = RateLimit(rate_per_key, time.monotonic)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request (ASGI)."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        scope = _without_foreign_cookies(scope)
        request = Request(scope)
        try:
            caller = await self._caller(request)
            answer = self._refused(request, caller) if not isinstance(caller, Response) else caller
        except OperationalError as error:
            await database_refusal(request, error)(scope, receive, send)
            return
        if answer is not None:
            await answer(scope, receive, send)
            return
        scope.setdefault("state", {})["caller"] = caller
        await self._app(scope, receive, send)

    async def _caller(self, request: Request) -> Caller | Response | None:
        """Who is calling; None = unknown, a response where no key would help.

        Only a lookup takes a thread: a health check never waits for one.
        """
        if request.url.path in OPEN_PATHS:
            return Caller(key_id=None, scope=READ)
        wanted = self._keys.wanted_lately
        if wanted is None:
            wanted = await run_in_threadpool(self._keys.wanted)
        return await run_in_threadpool(self._known if wanted else self._local, request)

    def _local(self, request: Request) -> Caller | Response:
        """Where no key is required: the account of the service, or whoever has the token of its data folder."""
        peer = request.scope.get(PEER)
        own = True if peer is None else peer()  # without a connection, within this process
        caller = Caller(key_id=None, scope=ADMIN) if own else self._known(request)
        return caller or _stranger(request, own)

    def _known(self, request: Request) -> Caller | None:
        """The owner of the key. A Bearer header, right or wrong, comes before the cookie."""
        if (header := request.headers.get("authorization")) is not None:
            kind, _, key = header.partition(" ")
            return self._keys.caller(key.strip()) if kind.lower() == "bearer" else None
        token = request.cookies.get(SESSION_COOKIE)
        return self._keys.browser(token) if token else None

    def _refused(self, request: Request, caller: Caller | None) -> Response | None:
        path, method = request.url.path, request.method
        if caller is None:
            return _unknown(request)
        if caller.by_cookie and method not in SAFE_METHODS and not same_origin(request.headers, self._public):
            detail = "a browser that is logged in can change things only from the service's own pages"
            return problem_response(403, detail, instance=path, code="origin-foreign")
        need = scope_of(method)
        if path not in OPEN_PATHS | _OF_EVERY_SCOPE and not caller.may(need):
            return problem_response(403, refusal(caller.scope, need, f"{method} {path[:100]}"), instance=path)
        wait_s = 0.0 if caller.key_id is None else self._rate.wait_s(caller.key_id)
        if wait_s:
            headers = {"Retry-After": str(math.ceil(wait_s))}
            detail = "too many requests with this key"
            return problem_response(429, detail, instance=path, headers=headers, code="rate-exceeded")
        return None


def _without_foreign_cookies(scope: Scope) -> Scope:
    """With no cookie but that of a session. The framework reads all of them at every request, and the standard library
    takes long over one that is full of backslashes."""
    headers = [(name, value) for name, value in scope["headers"] if name != b"cookie"]
    if len(headers) == len(scope["headers"]):
        return scope
    sent = (part.strip() for name, value in scope["headers"] if name == b"cookie" for part in value.split(b";"))
    own = [part for part in sent if part.startswith(_SESSION) and b"\\" not in part]
    return {**scope, "headers": [*headers, *((b"cookie", part) for part in own[:1])]}


def _stranger(request: Request, own: bool | None) -> Response:
    """The refusal of another account of this machine, or of one that the system does not tell."""
    path = request.url.path
    if own is None:
        if request.method == "GET" and "text/html" in request.headers.get("accept", ""):
            return _to_login(request)
        return problem_response(401, _NO_ACCOUNT, instance=path, headers=_BEARER, code="account-unknown")
    return problem_response(403, _FOREIGN, instance=path, code="account-foreign")


def _to_login(request: Request) -> Response:
    wanted = request.url.path + (f"?{request.url.query}" if request.url.query else "")
    return RedirectResponse(f"/login?next={quote(wanted, safe='')}", status_code=303)


def _unknown(request: Request) -> Response:
    """A browser is sent to the login page, everything else gets 401."""
    path = request.url.path
    if request.method == "GET" and "text/html" in request.headers.get("accept", ""):
        return _to_login(request)
    return problem_response(401, _NO_KEY, instance=path, headers=_BEARER)
