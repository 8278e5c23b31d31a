"""Follows a file that a running job is writing, until the job has ended."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

from fastapi import Request
from starlette.concurrency import run_in_threadpool

from service.api.context import Service
from service.store.job import RUNNING, Job

_CHUNK_BYTES = 256 * 1024
_PAUSE_S = 0.1


async def tail(service: Service, request: Request, job: Job, path_of: Callable[[Job], Path]) -> AsyncIterator[bytes]:
    """The bytes of one attempt's file as they come: a stream must not start over in its middle.

    Ends with the job or the attempt, when the client disconnects or the server shuts down. A file that is
    replaced at the end (compacted) is read to the end of its first form.
    """
    attempt = job.attempt or 1
    file: BinaryIO | None = None
    try:
        while True:
            now = await run_in_threadpool(service.store.get_summary, job.id)
            over = now.terminal or now.attempt > attempt or service.changes.closed
            if (file is None and now.attempt == attempt and now.state == RUNNING) or now.terminal:
                file = file or await run_in_threadpool(_open, path_of(now))
            while file is not None and (chunk := await run_in_threadpool(file.read, _CHUNK_BYTES)):
                yield chunk
            if over or await request.is_disconnected():
                return
            await asyncio.sleep(_PAUSE_S)
    finally:
        if file is not None:
            file.close()


def _open(path: Path) -> BinaryIO | None:
    with suppress(OSError):
        return path.open("rb")
    return None
