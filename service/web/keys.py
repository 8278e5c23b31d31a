"""The page of API keys, for the scope admin."""

from __future__ import annotations

from fastapi import APIRouter, Request, Response

from service.access import ADMIN, READ, SCOPES, SUBMIT
from service.api.context import ServiceOf, admin_only
from service.api.schemas.keys import KeyView
from service.store.keys import NOTE_LENGTH
from service.web.site import page

router = APIRouter(include_in_schema=False)

ALLOWED = {
    READ: "see everything",
    SUBMIT: "also submit and cancel jobs and upload files",
    ADMIN: "also delete what other keys created, operate the service and manage keys",
}


@router.get("/keys", **admin_only())
def get_keys(request: Request, service: ServiceOf) -> Response:
    """All keys, the revoked ones last, and the form of a new one."""
    keys = [KeyView.of(key) for key in service.keys.all()]
    current = [key for key in keys if key.revoked_at is None]
    lasting = service.settings.api_key is not None
    return page(
        request,
        "keys.html",
        keys=current + [key for key in keys if key.revoked_at is not None],
        locked=service.keys.wanted(),
        own=request.state.caller.key_id,
        from_environment=lasting,
        admins=sum(key.scope == ADMIN for key in current) + lasting,
        scopes={scope: ALLOWED[scope] for scope in SCOPES},
        longest_note=NOTE_LENGTH,
    )
