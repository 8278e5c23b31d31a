"""The client's calls about what is said of jobs, about pins, and about many jobs at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from service.client.connection import Connection, part
from service.client.records import JobStatus

if TYPE_CHECKING:
    from collections.abc import Sequence

Action = Literal["cancel", "retry", "pin", "unpin", "delete"]
_AT_ONCE = 200  # jobs of one request


@dataclass(frozen=True, kw_only=True)
class ActionOutcome:
    """What came of an action for one job. code, detail: of the problem, None where it was done."""

    job: str
    done: bool
    code: str | None
    detail: str | None


class JobEdits(Connection):
    """Name, tags and note of jobs; pins; actions over many jobs."""

    def edit(
        self, job_id: str, *, name: str | None = None, tags: Sequence[str] | None = None, note: str | None = None
    ) -> JobStatus:
        """Give the job another name, other tags, another note; what is None stays. Its scenario keeps its own name."""
        given = {"name": name, "tags": None if tags is None else list(tags), "note": note}
        body = {key: value for key, value in given.items() if value is not None}
        return JobStatus.of(self._json("PATCH", f"/api/v1/jobs/{part(job_id)}", json=body))

    def pin(self, job_id: str) -> JobStatus:
        """Keep the job and its files when old jobs are removed."""
        return JobStatus.of(self._json("POST", f"/api/v1/jobs/{part(job_id)}/pin"))

    def unpin(self, job_id: str) -> None:
        """Allow it to be removed again."""
        self._request("DELETE", f"/api/v1/jobs/{part(job_id)}/pin")

    def delete(self, job_id: str) -> None:
        """Delete a job that has ended, with all its files."""
        self._request("DELETE", f"/api/v1/jobs/{part(job_id)}")

    def act(self, action: Action, job_ids: Sequence[str]) -> list[ActionOutcome]:
        """Cancel, retry, pin, unpin or delete many jobs. A job for which that cannot be done says why and holds up no
        other."""
        outcomes: list[ActionOutcome] = []
        for first in range(0, len(job_ids), _AT_ONCE):
            body = {"action": action, "jobs": list(job_ids[first : first + _AT_ONCE])}
            answer = self._json("POST", "/api/v1/jobs/actions", json=body)
            outcomes += [ActionOutcome(**item) for item in answer["items"]]
        return outcomes
