"""Crashes, stops and deaths of the server: who is to blame, what runs again, and only legal steps."""

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from service.store.job import (
    LEGAL,
    MAXIMUM_DEATHS,
    SUSPECT_DEATHS,
    TERMINAL,
    IllegalTransitionError,
    Job,
    Outcome,
)
from service.store.jobs import Store
from tests.budget import examples
from tests.service.store.steps import RESULT, claim, submit


def test_three_crashes_are_enough(store: Store) -> None:
    job = submit(store)
    states = [store.requeue(claim(store), reason="signal 9", crashed=True).state for _ in range(3)]
    assert states == ["queued", "queued", "failed"]
    failed = store.get(job.id)
    assert (failed.error_kind, failed.attempt, failed.crashes) == ("worker_died", 3, 3)
    assert "signal 9" in (failed.error or "")


def test_stopping_the_server_counts_as_no_crash(store: Store) -> None:
    submit(store)
    for _ in range(5):
        assert store.requeue(claim(store), reason="the server was stopped", crashed=False).crashes == 0
    assert claim(store).attempt == 6


def test_recovery_requeues_what_was_running_and_honours_a_cancel(store: Store) -> None:
    waiting, running, cancelled = submit(store, priority=-1), submit(store, priority=2), submit(store, priority=1)
    assert [claim(store).id, claim(store).id] == [running.id, cancelled.id]
    store.cancel(cancelled.id)
    assert {job.id: job.state for job in store.recover()} == {running.id: "queued", cancelled.id: "cancelled"}
    assert store.get(waiting.id).state == "queued"
    assert store.recover() == []


def test_the_owner_of_before_can_change_nothing(store: Store) -> None:
    submit(store)
    first = claim(store)
    store.requeue(first, reason="the server died", crashed=True)
    second = claim(store)
    store.beat(first, {"step": 9})
    assert store.get(first.id).progress is None
    with pytest.raises(IllegalTransitionError):
        store.finish(first, RESULT)
    assert store.finish(second, RESULT).state == "finished"


@pytest.mark.slow
def test_the_death_of_the_server_is_laid_to_a_job_that_ran_each_time_of_many(store: Store) -> None:
    job = submit(store)
    for attempt in range(1, MAXIMUM_DEATHS):
        assert claim(store).attempt == attempt
        (again,) = store.recover()
        assert (again.state, again.crashes) == ("queued", 0)
    claim(store)
    (given_up,) = store.recover()
    assert (given_up.state, given_up.error_kind) == ("failed", "worker_died")
    assert given_up.error == f"gave up after {MAXIMUM_DEATHS} attempts; the last one ended so: the server died"
    assert store.events(job.id)[2].kind == "crashed"
    store.retry(job.id)
    claim(store)
    (forgiven,) = store.recover()
    assert forgiven.state == "queued"


@pytest.mark.slow
def test_orderly_stops_and_crashes_of_a_worker_are_no_deaths_of_the_server(store: Store) -> None:
    job = submit(store)
    for _ in range(2 * MAXIMUM_DEATHS):
        store.requeue(claim(store), reason="the server was stopped", crashed=False)
    store.requeue(claim(store), reason="its worker process died", crashed=True)
    assert store.server_deaths(store.get(job.id)) == 0
    claim(store)
    (again,) = store.recover()
    assert (again.state, store.server_deaths(again)) == ("queued", 1)


def test_crashes_of_a_worker_count_across_deaths_of_the_server(store: Store) -> None:
    job = submit(store)
    for _ in range(2):
        store.requeue(claim(store), reason="its worker process died", crashed=True)
        claim(store)
        store.recover()
    assert store.requeue(claim(store), reason="its worker process died", crashed=True).state == "failed"
    assert store.get(job.id).attempt == 5


def test_a_job_under_which_the_server_died_three_times_lets_every_other_begin_first(store: Store) -> None:
    suspect, other = submit(store, priority=5), submit(store, "b")
    for _ in range(SUSPECT_DEATHS):
        assert claim(store).id == suspect.id
        store.recover()
    last = [event for event in store.events(suspect.id) if event.kind == "crashed"][-1]
    assert last.data == {"reason": "the server died", "priority": -100}
    assert [claim(store).id, claim(store).id] == [other.id, suspect.id]


ACTIONS = ("retry", "claim", "finish", "fail", "crash", "stop", "cancel", "recover", "beat")


@pytest.mark.slow
@settings(max_examples=examples(25), deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.sampled_from(ACTIONS), max_size=25))
def test_whatever_happens_only_legal_steps_are_taken(store: Store, actions: list[str]) -> None:
    job = submit(store)
    owner, state = None, "queued"
    for action in actions:
        owner = _act(store, job, owner, action)
        now = store.get(job.id)
        assert now.state == state or now.state in LEGAL[state]
        assert (now.finished_at is not None) == (now.state in TERMINAL)
        state = now.state
    if state not in TERMINAL:  # the next example begins with an empty queue
        store.cancel(job.id)
        store.recover()


def _act(store: Store, job: Job, owner: Job | None, action: str) -> Job | None:
    """One action by an owner that may have lost the job; refusals are fine, illegal steps are not."""
    try:
        if action == "claim":
            return store.claim() or owner
        if action == "cancel":
            store.cancel(job.id)
        elif action == "recover":
            store.recover()
        elif action == "retry":
            store.retry(job.id)
        elif owner is not None:
            _end(store, owner, action)
    except IllegalTransitionError:
        pass
    return owner


def _end(store: Store, owner: Job, action: str) -> None:
    if action == "beat":
        store.beat(owner, {"step": 1})
    elif action in ("crash", "stop"):
        store.requeue(owner, reason=action, crashed=action == "crash")
    else:
        outcome = RESULT if action == "finish" else Outcome(state="failed", error_kind="exception", error="x")
        store.finish(owner, outcome)
