"""Who is calling and what they may do. Scopes are steps: admin includes submit, submit includes read."""

from __future__ import annotations

from dataclasses import dataclass

from simcore.errors import NeedlebenchError

READ, SUBMIT, ADMIN = SCOPES = ("read", "submit", "admin")
SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})
OPEN_PATHS = frozenset({"/healthz", "/readyz", "/login"})  # health checks carry no key; the login is where one is given
NORMAL_PRIORITY = 0  # above, a job goes before those of everybody else
SESSION_COOKIE = "needlebench_session"  # of a browser that has logged in


class ForbiddenError(NeedlebenchError):
    """The caller is known, and may not do this; says which scope it takes."""


@dataclass(frozen=True, kw_only=True)
class Caller:
    """key_id: the API key; None where none is required. by_cookie: a browser that logged in."""

    key_id: str | None
    scope: str
    by_cookie: bool = False

    def may(self, scope: str) -> bool:
        """Whether the caller's scope includes this one."""
        return SCOPES.index(self.scope) >= SCOPES.index(scope)

    def require(self, scope: str, action: str) -> None:
        """Raises ForbiddenError without the scope. action: what was attempted, for the message."""
        if not self.may(scope):
            raise ForbiddenError(refusal(self.scope, scope, action))

    def require_owner(self, owner: str | None, thing: str) -> None:
        """Raises ForbiddenError for what another key created, unless the scope is admin."""
        if self.key_id is None or owner != self.key_id:
            self.require(ADMIN, f"{thing} belongs to another key: this")

    def require_priority(self, priority: int) -> None:
        """Raises ForbiddenError for a priority above the normal one, which pushes others back, unless admin."""
        if priority > NORMAL_PRIORITY:
            self.require(ADMIN, f"priority {priority}, above the normal {NORMAL_PRIORITY},")


def refusal(have: str, need: str, action: str) -> str:
    """The sentence for a key that is known but may not do this."""
    return f"{action} needs a key of scope {need}; yours has {have}"


def scope_of(method: str) -> str:
    """The least scope that a request of this HTTP method needs."""
    return READ if method in SAFE_METHODS else SUBMIT
