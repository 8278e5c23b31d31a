"""One look at the database a change, for all streams of events together, and a short queue for each of them.

A stream that reads more slowly than things happen is dropped when its queue is full: it begins again after the last
event that it was sent, whose number it knows. Progress is no event: of each job only the newest is kept for a stream.
"""

from __future__ import annotations

import asyncio
import json
import logging
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field

from fastapi.sse import format_sse_event
from starlette.concurrency import run_in_threadpool

from service.api.schemas.jobs import EventView, Progress
from service.engine.change_notifier import EVERYTHING, Changes
from service.logs import ROOT
from service.store.errors import SQLAlchemyError
from service.store.job import Event, Job
from service.store.job_queries import JobQueries

MOST_WAITING = 500  # events that a stream may be behind, one after the other
BATCH = 200  # events of one look
LOOK_AGAIN_S = 10.0  # without a change
PAUSE_S = 0.05  # between two looks: what happens within it costs one
_log = logging.getLogger(ROOT)


@dataclass(frozen=True, slots=True)
class EncodedEvent:
    """An event as it is sent, encoded once for all streams."""

    seq: int
    job_id: str
    kind: str
    data: bytes

    @classmethod
    def of(cls, event: Event) -> EncodedEvent:
        """The event, encoded."""
        view = EventView.of(event)
        data = format_sse_event(event=event.kind, id=str(event.seq), data_str=view.model_dump_json())
        return cls(event.seq, event.job_id, event.kind, data)


@dataclass(eq=False)
class Subscription:
    """What waits for one stream. job_id: None = of all jobs. dropped: events were lost, the stream must end."""

    job_id: str | None
    events: deque[EncodedEvent] = field(default_factory=deque)
    progress: dict[str, bytes] = field(default_factory=dict)  # of the jobs that run
    news: asyncio.Event = field(default_factory=asyncio.Event)
    dropped: bool = False

    def give(self, events: list[EncodedEvent], progress: dict[str, bytes]) -> None:
        """Put what is for this stream into its queue."""
        wanted = [event for event in events if self.job_id in (None, event.job_id)]
        if len(self.events) + len(wanted) > MOST_WAITING:
            self.dropped = True
            self.events.clear()
            wanted = []
        self.events.extend(wanted)
        running = {job_id: data for job_id, data in progress.items() if self.job_id in (None, job_id)}
        self.progress |= running
        if wanted or running or self.dropped:
            self.news.set()

    def next_event(self, after: int) -> EncodedEvent | None:
        """The next one above this number; those below were sent before the queue began."""
        while self.events:
            event = self.events.popleft()
            if event.seq > after:
                return event
        return None

    async def more(self, seconds: float) -> bool:
        """Wait until there is something, or so long; whether there is."""
        self.news.clear()
        with suppress(TimeoutError):
            await asyncio.wait_for(self.news.wait(), seconds)
        return self.news.is_set()


class EventHub:
    """The streams of one server. It looks while there is one."""

    def __init__(self, store: JobQueries, changes: Changes) -> None:
        self._store = store
        self._changes = changes
        self._streams: set[Subscription] = set()
        self._task: asyncio.Task[None] | None = None
        self._placed = asyncio.Event()  # it knows from where on it hands on events
        self._versions: dict[str, int] = {}  # of the progress that was handed on last
        self.looks = 0

    @contextmanager
    def subscribe(self, job_id: str | None) -> Iterator[Subscription]:
        """A queue of all that is committed from now on. What was committed before is read by the stream itself, which
        passes over what it finds in both."""
        mine = Subscription(job_id)
        self._streams.add(mine)
        if self._task is None or self._task.done():
            self._placed = asyncio.Event()
            self._task = asyncio.get_running_loop().create_task(self._run())
        try:
            yield mine
        finally:
            self._streams.discard(mine)

    async def ready(self) -> None:
        """Wait until whatever is committed from now on is handed on: only then may a stream read what was before."""
        await self._placed.wait()

    async def _run(self) -> None:
        try:
            with self._changes.watch(EVERYTHING) as changed:
                position = await self._position()
                self._placed.set()
                while self._streams and not self._changes.closed:
                    changed.clear()
                    position, more = await self._look(position)
                    if not more:
                        with suppress(TimeoutError):
                            await asyncio.wait_for(changed.wait(), LOOK_AGAIN_S)
                    await asyncio.sleep(PAUSE_S)
        finally:
            self._placed.set()
            self._versions.clear()
            for stream in self._streams:  # those that are left look for themselves whether the server ends
                stream.dropped = True
                stream.news.set()

    async def _position(self) -> int:
        """The number of the last event now; streams read those before it themselves."""
        while True:
            try:
                return await run_in_threadpool(self._store.last_event)
            except SQLAlchemyError as error:
                _log.warning("events: %s", error)
                await asyncio.sleep(1.0)

    async def _look(self, position: int) -> tuple[int, bool]:
        """Hand on what came after `position`; the new position, and whether there is more at once."""
        try:
            events, running = await run_in_threadpool(self._read, position)
        except SQLAlchemyError as error:  # a full disk, a locked database: later
            _log.warning("events: %s", error)
            return position, False
        encoded, progress = [EncodedEvent.of(event) for event in events], self._advanced(running)
        if encoded or progress:
            for stream in tuple(self._streams):
                stream.give(encoded, progress)
        return (events[-1].seq if events else position), len(events) == BATCH

    def _read(self, position: int) -> tuple[list[Event], list[Job]]:
        self.looks += 1
        return self._store.events(after=position, limit=BATCH), self._store.running()

    def _advanced(self, running: list[Job]) -> dict[str, bytes]:
        """The progress of the jobs that got on since the last look, encoded."""
        started = {job.id: job for job in running if job.progress}
        news = {name: progress_event(job) for name, job in started.items() if self._versions.get(name) != job.version}
        self._versions = {name: job.version for name, job in started.items()}
        return news


def progress_event(job: Job) -> bytes:
    """The progress of a job, which has no number."""
    data = {"job": job.id, "attempt": job.attempt, **Progress.of(job).model_dump()}
    return format_sse_event(event="progress", data_str=json.dumps(data, allow_nan=False))
