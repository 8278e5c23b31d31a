"""Slots and their watchdog, with real worker processes: no fault ends a thread for good or leaves a job behind."""

from __future__ import annotations

import logging
import re
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import pytest

from service.engine import slot as slots
from service.engine import watchdog
from service.engine.slot import Slot
from tests.acceptance.server import FAKE, until
from tests.service.http import idle_service

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from starlette.testclient import TestClient

    from service.api.context import Service
    from service.store.job import Job


@contextmanager
def running_engine(data: Path) -> Iterator[tuple[TestClient, Service]]:
    """A service with one slot; nothing is asked of it over HTTP unless a test does."""
    with idle_service(data, runner=FAKE, workers=1) as (http, service):
        service.engine.start()
        try:
            yield http, service
        finally:
            service.engine.stop()


@pytest.fixture
def quick_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watchdog, "LOOK_S", 0.02)


def submit(service: Service) -> Job:
    spec = {"scenario": {"name": "quick"}}
    job = service.store.submit(name="a", spec=spec, spec_hash="x", steps=2, priority=0, timeout_s=600)
    service.engine.wake()
    return job


def ended(service: Service, job: Job) -> Job:
    until(lambda: service.store.get(job.id).terminal)
    return service.store.get(job.id)


def once(first: Callable[..., Any], then: Callable[..., Any]) -> Callable[..., Any]:
    """A function that is `first` at its first call and `then` ever after."""
    called: list[None] = []

    def function(*given: Any, **named: Any) -> Any:
        called.append(None)
        return (first if len(called) == 1 else then)(*given, **named)

    return function


def raises(error: BaseException) -> Callable[..., Any]:
    def function(*_: Any, **__: Any) -> Any:
        raise error

    return function


@pytest.mark.slow
@pytest.mark.parametrize("error", [SystemExit(3), KeyboardInterrupt(), GeneratorExit(), ValueError("\ud800")])
def test_whatever_reaches_its_thread_is_logged_and_the_slot_goes_on(
    tmp_path: Path, error: BaseException, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    with running_engine(tmp_path) as (_, service):
        claim = service.store.claim
        monkeypatch.setattr(service.store, "claim", once(raises(error), claim))
        with caplog.at_level(logging.ERROR):
            assert ended(service, submit(service)).state == "finished"
        # two seconds and more after a worker that did not start, as on a machine with much else to do
        assert re.search(rf"slot-0 pauses for \d+ s: {type(error).__name__}", caplog.text)
        assert (service.engine.alive, service.engine.ended_threads) == (1, [])


@pytest.mark.slow
def test_a_job_whose_end_the_store_cannot_take_has_failed_and_the_slot_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with running_engine(tmp_path) as (_, service):
        refusal = UnicodeEncodeError("utf-8", "\ud800", 0, 1, "surrogates not allowed")
        monkeypatch.setattr(service.store, "exchange", once(raises(refusal), service.store.exchange))
        failed = ended(service, submit(service))
        assert (failed.state, failed.error_kind, failed.attempt) == ("failed", "exception", 1)
        assert (failed.error or "").startswith("its end cannot be stored: UnicodeEncodeError: ")
        assert ended(service, submit(service)).state == "finished"


def takes_a_job_and_ends(slot: Any) -> None:
    until(lambda: slot._ends or slot._store.claim() is not None)


@pytest.mark.slow
@pytest.mark.usefixtures("quick_looks")
def test_a_slot_whose_thread_is_gone_is_replaced_and_its_job_runs_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(Slot, "run", once(takes_a_job_and_ends, Slot.run))
    with running_engine(tmp_path) as (_, service):
        done = ended(service, submit(service))
        assert (done.state, done.attempt, done.crashes) == ("finished", 2, 1)
        assert "slot-0 is replaced: its thread has ended" in caplog.text
        (crash,) = (event for event in service.store.events(done.id) if event.kind == "crashed")
        assert crash.data == {"reason": "the slot that ran it was lost"}
        assert service.engine.alive == 1


@pytest.mark.slow
@pytest.mark.usefixtures("quick_looks")
def test_a_job_that_costs_every_slot_its_thread_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Slot, "run", takes_a_job_and_ends)
    with running_engine(tmp_path) as (_, service):
        failed = ended(service, submit(service))
        assert (failed.state, failed.attempt, failed.error_kind) == ("failed", 3, "worker_died")
        assert failed.error == "gave up after 3 attempts; the last one ended so: the slot that ran it was lost"


@pytest.mark.slow
@pytest.mark.usefixtures("quick_looks")
def test_a_slot_that_does_not_get_on_is_told_and_replaced_and_its_job_runs_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    goes_on = threading.Event()

    def takes_a_job_and_hangs(slot: Any) -> None:
        takes_a_job_and_ends(slot)
        goes_on.wait(60)

    monkeypatch.setattr(watchdog, "SILENT_LOOKS", 50)  # one second; an idle slot gets on every half
    monkeypatch.setattr(watchdog, "STALLED_LOOKS", 200)
    monkeypatch.setattr(watchdog, "ORPHANED_LOOKS", 250)
    monkeypatch.setattr(Slot, "run", once(takes_a_job_and_hangs, Slot.run))
    with running_engine(tmp_path) as (http, service):
        job = submit(service)
        until(lambda: service.engine.silent_slots == ["slot-0"], pause_s=0.001)
        told = http.get("/readyz")
        assert (told.status_code, "threads: slot-0 has not got on for a minute" in told.text) == (503, True)
        done = ended(service, job)
        assert (done.state, done.attempt) == ("finished", 2)
        assert service.engine.silent_slots == []
        goes_on.set()


@pytest.mark.slow
def test_readiness_and_metrics_see_a_thread_that_is_gone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watchdog, "LOOK_S", 60.0)
    with running_engine(tmp_path) as (http, service):
        monkeypatch.setattr(service.keeper, "run", lambda: None)
        service.keeper.start()
        until(lambda: service.keeper.ended)
        until(lambda: service.engine.ready == 1)
        assert 'needlebench_workers{state="alive"} 1.0' in http.get("/metrics").text
        (slot,) = service.engine._slots
        slot.abandon()
        until(lambda: slot.ended)
        told = http.get("/readyz")
        assert told.status_code == 503
        assert "threads: slot-0 has ended, keeper has ended" in told.json()["detail"]
        text = http.get("/metrics").text
        assert 'needlebench_workers{state="alive"} 0.0' in text
        assert 'needlebench_workers{state="warm"} 0.0' in text


def test_a_running_job_keeps_its_heartbeat_in_the_store(tmp_path: Path) -> None:
    with idle_service(tmp_path) as (http, service):
        assert "needlebench_heartbeat_age_seconds 0.0" in http.get("/metrics").text
        submit(service)
        job = service.store.claim()
        assert job is not None
        service.store._now = lambda: (job.heartbeat_at or 0.0) + 100.0
        assert "needlebench_heartbeat_age_seconds 100.0" in http.get("/metrics").text
        service.store.beat(job)
        assert "needlebench_heartbeat_age_seconds 0.0" in http.get("/metrics").text
        assert service.store.get(job.id).version == job.version


@pytest.mark.slow
def test_a_slot_asks_whether_its_job_is_cancelled_when_somebody_changed_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(slots, "_ASK_EVERY", 10**9)
    with running_engine(tmp_path) as (_, service):
        spec = {"scenario": {"name": "long"}}
        job = service.store.submit(name="a", spec=spec, spec_hash="x", steps=2, priority=0, timeout_s=600)
        until(lambda: service.store.get(job.id).progress is not None)
        asked: list[str] = []
        ask = service.store.cancel_requested

        def counted(job_id: str) -> bool:
            asked.append(job_id)
            return ask(job_id)

        monkeypatch.setattr(service.store, "cancel_requested", counted)
        before = service.store.get(job.id).version
        until(lambda: service.store.get(job.id).version > before + 2)
        assert asked == []  # its own progress is no news to it
        service.store.cancel(job.id)
        assert ended(service, job).state == "cancelled"
