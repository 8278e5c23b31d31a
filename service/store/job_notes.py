"""What people say about a job: its name, tags and note, and whether it is to be kept. None of it changes its state."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sqlalchemy import update

from service.store.job import JobChangedError
from service.store.job_queries import JOB, read
from service.store.transitions import Transitions

if TYPE_CHECKING:
    from sqlalchemy import Connection

    from service.store.job import Job


class JobNotes(Transitions):
    """Changes of what is said about a job."""

    def edit(self, job_id: str, values: dict[str, Any], *, version: int | None = None) -> Job:
        """Give a job another name, other tags, another note; values: those of the three that are given.

        version: that which the change is based on, None = any. Raises JobChangedError when it has another by now,
        UnknownJobError.
        """
        with self._write() as connection:
            job = read(connection, job_id)
            if version is not None and version != job.version:
                raise JobChangedError(f"job {job_id} was changed meanwhile: it has version {job.version}")
            changed = {name: value for name, value in values.items() if value != getattr(job, name)}
            if not changed:
                return job
            job = self._say(connection, job, changed, "edited", {"fields": ", ".join(sorted(changed))})
        self.notify(job_id)
        return job

    def pin(self, job_id: str, *, pinned: bool) -> Job:
        """Keep a job out of every retention, or no longer. Idempotent."""
        with self._write() as connection:
            job = read(connection, job_id)
            if job.pinned == pinned:
                return job
            job = self._say(connection, job, {"pinned": pinned}, "pinned" if pinned else "unpinned")
        self.notify(job_id)
        return job

    def _say(
        self, connection: Connection, job: Job, values: dict[str, Any], kind: str, data: dict[str, Any] | None = None
    ) -> Job:
        """The job with these values; logged as an event of this kind."""
        newer = {**values, "version": JOB.c.version + 1}
        connection.execute(update(JOB).where(JOB.c.id == job.id).values(**newer))
        self._log(connection, job, kind, data)
        return read(connection, job.id)
