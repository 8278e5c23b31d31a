"""The Rerun viewer within a page: the files of the installed version, served from the service's own address."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Header, Response
from starlette.concurrency import run_in_threadpool
from starlette.responses import FileResponse, RedirectResponse

from service.api.context import ServiceOf, etag_matches
from service.api.problems import HttpError
from service.recording import web_viewer
from service.recording.viewer import ViewerError

router = APIRouter(include_in_schema=False)


@router.get("/viewer/")
def get_viewer() -> Response:
    """To its page, whose address says what to open."""
    return RedirectResponse("/viewer/index.html", status_code=307)


@router.get("/viewer/{name}")
async def get_viewer_file(
    name: str,
    service: ServiceOf,
    accept_encoding: Annotated[str, Header()] = "",
    if_none_match: Annotated[str | None, Header()] = None,
) -> Response:
    """One of the viewer's files; the very first request extracts them from the wheel, which takes seconds."""
    if name not in web_viewer.FILES:
        raise HttpError(404, "the viewer has no such file")
    tag = f'"rerun-{web_viewer.edition()}-{name}"'
    headers = {
        "ETag": f"W/{tag}",
        "Cache-Control": "no-cache",
        "Vary": "Accept-Encoding",
        "X-Content-Type-Options": "nosniff",
    }
    if etag_matches(if_none_match, tag):
        return Response(status_code=304, headers=headers)
    try:
        home = await run_in_threadpool(web_viewer.folder, service.settings.data)
    except ViewerError as error:
        raise HttpError(503, str(error), headers={"Retry-After": "10"}) from None
    path, packed = home / name, home / f"{name}.gz"
    if name == "index.html":
        headers["Content-Security-Policy"] = web_viewer.policy(path.read_bytes())
    if "gzip" in accept_encoding.lower() and packed.is_file():
        headers |= {"Content-Encoding": "gzip", "rerun-final-length": str(path.stat().st_size)}
        path = packed
    return FileResponse(path, media_type=web_viewer.FILES[name], headers=headers)
