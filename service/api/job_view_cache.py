"""The JSON of jobs, kept in memory until they change: most requests are about a job that has not changed."""

from __future__ import annotations

import threading
from dataclasses import dataclass

from starlette.concurrency import run_in_threadpool

from service.api.schemas.jobs import JobView
from service.store.job import Job
from service.store.job_queries import JobQueries

_MOST = 500  # jobs in memory, about 6 kB each
_LONGEST = 50_000  # bytes of JSON of one that is kept: a scenario with its poses inline has up to a megabyte


@dataclass(frozen=True, slots=True)
class EncodedJob:
    """A job as it is shown. tag: the entity tag of this version of it. body: JSON of the `JobView`."""

    tag: str
    terminal: bool
    body: bytes

    @classmethod
    def of(cls, job: Job) -> EncodedJob:
        """The JSON of a job, encoded."""
        return cls(tag=f'"{job.version}"', terminal=job.terminal, body=JobView.of(job).model_dump_json().encode())


class JobViewCache:
    """The JSON of the jobs requested last. `forget` must be called for every change, once it can be read."""

    def __init__(self, store: JobQueries, *, most: int = _MOST) -> None:
        self._store = store
        self._most = most
        self._lock = threading.Lock()
        self._known: dict[str, EncodedJob] = {}  # least recently requested first
        self._changes = 0

    async def of(self, job_id: str) -> EncodedJob:
        """The job now; only an unknown one takes a thread and the database. Raises UnknownJobError."""
        with self._lock:
            if (known := self._known.pop(job_id, None)) is not None:
                self._known[job_id] = known
                return known
        return await run_in_threadpool(self._read, job_id)

    def _read(self, job_id: str) -> EncodedJob:
        before = self._changes
        status = EncodedJob.of(self._store.get(job_id))
        with self._lock:
            if self._changes == before and len(status.body) <= _LONGEST:  # else what was read may be out of date
                self._known[job_id] = status
                if len(self._known) > self._most:
                    del self._known[next(iter(self._known))]
        return status

    def forget(self, job_id: str) -> None:
        """The job changed. From any thread."""
        with self._lock:
            self._changes += 1
            self._known.pop(job_id, None)
