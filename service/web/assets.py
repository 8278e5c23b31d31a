"""Styles, scripts and pictures of the pages, at an address that contains the digest of all of them."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

from fastapi import APIRouter, Header, Response

from service.api.context import etag_matches
from service.api.problems import HttpError

router = APIRouter(include_in_schema=False)

FOLDER = Path(__file__).with_name("static")
_TYPES = {
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
    "": "text/plain; charset=utf-8",
}
_FOREVER = "public, max-age=31536000, immutable"


@cache
def files() -> dict[str, bytes]:
    """Every file by its name relative to the folder; read once, so that no request ever reaches the disk."""
    paths = sorted(path for path in FOLDER.rglob("*") if path.is_file() and path.suffix in _TYPES)
    return {path.relative_to(FOLDER).as_posix(): path.read_bytes() for path in paths}


@cache
def digest() -> str:
    """Of all files and their names: it changes whenever any of them does."""
    hashed = hashlib.sha256()
    for name, content in files().items():
        hashed.update(f"{name}\0{len(content)}\0".encode() + content)
    return hashed.hexdigest()[:16]


def url(name: str) -> str:
    """Address of a file. Raises KeyError for an unknown one."""
    if name not in files():
        raise KeyError(name)
    return f"/static/{digest()}/{name}"


@router.get("/static/{version}/{name:path}")
def get_asset(version: str, name: str, if_none_match: str | None = Header(None)) -> Response:
    """One file; a script that imports another by a relative name stays within one version."""
    content = files().get(name)
    if content is None or version != digest():
        raise HttpError(404, "this version of the pages has no such file")
    headers = {"ETag": f'"{version}"', "Cache-Control": _FOREVER, "X-Content-Type-Options": "nosniff"}
    if etag_matches(if_none_match, headers["ETag"]):
        return Response(status_code=304, headers=headers)
    return Response(content, media_type=_TYPES[Path(name).suffix], headers=headers)
