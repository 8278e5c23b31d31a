"""The pages of uploaded files: the list, one of them with the jobs that use it, the picture of a mesh."""

from __future__ import annotations

import threading
from functools import lru_cache
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response

from service.api.context import Service, ServiceOf
from service.api.parameters import Cursor, UploadId
from service.api.problems import HttpError
from service.api.schemas.jobs import JobSummary
from service.api.schemas.uploads import UploadKind, UploadView
from service.display import flat
from service.files.upload_names import NAMES
from service.store.upload_references import jobs_with, users_of
from service.store.uploads import UnknownUploadError, Upload
from service.web.pictures.mesh import MOST_TETRAHEDRA, mesh_svg
from service.web.site import missing, page
from simcore.errors import ScenarioError

router = APIRouter(include_in_schema=False)

ROWS = 30
JOBS = 50
KEPT_PICTURES = 64
_drawing = threading.Lock()  # one mesh at a time: a large one takes seconds and memory
_FOREVER = "private, max-age=31536000, immutable"  # an id is a digest: its picture never changes


@router.get("/uploads")
def get_uploads(
    request: Request,
    service: ServiceOf,
    kind: Annotated[UploadKind | None, Query()] = None,
    cursor: Cursor = None,
) -> Response:
    """All files that were sent in or made here, newest first."""
    found = service.uploads.page(size=ROWS, cursor=cursor, kind=kind)
    senders = _senders(service)
    return page(
        request,
        "uploads.html",
        uploads=[(UploadView.of(one), _sender(one, senders), _drawable(one)) for one in found.items],
        users=users_of(service.store, {one.id for one in found.items}),
        older_than=found.next_cursor,
        cursor=cursor,
        wanted=kind,
        kinds=NAMES,
    )


@router.get("/uploads/{upload_id}")
def get_upload(upload_id: UploadId, request: Request, service: ServiceOf) -> Response:
    """One file: what is in it, who sent it, which jobs name it."""
    try:
        found = service.uploads.get(upload_id)
    except UnknownUploadError:
        return missing(request, f"upload {upload_id}")
    return page(
        request,
        "upload.html",
        upload=UploadView.of(found),
        sender=_sender(found, _senders(service)),
        drawn=_drawable(found),
        content=[(name, value) for name, value in flat(_shown(found)) if name != "kind"],
        kind=NAMES[found.kind],
        users=[JobSummary.of(job) for job in jobs_with(service.store, found.id, limit=JOBS)],
        count=users_of(service.store, [found.id])[found.id],
        most=JOBS,
    )


@router.get("/uploads/{upload_id}/picture.svg")
def get_picture(upload_id: UploadId, service: ServiceOf) -> Response:
    """The surface of a mesh."""
    found = service.uploads.get(upload_id)
    if not _drawable(found):
        raise HttpError(404, "there is no picture of this upload")
    with _drawing:
        try:
            text = _picture(str(service.uploads.path(found)))
        except ScenarioError as error:
            raise HttpError(404, error.problems[0].message) from None
    headers = {"Cache-Control": _FOREVER, "X-Content-Type-Options": "nosniff", "Content-Security-Policy": "sandbox"}
    return Response(text, media_type="image/svg+xml", headers=headers)


@lru_cache(maxsize=KEPT_PICTURES)
def _picture(path: str) -> str:
    from simcore.mesh.reader import body_of  # slow to import, and only for a picture

    body = body_of(path)
    return mesh_svg(body.points, body.tets)


def _drawable(upload: Upload) -> bool:
    return upload.kind == "mesh" and upload.content.get("tetrahedra", 0) <= MOST_TETRAHEDRA


def _shown(upload: Upload) -> dict[str, Any]:
    """What is worth a line; models and data sets have their whole provenance too."""
    return {name: value for name, value in upload.content.items() if name != "provenance"}


def _senders(service: Service) -> dict[str, str]:
    return {key.id: key.note for key in service.keys.all()}


def _sender(upload: Upload, notes: dict[str, str]) -> str:
    """Who sent it, as people know them: the note of the key, else its id."""
    if upload.owner is None:
        return "this machine"
    return notes.get(upload.owner) or f"key {upload.owner}"
