"""Files that are served: only as they were written, with their digest as their entity tag."""

from __future__ import annotations

import re
from pathlib import Path

from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.responses import FileResponse, Response
from starlette.types import Receive, Scope, Send

from service.api.context import etag_matches
from service.api.problems import HttpError, problem_response
from service.files.intact import IntactFiles

_INTACT = IntactFiles()
_RANGE = re.compile(r"(?:[0-9]+-[0-9]*|-[0-9]+)?", re.ASCII)
_NO_RANGE = "the Range header is not a range of bytes, as in bytes=0-99"


class _WholeOrRange(FileResponse):
    """Ignores a Range header in a unit that it does not know, as HTTP asks for (RFC 9110, 14.2), and refuses one whose
    numbers are none of HTTP's, such as +1 or 1_0."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        asked = Headers(scope=scope).get("range")
        if asked is not None and asked.partition("=")[0].strip().lower() == "bytes":
            if not _is_ranges(asked):
                await problem_response(400, _NO_RANGE, instance=scope["path"])(scope, receive, send)
                return
        elif asked is not None:
            kept = [(name, value) for name, value in scope["headers"] if name != b"range"]
            scope = {**scope, "headers": kept}
        await super().__call__(scope, receive, send)


def _is_ranges(header: str) -> bool:
    """Whether a Range header is `bytes=` and a list of ranges, of which some may be empty."""
    unit, _, ranges = header.partition("=")
    return unit.lower() == "bytes" and all(_RANGE.fullmatch(one.strip(" \t")) for one in ranges.split(","))


def served_file(
    request: Request, path: Path, *, sha256: str, size: int, media_type: str, filename: str | None = None
) -> Response:
    """The file, or 304 for who has it already. Blocks: the file may be read through first.

    Raises HttpError 404 for one that is gone, DamagedFileError for one that is not what its digest says.
    """
    try:
        _INTACT.check(path, sha256=sha256, size=size)
    except OSError:
        raise HttpError(404, f"{filename or path.name} is no longer in the data folder", code="file-missing") from None
    headers = {"ETag": f'"{sha256}"', "Cache-Control": "no-cache"}
    if etag_matches(request.headers.get("if-none-match"), headers["ETag"]):
        return Response(status_code=304, headers=headers)
    return _WholeOrRange(path, media_type=media_type, filename=filename, headers=headers)


def check_intact(path: Path, *, sha256: str, size: int, name: str) -> None:
    """As `served_file`, for a file whose content is read and shown in another form."""
    try:
        _INTACT.check(path, sha256=sha256, size=size)
    except OSError:
        raise HttpError(404, f"{name} is no longer in the data folder", code="file-missing") from None
