"""The log of jobs as a list; the stream is tested against a real server."""

from __future__ import annotations

import asyncio
import threading
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING

import pytest

from service.api import event_hub
from service.api.event_hub import EventHub, Subscription
from service.engine.change_notifier import Changes
from service.store.job import FINISHED, Outcome
from tests.service.http import finish, idle_service

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from starlette.testclient import TestClient

    from service.api.context import Service

JOBS = "/api/v1/jobs"


@pytest.fixture
def both(tmp_path: Path) -> Iterator[tuple[TestClient, Service]]:
    with idle_service(tmp_path) as pair:
        yield pair


def submit(http: TestClient) -> str:
    return str(http.post(JOBS, json={"scenario": "line"}).json()["id"])


def test_the_events_of_a_job_are_listed_from_any_number_on(both: tuple[TestClient, Service]) -> None:
    http, service = both
    other, job = submit(http), submit(http)
    http.post(f"{JOBS}/{other}/cancel")
    finish(service)
    items = http.get(f"{JOBS}/{job}/events").json()["items"]
    assert [item["kind"] for item in items] == ["queued", "started", "finished"]
    assert {item["job"] for item in items} == {job}
    rest = http.get(f"{JOBS}/{job}/events", params={"after": items[0]["id"]}).json()["items"]
    assert rest == items[1:]
    everything = http.get("/api/v1/events").json()["items"]
    assert [item["id"] for item in everything] == sorted(item["id"] for item in everything)
    assert {item["job"] for item in everything} == {job, other}


@pytest.mark.slow
def test_a_browser_that_knows_all_of_an_ended_job_is_told_to_stop(both: tuple[TestClient, Service]) -> None:
    http, service = both
    job = submit(http)
    finish(service)
    last = http.get(f"{JOBS}/{job}/events").json()["items"][-1]["id"]
    headers = {"Accept": "text/event-stream", "Last-Event-ID": str(last)}
    assert http.get(f"{JOBS}/{job}/events", headers=headers).status_code == 204
    assert http.get(f"{JOBS}/{job}/events", headers={**headers, "Last-Event-ID": "x"}).status_code == 422


@pytest.mark.slow
def test_an_ended_job_streams_its_whole_log_and_ends(both: tuple[TestClient, Service]) -> None:
    http, service = both
    job = submit(http)
    finish(service)
    answer = http.get(f"{JOBS}/{job}/events", headers={"Accept": "text/event-stream"})
    assert answer.headers["content-type"].startswith("text/event-stream")
    kinds = [line.removeprefix("event: ") for line in answer.text.splitlines() if line.startswith("event: ")]
    assert kinds == ["queued", "started", "finished"]
    assert answer.text.count("\nid: ") == 3


@pytest.mark.slow
def test_a_job_that_failed_is_queued_again_and_one_that_did_not_is_refused(both: tuple[TestClient, Service]) -> None:
    http, service = both
    job = submit(http)
    url = f"{JOBS}/{job}"
    assert http.post(f"{url}/retry").status_code == 409
    running = service.store.claim()
    assert running is not None
    service.store.finish(running, Outcome(state="failed", error_kind="exception", error="x"))
    again = http.post(f"{url}/retry")
    assert (again.status_code, again.json()["state"], again.json()["error"]) == (202, "queued", None)
    done = finish(service)
    assert (done.id, done.attempt) == (job, 2)
    assert http.post(f"{url}/retry").status_code == 409
    kinds = [item["kind"] for item in http.get(f"{url}/events").json()["items"]]
    assert kinds == ["queued", "started", "failed", "queued", "started", "finished"]


def test_a_pinned_job_is_kept(both: tuple[TestClient, Service]) -> None:
    http, service = both
    url = f"{JOBS}/{submit(http)}"
    finish(service)
    for _ in range(2):
        assert http.post(f"{url}/pin").json()["pinned"] is True
    assert http.delete(url).status_code == 409
    for _ in range(2):
        assert http.delete(f"{url}/pin").status_code == 204
    assert http.get(url).json()["pinned"] is False
    assert http.delete(url).status_code == 204


def test_progress_is_told_once_and_that_of_an_ended_job_forgotten(both: tuple[TestClient, Service]) -> None:
    http, service = both
    hub = service.events
    for _ in range(3):
        submit(http)
        started = service.store.claim()
        assert started is not None
        assert hub._advanced([started]) == {}
        for step in (1, 2):
            service.store.beat(started, {"step": step, "steps": 2, "fraction": 0.5 * step})
            assert list(hub._advanced(service.store.running())) == [started.id]
            assert hub._advanced(service.store.running()) == {}
        assert list(hub._versions) == [started.id]
        service.store.finish(started, Outcome(state=FINISHED, result={}))
        assert hub._advanced(service.store.running()) == {}
        assert hub._versions == {}


async def _settled(hub: EventHub, streams: list[Subscription], number: int) -> None:
    while not all(stream.dropped or (stream.events and stream.events[-1].seq >= number) for stream in streams):
        await asyncio.sleep(0.01)
    del hub


@pytest.mark.slow
def test_one_look_a_change_serves_all_streams_and_a_slow_one_is_dropped(
    both: tuple[TestClient, Service], monkeypatch: pytest.MonkeyPatch
) -> None:
    http, service = both
    monkeypatch.setattr(event_hub, "MOST_WAITING", 20)

    async def scenario() -> None:
        hub = service.events
        with ExitStack() as stack:
            streams = [stack.enter_context(hub.subscribe(None)) for _ in range(500)]
            one = stack.enter_context(hub.subscribe("another job"))
            await asyncio.sleep(0.5)  # it knows where it begins
            before = hub.looks
            for _ in range(10):
                await asyncio.to_thread(submit, http)
            await _settled(hub, streams, service.store.last_event())
            assert 1 <= hub.looks - before <= 12  # not 5000
            assert [event.kind for event in streams[0].events] == ["queued"] * 10
            assert not one.events
            read = streams[1:]
            while not streams[0].dropped:
                for stream in read:
                    stream.events.clear()
                await asyncio.to_thread(submit_many, service, 11)
                await _settled(hub, read, service.store.last_event())
            assert not streams[0].events
            assert not any(stream.dropped for stream in read)
            assert max(len(stream.events) for stream in read) <= 20
        await asyncio.sleep(0)

    asyncio.run(scenario())


def submit_many(service: Service, count: int) -> None:
    values = {"spec": {}, "spec_hash": "", "steps": 1, "priority": 0, "timeout_s": 60.0}
    for number in range(count):
        service.store.submit(name=f"j{number}", **values)  # type: ignore[arg-type]


def test_a_stream_that_fell_behind_ends_and_says_where_to_begin_again(
    both: tuple[TestClient, Service], monkeypatch: pytest.MonkeyPatch
) -> None:
    http, service = both
    submit(http)
    last = service.store.last_event()
    subscribe = EventHub.subscribe

    @contextmanager
    def slow(self: EventHub, job_id: str | None) -> Iterator[Subscription]:
        with subscribe(self, job_id) as stream:
            stream.dropped = True
            yield stream

    monkeypatch.setattr(EventHub, "subscribe", slow)
    answer = http.get("/api/v1/events?after=0", headers={"Accept": "text/event-stream"})
    assert f'event: dropped\ndata: {{"after": {last}}}' in answer.text
    assert answer.text.count("event: queued") == 1


class _SlowLog:
    """A store whose last event takes as long to find as the test wants."""

    def __init__(self) -> None:
        self.found = threading.Event()

    def last_event(self) -> int:
        assert self.found.wait(30)
        return 7

    def events(self, **_: object) -> list[object]:
        return []

    def running(self) -> list[object]:
        return []


def test_a_stream_waits_until_the_hub_knows_its_place() -> None:
    """Else an event between the stream's own reading and that place would be handed on by nobody."""
    log = _SlowLog()

    async def scene() -> None:
        hub = EventHub(log, Changes())  # type: ignore[arg-type]
        with hub.subscribe(None):
            waiting = asyncio.create_task(hub.ready())
            await asyncio.sleep(0.1)
            assert not waiting.done()
            log.found.set()
            await asyncio.wait_for(waiting, 30)

    asyncio.run(scene())
