"""What a slot decides while an attempt runs, without threads, clocks and processes."""

from __future__ import annotations

import logging
from types import SimpleNamespace
from typing import Any

import pytest
from sqlalchemy.exc import OperationalError

from service.engine.attempt_end import last_report
from service.engine.attempt_trace import AttemptTrace
from service.engine.attempt_watch import AttemptWatch, Ending, publish_progress
from service.worker.progress import INTERVAL_S

JOB: Any = SimpleNamespace(id="a", attempt=1)


def watch(**changes: float) -> AttemptWatch:
    return AttemptWatch(**{"begun_s": 100.0, "timeout_s": 60.0, "memory_mb": 1000.0, **changes})


def test_an_attempt_may_go_on_up_to_its_deadline_and_no_longer() -> None:
    assert watch().ending(160.0, cancelled=False, held_mb=None) is None
    ending = watch().ending(160.001, cancelled=False, held_mb=None)
    assert ending == Ending("timed_out", "timed_out", "it did not end within timeout_s = 60")


def test_a_deadline_says_how_far_an_insertion_was_and_what_steered_it() -> None:
    insertion: Any = SimpleNamespace(spec={"scenario": {"controller": {"kind": "plugin", "name": "pi"}}})
    where = last_report(insertion, {"step": 3, "steps": 50})
    ending = watch().ending(161.0, cancelled=False, held_mb=None, where=where)
    assert ending is not None
    told = "it did not end within timeout_s = 60; its last report was step 3 of 50, controller 'pi'"
    assert ending.error == told
    assert last_report(insertion, None) == ""
    assert last_report(insertion, {"step": "x" * 10_000, "steps": 50}) == ""
    assert "controller 'ifem'" in last_report(SimpleNamespace(spec={"scenario": {}}), {"step": 0, "steps": 1})  # type: ignore[arg-type]
    training: Any = SimpleNamespace(spec={"training": {}})
    assert last_report(training, {"step": 3, "steps": 50}) == ""


def test_a_worker_may_hold_its_memory_and_no_more() -> None:
    assert watch().ending(101.0, cancelled=False, held_mb=1000.0) is None
    ending = watch(memory_mb=1000).ending(101.0, cancelled=False, held_mb=1000.6)
    assert ending == Ending("failed", "out_of_memory", "it held 1001 MB, at most 1000 are allowed")


def test_a_cancel_comes_before_every_other_end() -> None:
    assert watch().ending(101.0, cancelled=True, held_mb=None) == Ending("cancelled")
    assert watch().ending(1000.0, cancelled=True, held_mb=1e6) == Ending("cancelled")


def test_a_deadline_comes_before_an_excess_of_memory() -> None:
    ending = watch().ending(1000.0, cancelled=False, held_mb=1e6)
    assert ending is not None
    assert ending.state == "timed_out"


def test_progress_is_published_when_it_changed_and_at_most_twice_a_second() -> None:
    watched = watch()
    assert watched.due(100.0 + INTERVAL_S - 0.01, {"step": 1}) is None
    assert watched.due(100.0 + INTERVAL_S, {"step": 1}) == {"step": 1}
    assert watched.due(100.0 + INTERVAL_S + 0.1, {"step": 2}) is None
    assert watched.due(100.0 + 2 * INTERVAL_S, {"step": 2}) == {"step": 2}


def test_progress_that_stalls_or_was_not_written_yet_is_not_published() -> None:
    watched = watch()
    assert watched.due(200.0, None) is None
    assert watched.due(201.0, {"step": 1}) == {"step": 1}
    assert watched.due(300.0, {"step": 1}) is None
    assert watched.due(301.0, {"step": 2}) == {"step": 2}


def test_the_heartbeat_is_stored_every_ten_seconds_without_news() -> None:
    watched = watch()
    assert not watched.beats(109.9)
    assert watched.beats(110.0)
    assert not watched.beats(119.9)
    assert watched.due(119.95, {"step": 1}) == {"step": 1}
    assert not watched.beats(129.9)
    assert watched.beats(130.0)


class FakeStore:
    """Remembers what it was told; refuses as a full disk does."""

    def __init__(self, *, full: bool = False, cancelled: bool = False) -> None:
        self.full, self.cancelled, self.heard = full, cancelled, list[dict[str, Any] | None]()

    def beat(self, _job: Any, progress: dict[str, Any] | None = None) -> None:
        if self.full:
            raise OperationalError("UPDATE", {}, Exception("database or disk is full"))
        self.heard.append(progress)

    def cancel_requested(self, _job_id: str) -> bool:
        return self.cancelled


@pytest.mark.parametrize("cancelled", [True, False])
def test_progress_is_stored_and_a_cancel_request_noticed(*, cancelled: bool) -> None:
    store, trace = FakeStore(cancelled=cancelled), AttemptTrace()
    due = {"depth_mm": 1.0, "tip_error_mm": 0.5}
    assert publish_progress(store, trace, JOB, due) is cancelled
    assert store.heard == [due]
    assert [point.depth_mm for point in trace.points_of(JOB)] == [1.0]
    assert publish_progress(store, trace, JOB, None) is cancelled
    assert publish_progress(store, trace, JOB, None, asks=False) is False
    assert len(store.heard) == 1
    publish_progress(store, trace, JOB, None, beats=True)
    assert store.heard == [due, None]


def test_a_full_disk_ends_no_attempt(caplog: pytest.LogCaptureFixture) -> None:
    store = FakeStore(full=True, cancelled=True)
    with caplog.at_level(logging.WARNING):
        assert publish_progress(store, AttemptTrace(), JOB, {"step": 1}) is False
    assert "disk is full" in caplog.text
    assert publish_progress(store, AttemptTrace(), JOB, None) is True
