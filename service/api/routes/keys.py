"""Routes of API keys, for those of scope admin. The first key of a data folder comes from the command line."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path, Request, Response, status

from service.access import admin_only
from service.api.context import ServiceOf, documented
from service.api.problems import HttpProblem
from service.api.schemas.access import KeyList, KeyMade, KeyRequest, KeyView

router = APIRouter(prefix="/api/v1/keys", tags=["keys"])

_LOCATION = {"Location": {"description": "Where the key is.", "schema": {"type": "string"}}}
KeyId = Annotated[str, Path(description="Id of a key.", min_length=1, max_length=32, pattern="^[0-9a-z]+$")]


@router.get(
    "", operation_id="list_keys", summary="API keys, oldest first", responses=documented(), **admin_only()
)  # fmt: skip
def list_keys(service: ServiceOf) -> KeyList:
    """Without their secrets, of which only hashes are kept; the revoked ones too."""
    return KeyList(items=[KeyView.of(item) for item in service.keys.all()])


@router.post(
    "",
    operation_id="create_key",
    summary="Make an API key",
    status_code=status.HTTP_201_CREATED,
    response_model=KeyMade,
    responses={201: {"description": "Made.", "headers": _LOCATION}, **documented(400, 409, 413, 415)},
    **admin_only(),
)
def create_key(body: KeyRequest, service: ServiceOf, request: Request, response: Response) -> KeyMade:
    """The answer has the key itself, which cannot be had again. The first key locks the service, so it is made by
    `needlebench key create` on its own machine."""
    if request.state.caller.key_id is None:
        raise HttpProblem(409, "no key is asked for here yet: make the first with needlebench key create --scope admin")
    made, text = service.keys.create(scope=body.scope, note=body.note)
    response.headers["Location"] = f"/api/v1/keys/{made.id}"
    response.headers["Cache-Control"] = "no-store"
    return KeyMade(**KeyView.of(made).model_dump(), key=text)


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
    """It opens nothing any more and its logins have ended; it stays in the list. Once more is no error."""
    service.keys.revoke(key_id)
