"""Who is calling and what they may do. Scopes are steps: admin includes submit, submit includes read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from fastapi import Depends, Request

from service.api.problems import HttpProblem

READ, SUBMIT, ADMIN = SCOPES = ("read", "submit", "admin")
SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})
SCOPE_FIELD = "x-needlebench-scope"


@dataclass(frozen=True, kw_only=True)
class Caller:
    """key_id: the API key; None where none is asked for. by_cookie: a browser that logged in."""

    key_id: str | None
    scope: str
    by_cookie: bool = False

    def may(self, scope: str) -> bool:
        return SCOPES.index(self.scope) >= SCOPES.index(scope)

    def must(self, scope: str, what: str) -> None:
        """Raises HttpProblem 403 without the scope."""
        if not self.may(scope):
            raise HttpProblem(403, refusal(self.scope, scope, what))

    def must_own(self, owner: str | None, what: str) -> None:
        """Raises HttpProblem 403 for what another key has made, unless the scope is admin."""
        if self.key_id is None or owner != self.key_id:
            self.must(ADMIN, f"{what} is not yours: this")


def refusal(have: str, need: str, what: str) -> str:
    """The sentence for a key that is known and may not."""
    return f"{what} needs a key of scope {need}; yours has {have}"


def scope_of(method: str) -> str:
    """What a request needs at least."""
    return READ if method in SAFE_METHODS else SUBMIT


async def _admin(request: Request) -> None:
    request.state.caller.must(ADMIN, f"{request.method} {request.url.path[:100]}")


def admin_only() -> dict[str, Any]:
    """Options of a route that needs the scope admin: `@router.get(..., **admin_only())`."""
    return {"dependencies": [Depends(_admin)], "openapi_extra": {SCOPE_FIELD: ADMIN}}
