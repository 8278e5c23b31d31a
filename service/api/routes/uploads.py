"""Routes of uploaded files: meshes, models and data sets, which scenarios and trainings name by their ids."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Request, Response, status
from fastapi import Path as PathParameter
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect
from starlette.responses import FileResponse

from service.admission.upload_check import BadUpload, checked
from service.api.context import Service, ServiceOf, documented
from service.api.problems import HttpProblem
from service.api.schemas.access import UploadList, UploadView
from service.files.upload_names import NAME, NAMES, SUFFIXES, UPLOAD_ID
from service.store.uploads import Upload
from simcore.errors import Problem

router = APIRouter(prefix="/api/v1/uploads", tags=["uploads"])

_BINARY = {"schema": {"type": "string", "format": "binary"}}
_PLAIN = "application/octet-stream"
_MEDIA_TYPES = {".npz": ("application/x-npz", "application/zip"), ".json": ("application/json",)}
_MESH_TYPES = ("model/mesh",)
_WRITTEN_AT_ONCE = 2**20
_LOCATION = {"Location": {"description": "Where the upload is.", "schema": {"type": "string"}}}

UploadId = Annotated[str, PathParameter(description="Id of an upload.", max_length=80, pattern=f"^{UPLOAD_ID}$")]


@router.post(
    "",
    operation_id="create_upload",
    summary="Send in a mesh, a model or a data set",
    status_code=status.HTTP_201_CREATED,
    response_model=UploadView,
    responses={
        200: {"description": "The same content was there already.", "headers": _LOCATION, "model": UploadView},
        201: {"description": "Kept.", "headers": _LOCATION},
        **documented(400, 413, 415, 503, 507),
    },
    openapi_extra={"requestBody": {"required": True, "content": {_PLAIN: _BINARY}}},
)
async def create_upload(
    service: ServiceOf,
    request: Request,
    response: Response,
    kind: Annotated[Literal["mesh", "model", "dataset"], Query(description="What it is.")],
    name: Annotated[str, Query(description="What you call it, with its suffix.", pattern=f"^{NAME}$")],
) -> UploadView:
    """The body is the file itself. It is looked into before it is kept; the same content has the same id. Scenarios
    name it as `artefact:<id>` in `tissue.mesh_file` or `controller.model`, a training names its data set so. A model
    is JSON and a data set plain arrays: what holds a pickle is refused."""
    service.refuse_when_closing()
    suffix = _suffix(kind, name, request.headers.get("content-type", ""))
    draft = await run_in_threadpool(service.uploads.draft, suffix)
    try:
        sha256 = await _receive(request, draft)
        async with service.uploads.checking:
            found = await run_in_threadpool(_content, service, draft, kind, name, sha256)
        caller = request.state.caller
        kept, new = await run_in_threadpool(
            service.uploads.keep, draft, kind=kind, name=name, sha256=sha256, content=found, owner=caller.key_id
        )
    finally:
        await run_in_threadpool(draft.unlink, missing_ok=True)
    response.status_code = status.HTTP_201_CREATED if new else status.HTTP_200_OK
    response.headers["Location"] = f"/api/v1/uploads/{kept.id}"
    return UploadView.of(kept)


def _suffix(kind: str, name: str, content_type: str) -> str:
    """The suffix of the format. Raises HttpProblem 415 for one that is not taken, or declared as something else."""
    suffix = Path(name).suffix.lower()
    if suffix not in SUFFIXES[kind]:
        message = f"a {NAMES[kind]} must end in {', '.join(SUFFIXES[kind])}"
        raise HttpProblem(415, message, errors=[Problem("name", name, message)])
    media_type = content_type.partition(";")[0].strip().lower()
    allowed = (_PLAIN, *_MEDIA_TYPES.get(suffix, _MESH_TYPES))
    if media_type and media_type not in allowed:
        message = f"the body must be the file itself, as {' or '.join(allowed)}, not {media_type[:100]}"
        raise HttpProblem(415, message)
    return suffix


async def _receive(request: Request, draft: Path) -> str:
    """Write the body into `draft` as it comes; its SHA-256."""
    digest, waiting = hashlib.sha256(), bytearray()
    with await run_in_threadpool(draft.open, "xb") as file:

        def write(data: bytes) -> None:
            digest.update(data)
            file.write(data)

        try:
            async for chunk in request.stream():
                waiting += chunk
                if len(waiting) >= _WRITTEN_AT_ONCE:
                    await run_in_threadpool(write, bytes(waiting))
                    waiting.clear()
        except ClientDisconnect:
            raise HttpProblem(400, "the body ended early") from None

        def end() -> None:
            write(bytes(waiting))
            file.flush()
            os.fsync(file.fileno())

        await run_in_threadpool(end)
    return digest.hexdigest()


def _content(service: Service, draft: Path, kind: str, name: str, sha256: str) -> dict[str, Any]:
    """What is in it. Raises HttpProblem 422 for content that is not what its suffix says."""
    known = service.uploads.find(f"{sha256}{draft.suffix}")
    if known is not None:
        return known.content
    try:
        return checked(draft, kind)
    except BadUpload as problem:
        message = f"cannot be used as a {NAMES[kind]}: {problem}"
        raise HttpProblem(422, f"{name} {message}", errors=[Problem("body", name, message)]) from None


@router.get("", operation_id="list_uploads", summary="Uploaded files, newest first", responses=documented())
def list_uploads(
    service: ServiceOf,
    limit: Annotated[int, Query(ge=1, le=1000, description="At most so many.")] = 100,
    kind: Annotated[Literal["mesh", "model", "dataset"] | None, Query(description="Only of this kind.")] = None,
) -> UploadList:
    """Meshes and models that scenarios may name, and data sets to train models on."""
    return UploadList(items=[UploadView.of(item) for item in service.uploads.newest(limit=limit, kind=kind)])


@router.get("/{upload_id}", operation_id="get_upload", summary="One uploaded file", responses=documented(404))
def get_upload(upload_id: UploadId, service: ServiceOf) -> UploadView:
    """What is known about it."""
    return UploadView.of(service.uploads.get(upload_id))


@router.get(
    "/{upload_id}/content",
    operation_id="get_upload_content",
    summary="The content of an uploaded file",
    response_class=FileResponse,
    responses={200: {"content": {_PLAIN: _BINARY}}, **documented(400, 404, 416)},
)
def get_upload_content(upload_id: UploadId, service: ServiceOf) -> Response:
    """Byte for byte as it was sent in."""
    found = service.uploads.get(upload_id)
    path = service.uploads.path(found)
    if not path.is_file():
        raise HttpProblem(404, f"{found.id} is no longer in the data folder")
    headers = {"ETag": f'"{found.sha256}"', "Cache-Control": "no-cache"}
    return FileResponse(path, media_type=_PLAIN, filename=found.name, headers=headers)


@router.post("/{upload_id}/pin", operation_id="pin_upload", summary="Keep an uploaded file", responses=documented(404))
def pin_upload(upload_id: UploadId, service: ServiceOf) -> UploadView:
    """It is passed over when old uploads are cleared away, and cannot be deleted. Once more is no error."""
    return UploadView.of(service.uploads.pin(upload_id, pinned=True))


@router.delete(
    "/{upload_id}/pin",
    operation_id="unpin_upload",
    summary="Keep an uploaded file no longer",
    status_code=status.HTTP_204_NO_CONTENT,
    responses=documented(404),
)
def unpin_upload(upload_id: UploadId, service: ServiceOf, request: Request) -> None:
    """It may be cleared away again. Once more is no error. Another key's needs the scope admin."""
    request.state.caller.must_own(service.uploads.get(upload_id).owner, f"upload {upload_id}")
    service.uploads.pin(upload_id, pinned=False)


@router.delete(
    "/{upload_id}",
    operation_id="delete_upload",
    summary="Delete an uploaded file",
    status_code=status.HTTP_204_NO_CONTENT,
    responses=documented(404, 409),
)
def delete_upload(upload_id: UploadId, service: ServiceOf, request: Request) -> None:
    """Not while it is pinned, or a queued or running job names it. Another key's needs the scope admin."""
    found: Upload = service.uploads.get(upload_id)
    request.state.caller.must_own(found.owner, f"upload {upload_id}")
    service.uploads.delete(upload_id)
