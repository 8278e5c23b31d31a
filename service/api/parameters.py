"""Parameters that several routes and pages take: ids in paths, cursors of lists."""

from __future__ import annotations

from typing import Annotated

from fastapi import Header, Path, Query

from service.api.problems import HttpError
from service.files.upload_names import UPLOAD_ID
from service.store.job_lists import LONGEST_CURSOR
from service.store.models import MODEL_ID

_ID = "^[0-9a-z]+$"

JobId = Annotated[str, Path(description="Id of a job.", min_length=1, max_length=32, pattern=_ID)]
CampaignId = Annotated[str, Path(description="Id of a campaign.", min_length=1, max_length=32, pattern=_ID)]
ScheduleId = Annotated[str, Path(description="Id of a schedule.", min_length=1, max_length=32, pattern=_ID)]
KeyId = Annotated[str, Path(description="Id of a key.", min_length=1, max_length=32, pattern=_ID)]
ModelId = Annotated[str, Path(description="Id of a model.", max_length=80, pattern=f"^{MODEL_ID}$")]
UploadId = Annotated[str, Path(description="Id of an upload.", max_length=80, pattern=f"^{UPLOAD_ID}$")]
SuiteName = Annotated[str, Path(description="Name of a suite.", min_length=1, max_length=100)]
Cursor = Annotated[str | None, Query(pattern="^[0-9]{1,18}$", description="next_cursor of the previous page.")]
JobCursor = Annotated[
    str | None,
    Query(
        pattern="^[0-9A-Za-z_-]+$",
        max_length=LONGEST_CURSOR,
        description="next_cursor of the previous page, in the same order.",
    ),
]
IfMatch = Annotated[str | None, Header(description="ETag of the version that the change is based on.")]


def matched_version(if_match: str | None, thing: str) -> int | None:
    """The version that an If-Match header names, None for any. Raises HttpError 412 for what is no entity tag."""
    if if_match is None or if_match.strip() == "*":
        return None
    text = if_match.strip().removeprefix("W/").strip('"')
    if not text.isascii() or not text.isdigit() or len(text) > 18:
        raise HttpError(412, f"If-Match must be the ETag of the {thing}, a number in quotes, and not {if_match[:40]!r}")
    return int(text)
