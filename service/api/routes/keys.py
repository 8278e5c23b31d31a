"""Routes of API keys, for the scope admin. The first key of a data folder is created on the command line."""

from __future__ import annotations

from fastapi import APIRouter, Request, Response, status

from service.api.context import ServiceOf, admin_only
from service.api.json_bodies import JsonBodyRoute
from service.api.openapi import documented
from service.api.parameters import KeyId
from service.api.problems import HttpError
from service.api.schemas.keys import CreatedKey, KeyList, KeyRequest, KeyView

router = APIRouter(prefix="/api/v1/keys", tags=["keys"], route_class=JsonBodyRoute)

_LOCATION = {"Location": {"description": "Address of the key.", "schema": {"type": "string"}}}


@router.get(
    "", operation_id="list_keys", summary="API keys, oldest first", responses=documented(), **admin_only()
)  # fmt: skip
def list_keys(service: ServiceOf) -> KeyList:
    """Without their secrets, of which only hashes are stored; revoked ones included."""
    return KeyList(items=[KeyView.of(item) for item in service.keys.all()])


@router.post(
    "",
    operation_id="create_key",
    summary="Create an API key",
    status_code=status.HTTP_201_CREATED,
    response_model=CreatedKey,
    responses={201: {"description": "Created.", "headers": _LOCATION}, **documented(400, 409, 413, 415)},
    **admin_only(),
)
def create_key(body: KeyRequest, service: ServiceOf, request: Request, response: Response) -> CreatedKey:
    """The answer holds the key itself, which is not shown again. The first key locks the service, so it is created by
    `needlebench key create` on the machine of the service."""
    if request.state.caller.key_id is None:
        detail = "no key is required yet: create the first with needlebench key create --scope admin"
        raise HttpError(409, detail, code="first-key")
    key, text = service.keys.create(scope=body.scope, note=body.note)
    response.headers["Location"] = f"/api/v1/keys/{key.id}"
    response.headers["Cache-Control"] = "no-store"
    return CreatedKey(**KeyView.of(key).model_dump(), key=text)


@router.get(
    "/{key_id}", operation_id="get_key", summary="One API key", responses=documented(404), **admin_only()
)  # fmt: skip
def get_key(key_id: KeyId, service: ServiceOf) -> KeyView:
    """Scope, note and times."""
    return KeyView.of(service.keys.get(key_id))


@router.delete(
    "/{key_id}",
    operation_id="revoke_key",
    summary="Revoke an API key",
    status_code=status.HTTP_204_NO_CONTENT,
    responses=documented(404),
    **admin_only(),
)
def revoke_key(key_id: KeyId, service: ServiceOf) -> None:
    """The key is no longer accepted and its logins end; it stays in the list. Idempotent."""
    service.keys.revoke(key_id)
