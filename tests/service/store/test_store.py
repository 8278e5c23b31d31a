from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import pytest

from service.engine.metrics import Monitor
from service.engine.retention import Policy, clear
from service.store.campaign_rows import TALLY, WHOLLY_ENDED
from service.store.database import open_database
from service.store.job import (
    Artefact,
    IllegalTransitionError,
    KeyReusedError,
    Outcome,
    UnknownJobError,
)
from service.store.job_lists import JobFilter
from service.store.job_queries import HIGHEST, LANES
from service.store.jobs import Store
from tests.service.databases import lay_down
from tests.service.store.steps import RESULT, claim, kinds, submit

if TYPE_CHECKING:
    from pathlib import Path


def test_the_life_of_a_job(store: Store, heard: list[str]) -> None:
    job = submit(store)
    running = claim(store)
    store.beat(running, {"step": 5, "steps": 10, "fraction": 0.5})
    file = Artefact(kind="result", name="result.json", path="jobs/a/1/result.json", sha256="ab", bytes=3)
    done = store.finish(running, Outcome(state="finished", result=RESULT.result, artefacts=(file,)))
    assert (done.state, done.attempt, done.metrics) == ("finished", 1, {"rmse_commanded_mm": 0.5})
    assert store.artefacts(job.id) == [file]
    assert kinds(store, job) == ["queued", "started", "finished"]
    assert heard == [job.id] * 4
    assert 1 == job.version < running.version < done.version
    assert job.created_at < (running.started_at or 0) < (done.finished_at or 0)


def test_the_last_progress_stays_with_a_job_that_ended(store: Store) -> None:
    for told, kept in (({"step": 9}, {"step": 9}), (None, {"step": 4})):
        submit(store)
        running = claim(store)
        store.beat(running, {"step": 4})
        done = store.finish(running, Outcome(state="finished", result=RESULT.result, progress=told))
        assert done.progress == store.get(done.id).progress == kept


def test_claims_go_by_priority_then_by_arrival(store: Store) -> None:
    for name, priority in (("a", 0), ("b", 5), ("c", 0), ("d", 5)):
        submit(store, name, priority=priority)
    assert [claim(store).name for _ in range(4)] == ["b", "d", "a", "c"]
    assert store.claim() is None


@pytest.mark.slow
def test_many_claimants_never_get_the_same_job(store: Store) -> None:
    for _ in range(40):
        submit(store)
    with ThreadPoolExecutor(8) as pool:
        claimed = list(pool.map(lambda _: store.claim(), range(60)))
    ids = [job.id for job in claimed if job is not None]
    assert len(ids) == len(set(ids)) == 40


def test_a_cancelled_queue_entry_is_never_claimed(store: Store) -> None:
    job = submit(store)
    assert store.cancel(job.id).state == "cancelled"
    assert store.cancel(job.id).state == "cancelled"
    assert store.claim() is None
    assert kinds(store, job) == ["queued", "cancelled"]


def test_cancelling_a_running_job_asks_its_owner(store: Store) -> None:
    submit(store)
    running = claim(store)
    for _ in range(2):
        assert store.cancel(running.id).cancel_requested
    assert store.finish(running, Outcome(state="cancelled")).state == "cancelled"
    assert kinds(store, running) == ["queued", "started", "cancel_requested", "cancelled"]


def test_a_job_that_ended_cannot_be_cancelled(store: Store) -> None:
    submit(store)
    done = store.finish(claim(store), RESULT)
    with pytest.raises(IllegalTransitionError, match="is finished"):
        store.cancel(done.id)


def test_an_idempotency_key_gives_the_same_job_again(store: Store) -> None:
    job = submit(store, key="k", request_hash="1")
    assert submit(store, key="k", request_hash="1").id == job.id
    with pytest.raises(KeyReusedError, match=job.id):
        submit(store, key="k", request_hash="2")
    assert len(store.page().items) == 1


def test_only_ended_jobs_can_be_deleted(store: Store) -> None:
    job = submit(store, key="k", request_hash="1")
    with pytest.raises(IllegalTransitionError, match="is queued"):
        store.delete(job.id)
    store.cancel(job.id)
    store.delete(job.id)
    with pytest.raises(UnknownJobError):
        store.get(job.id)
    assert kinds(store, job) == ["queued", "cancelled", "deleted"]


def test_pages_are_newest_first_and_without_the_large_fields(store: Store) -> None:
    jobs = [submit(store, str(i)) for i in range(5)]
    page = store.page(size=2)
    assert [job.name for job in page.items] == ["4", "3"]
    assert [job.name for job in store.page(size=9, cursor=page.next_cursor).items] == ["2", "1", "0"]
    assert (page.items[0].spec, page.items[0].result) == (None, None)
    store.cancel(jobs[1].id)
    assert [job.name for job in store.page(JobFilter(state="cancelled")).items] == ["1"]


def test_a_result_with_nan_is_refused_and_the_job_stays(store: Store) -> None:
    submit(store)
    running = claim(store)
    with pytest.raises(Exception, match="JSON compliant"):
        store.finish(running, Outcome(state="finished", result={"metrics": {"rmse_commanded_mm": float("nan")}}))
    assert store.get(running.id).state == "running"


def test_a_retry_begins_anew_and_keeps_the_log(store: Store) -> None:
    job = submit(store)
    running = claim(store)
    file = Artefact(kind="recording", name="recording.rrd", path="jobs/a/1/recording.rrd", sha256="ab", bytes=3)
    store.finish(running, Outcome(state="failed", error_kind="exception", error="x", artefacts=(file,)))
    again = store.retry(job.id)
    assert (again.state, again.error, again.finished_at, again.attempt) == ("queued", None, None, 1)
    assert store.artefacts(job.id) == []
    assert claim(store).attempt == 2
    assert kinds(store, job) == ["queued", "started", "failed", "queued", "started"]
    with pytest.raises(IllegalTransitionError, match="is running"):
        store.retry(job.id)


def test_a_pinned_job_is_not_deleted(store: Store) -> None:
    job = submit(store)
    store.cancel(job.id)
    assert store.pin(job.id, pinned=True).pinned
    with pytest.raises(IllegalTransitionError, match="is pinned"):
        store.delete(job.id)
    store.pin(job.id, pinned=False)
    store.delete(job.id)


def test_a_clock_that_is_set_back_orders_nothing(tmp_path: Path) -> None:
    """Jobs are ordered by arrival, events by number; a job that ended in the future is not old."""
    times = [5000.0, 4000.0, 3000.0, 2000.0, 1000.0, 900.0, 800.0, 700.0, 600.0, 500.0, 400.0, 300.0, 200.0, 100.0]
    store = Store(
        open_database(lay_down(tmp_path / "jobs.sqlite")), now=lambda: times.pop(0) if len(times) > 1 else times[0]
    )
    first, second = submit(store, "a"), submit(store, "b")
    assert [job.name for job in store.page().items] == ["b", "a"]
    running = claim(store)
    assert running.name == "a"
    store.finish(running, RESULT)
    assert claim(store).id == second.id
    assert kinds(store, first) == ["queued", "started", "finished"]
    done = store.get(first.id)
    assert (done.finished_at or 0) < (done.started_at or 0) < done.created_at
    folder = tmp_path / "jobs"
    assert clear(store, folder, Policy(older_than_s=60.0), dry_run=False).jobs == ()
    monitor = Monitor()
    monitor.started(running)
    assert b"needlebench_job_wait_seconds_sum 0.0" in monitor.text()
    store.close()


def test_an_exchange_ends_one_job_and_takes_the_next_and_tells_nobody_before_it_is_published(
    store: Store, heard: list[str]
) -> None:
    first, second = submit(store), submit(store, "b")
    running = claim(store)
    heard.clear()
    done, taken = store.exchange(running, RESULT)
    assert taken is not None
    assert not heard
    assert (done.state, done.result, done.metrics) == ("finished", RESULT.result, {"rmse_commanded_mm": 0.5})
    assert (taken.id, taken.state, taken.attempt) == (second.id, "running", 1)
    assert (store.get(first.id), store.get(second.id)) == (done, taken)
    assert [(event.job_id, event.kind) for event in store.events()][-2:] == [
        (first.id, "finished"),
        (second.id, "started"),
    ]
    store.publish(done.id, taken.id)
    assert heard == [done.id, taken.id]
    assert store.exchange(taken, Outcome(state="failed", error_kind="exception", error="x"))[1] is None


def test_an_exchange_by_an_owner_of_before_takes_nothing(store: Store) -> None:
    job, other = submit(store, priority=1), submit(store, "b")
    old = claim(store)
    store.requeue(old, reason="x", crashed=True)
    claim(store)
    with pytest.raises(IllegalTransitionError):
        store.exchange(old, RESULT)
    assert (store.get(job.id).state, store.get(other.id).state) == ("running", "queued")


def test_what_a_client_is_promised_waits_for_the_disk(store: Store) -> None:
    for lazy, level in ((True, 1), (False, 2), (True, 1)):  # NORMAL, FULL
        with store._write(lazy=lazy) as connection:
            assert connection.exec_driver_sql("PRAGMA synchronous").scalar() == level


def test_the_next_job_is_found_without_looking_at_the_others(store: Store) -> None:
    """However many are queued: only an index is read, of one priority, and nothing is sorted."""
    for query in (HIGHEST, LANES.params(of_priority=0)):
        text = str(query.compile(dialect=store.engine.dialect, compile_kwargs={"literal_binds": True}))
        with store.reading() as connection:
            steps = [row.detail for row in connection.exec_driver_sql(f"EXPLAIN QUERY PLAN {text}")]
        assert len(steps) == 1
        assert "USING COVERING INDEX ix_job_queued" in steps[0], steps


def test_how_far_a_campaign_is_is_read_from_an_index_alone(store: Store) -> None:
    """However many of its jobs there are, and however large their results: both questions are asked every second."""
    plans = []
    for query in (TALLY.params(of_lane="/a"), WHOLLY_ENDED):
        text = str(query.compile(dialect=store.engine.dialect, compile_kwargs={"literal_binds": True}))
        with store.reading() as connection:
            plans.append([row.detail for row in connection.exec_driver_sql(f"EXPLAIN QUERY PLAN {text}")])
    tally, ended = plans
    assert tally == ["SEARCH job USING COVERING INDEX ix_job_lane_state (lane=?)"]
    assert any("SEARCH job USING COVERING INDEX ix_job_lane_state (lane=? AND state=?)" in step for step in ended), (
        ended
    )


# ---- outcomes


@pytest.mark.parametrize(
    ("kind", "result", "outcome"),
    [
        ("insertion", {"status": "completed", "metrics": {"success": True}}, "success"),
        ("insertion", {"status": "completed", "metrics": {"success": False}}, "missed"),
        ("insertion", {"status": "target_lost", "metrics": {"success": False}}, "target_lost"),
        ("insertion", {"status": "of another version", "metrics": {}}, "missed"),
        ("training", {"metrics": {"model": "a.json"}}, "success"),
    ],
)
def test_a_job_that_finished_has_an_outcome(store: Store, kind: str, result: dict[str, Any], outcome: str) -> None:
    job = submit(store, kind=kind)
    assert (job.outcome, claim(store).outcome) == (None, None)
    done = store.finish(store.get(job.id), Outcome(state="finished", result=result))
    assert (done.outcome, store.get(job.id).outcome) == (outcome, outcome)
    assert store.events(job.id)[-1].data == {"outcome": outcome}
    assert [one.id for one in store.page(JobFilter(outcome=outcome)).items] == [job.id]
    assert store.page(JobFilter(outcome="inverted")).items == []
    assert store.outcomes() == {outcome: 1}


def test_a_job_that_left_no_result_has_no_outcome(store: Store) -> None:
    submit(store)
    done = store.finish(claim(store), Outcome(state="failed", error_kind="exception", error="x"))
    assert (done.outcome, store.outcomes()) == (None, {})


def test_outcomes_are_counted_in_a_fixed_order(store: Store) -> None:
    for status in ("buckled", "completed", "buckled"):
        submit(store)
        store.finish(claim(store), Outcome(state="finished", result={"status": status, "metrics": {}}))
    assert list(store.outcomes().items()) == [("missed", 1), ("buckled", 2)]
