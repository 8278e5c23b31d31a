"""Parameters that several routes and pages take: ids in paths, cursors of lists."""

from __future__ import annotations

from typing import Annotated

from fastapi import Path, Query

from service.files.upload_names import UPLOAD_ID
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
