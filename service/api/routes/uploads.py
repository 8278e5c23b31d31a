"""Routes of uploaded files: meshes, models, data sets, poses, which scenarios and trainings refer to by id."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response, status
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect
from starlette.responses import FileResponse

from service.admission.upload_check import UnusableUploadError, inspect
from service.api.context import Service, ServiceOf
from service.api.openapi import documented
from service.api.parameters import Cursor, UploadId
from service.api.problems import HttpError
from service.api.schemas.uploads import UploadKind, UploadList, UploadView
from service.api.served_file import served_file
from service.files.upload_names import NAME, NAMES, SUFFIXES
from service.store.uploads import Upload, UploadsFullError
from simcore.errors import Problem

router = APIRouter(prefix="/api/v1/uploads", tags=["uploads"])

_BINARY = {"schema": {"type": "string", "format": "binary"}}
_PLAIN = "application/octet-stream"
_MEDIA_TYPES = {".npz": ("application/x-npz", "application/zip"), ".json": ("application/json",), ".npy": ()}
_MESH_TYPES = ("model/mesh",)
_WRITTEN_AT_ONCE = 2**20
_LOCATION = {"Location": {"description": "Address of the upload.", "schema": {"type": "string"}}}


@router.post(
    "",
    operation_id="create_upload",
    summary="Upload a mesh, a model, a data set or poses",
    status_code=status.HTTP_201_CREATED,
    response_model=UploadView,
    responses={
        200: {"description": "The same content was uploaded before.", "headers": _LOCATION, "model": UploadView},
        201: {"description": "Stored.", "headers": _LOCATION},
        **documented(400, 413, 415, 503, 507),
    },
    openapi_extra={"requestBody": {"required": True, "content": {_PLAIN: _BINARY}}},
)
async def create_upload(
    service: ServiceOf,
    request: Request,
    response: Response,
    kind: Annotated[UploadKind, Query(description="What it is.")],
    name: Annotated[str, Query(description="Its name, with its suffix.", pattern=f"^{NAME}$")],
) -> UploadView:
    """The body is the file itself. It is checked before it is stored; the same content has the same id. Scenarios
    refer to it as `artefact:<id>` in `tissue.mesh_file`, `controller.model` or `controller.poses_file`, a training in
    `data`. A model is JSON, data set and poses are plain arrays: files that hold pickles are refused."""
    service.refuse_when_closing()
    suffix = _suffix(kind, name, request.headers.get("content-type", ""))
    draft = await run_in_threadpool(service.uploads.draft, suffix)
    try:
        upload, new = await _take(service, request, draft, kind, name)
    finally:
        await run_in_threadpool(service.uploads.drop, draft)
    response.status_code = status.HTTP_201_CREATED if new else status.HTTP_200_OK
    response.headers["Location"] = f"/api/v1/uploads/{upload.id}"
    return UploadView.of(upload)


def _suffix(kind: str, name: str, content_type: str) -> str:
    """The suffix of the format. Raises HttpError 415 for an unknown one, or one that contradicts the content type."""
    suffix = Path(name).suffix.lower()
    if suffix not in SUFFIXES[kind]:
        message = f"a {NAMES[kind]} must end in {', '.join(SUFFIXES[kind])}"
        raise HttpError(415, message, errors=[Problem("name", name, message)])
    media_type = content_type.partition(";")[0].strip().lower()
    allowed = (_PLAIN, *_MEDIA_TYPES.get(suffix, _MESH_TYPES))
    if media_type and media_type not in allowed:
        message = f"the body must be the file itself, as {' or '.join(allowed)}, not {media_type[:100]}"
        raise HttpError(415, message)
    return suffix


async def _take(service: Service, request: Request, draft: Path, kind: str, name: str) -> tuple[Upload, bool]:
    """Receive it, check it and keep it; whether it is new. What is known takes no room: it is found when there is none.

    Raises HttpError, UploadsFullError.
    """
    sha256, full = await _receive(request, draft, service.uploads.grow)
    if full is not None:
        known = await run_in_threadpool(service.uploads.find, f"{sha256}{draft.suffix}")
        if known is None:
            raise full
        return known, False
    async with service.uploads.checking:
        content = await run_in_threadpool(_content, service, draft, kind, name, sha256)
    owner = request.state.caller.key_id
    return await run_in_threadpool(
        service.uploads.keep, draft, kind=kind, name=name, sha256=sha256, content=content, owner=owner
    )


async def _receive(
    request: Request, draft: Path, grow: Callable[[Path, int], None]
) -> tuple[str, UploadsFullError | None]:
    """Write the body into `draft` as it arrives; its SHA-256, and what `grow` said when it found no room.

    grow: hears of bytes before they are written. From where it refuses, the body is read for its digest alone.
    """
    digest, waiting = hashlib.sha256(), bytearray()
    full: list[UploadsFullError] = []
    with await run_in_threadpool(draft.open, "xb") as file:

        def write(data: bytes) -> None:
            digest.update(data)
            if not full:
                try:
                    grow(draft, len(data))
                except UploadsFullError as error:
                    full.append(error)
                else:
                    file.write(data)

        try:
            async for chunk in request.stream():
                waiting += chunk
                if len(waiting) >= _WRITTEN_AT_ONCE:
                    await run_in_threadpool(write, bytes(waiting))
                    waiting.clear()
        except ClientDisconnect:
            raise HttpError(400, "the body ended early", code="body-incomplete") from None

        def end() -> None:
            write(bytes(waiting))
            file.flush()
            os.fsync(file.fileno())

        await run_in_threadpool(end)
    return digest.hexdigest(), full[0] if full else None


def _content(service: Service, draft: Path, kind: str, name: str, sha256: str) -> dict[str, Any]:
    """What is in it. Raises HttpError 422 for content that does not match its suffix."""
    known = service.uploads.find(f"{sha256}{draft.suffix}")
    if known is not None:
        return known.content
    try:
        return inspect(draft, kind)
    except UnusableUploadError as problem:
        message = f"cannot be used as a {NAMES[kind]}: {problem}"
        errors = [Problem("body", name, message)]
        raise HttpError(422, f"{name} {message}", errors=errors, code="upload-unusable") from None


@router.get("", operation_id="list_uploads", summary="Uploaded files, newest first", responses=documented())
def list_uploads(
    service: ServiceOf,
    limit: Annotated[int, Query(ge=1, le=1000, description="Most items of the list.")] = 100,
    kind: Annotated[UploadKind | None, Query(description="Only of this kind.")] = None,
    cursor: Cursor = None,
) -> UploadList:
    """Meshes, models and poses that scenarios may use, and data sets to train models on."""
    page = service.uploads.page(size=limit, cursor=cursor, kind=kind)
    return UploadList(items=[UploadView.of(item) for item in page.items], next_cursor=page.next_cursor)


@router.get("/{upload_id}", operation_id="get_upload", summary="One uploaded file", responses=documented(404))
def get_upload(upload_id: UploadId, service: ServiceOf) -> UploadView:
    """Its name, size, digest and content."""
    return UploadView.of(service.uploads.get(upload_id))


@router.get(
    "/{upload_id}/content",
    operation_id="get_upload_content",
    summary="The content of an uploaded file",
    response_class=FileResponse,
    responses={200: {"content": {_PLAIN: _BINARY}}, **documented(400, 404, 410, 416)},
)
def get_upload_content(upload_id: UploadId, service: ServiceOf, request: Request) -> Response:
    """Byte for byte as it was uploaded."""
    upload = service.uploads.get(upload_id)
    path = service.uploads.path(upload)
    return served_file(request, path, sha256=upload.sha256, size=upload.bytes, media_type=_PLAIN, filename=upload.name)


@router.post("/{upload_id}/pin", operation_id="pin_upload", summary="Pin an uploaded file", responses=documented(404))
def pin_upload(upload_id: UploadId, service: ServiceOf) -> UploadView:
    """A pinned upload is kept when old ones are removed, and cannot be deleted. Idempotent."""
    return UploadView.of(service.uploads.pin(upload_id, pinned=True))


@router.delete(
    "/{upload_id}/pin",
    operation_id="unpin_upload",
    summary="Unpin an uploaded file",
    status_code=status.HTTP_204_NO_CONTENT,
    responses=documented(404),
)
def unpin_upload(upload_id: UploadId, service: ServiceOf) -> None:
    """It may be removed again. Idempotent. An upload of another key needs the scope admin."""
    service.uploads.pin(upload_id, pinned=False)


@router.delete(
    "/{upload_id}",
    operation_id="delete_upload",
    summary="Delete an uploaded file",
    status_code=status.HTTP_204_NO_CONTENT,
    responses=documented(404, 409),
)
def delete_upload(upload_id: UploadId, service: ServiceOf) -> None:
    """Not while it is pinned or a queued or running job uses it. An upload of another key needs the scope admin."""
    service.uploads.delete(upload_id)
