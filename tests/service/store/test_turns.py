"""Within a priority keys take turns, and the campaigns and single jobs of a key do."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from service.settings import Limits
from service.store.campaign import CampaignPlan, PlannedJob
from service.store.campaigns import CampaignStore
from service.store.database import open_database
from service.store.job import Job, QueueFullError
from service.store.jobs import Store
from service.store.turns import Turns, ahead_of
from tests.service.databases import lay_down

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    made = Store(open_database(lay_down(tmp_path / "a.sqlite")), limits=Limits(queue=3000, queue_per_key=2500))
    yield made
    made.close()


def submit(store: Store, name: str, owner: str | None, priority: int = 0) -> Job:
    values: dict[str, Any] = {"spec": {}, "spec_hash": "", "steps": 1, "timeout_s": 60.0}
    return store.submit(name=name, priority=priority, owner=owner, **values)


def campaign(store: Store, name: str, owner: str | None, cases: int, priority: int = 0) -> None:
    jobs = tuple(
        PlannedJob(case_id=f"{i}", labels={}, name=f"{name}{i}", spec={}, spec_hash="", steps=1) for i in range(cases)
    )
    plan = CampaignPlan(
        name=name, request={}, suite="s", suite_sha256="", priority=priority, timeout_s=60.0, cost_s=1.0, jobs=jobs
    )
    CampaignStore(store).create(plan, owner=owner)


def order(store: Store, count: int) -> list[str]:
    claimed = [store.claim() for _ in range(count)]
    return [job.name for job in claimed if job is not None]


@pytest.mark.slow
def test_a_large_campaign_holds_nobody_up(store: Store) -> None:
    campaign(store, "a", "ada", 2000)
    assert order(store, 3) == ["a0", "a1", "a2"]
    for number in range(3):
        submit(store, f"b{number}", "ben")
    assert order(store, 7) == ["b0", "a3", "b1", "a4", "b2", "a5", "a6"]


def test_keys_take_turns_and_within_a_key_its_campaigns_do(store: Store) -> None:
    for name in "pqr":
        campaign(store, name, "ada", 4)
    campaign(store, "b", "ben", 4)
    submit(store, "single", "ada")
    assert order(store, 8) == ["p0", "b0", "q0", "b1", "r0", "b2", "single", "b3"]
    assert order(store, 4) == ["p1", "q1", "r1", "p2"]


def test_without_keys_campaigns_and_single_jobs_take_turns(store: Store) -> None:
    campaign(store, "a", None, 100)
    campaign(store, "b", None, 100)
    submit(store, "one", None)
    assert order(store, 5) == ["a0", "b0", "one", "a1", "b1"]


def test_a_higher_priority_goes_first_whoever_has_waited(store: Store) -> None:
    campaign(store, "a", "ada", 3, priority=-10)
    submit(store, "b", "ben", priority=-10)
    submit(store, "urgent", "ada")
    assert order(store, 5) == ["urgent", "b", "a0", "a1", "a2"]  # ada had her turn
    assert store.claim() is None


def test_how_many_start_before_a_job_is_never_said_too_low(store: Store) -> None:
    campaign(store, "a", "ada", 5)
    campaign(store, "c", "ada", 1)
    jobs = [submit(store, f"b{number}", "ben") for number in range(3)]
    told = [store.before(job) for job in jobs]
    begun = order(store, 9)
    assert all(begun.index(job.name) <= ahead for job, ahead in zip(jobs, told, strict=True))
    assert told == [1, 3, 5]
    assert ahead_of("/", 2, {"/": 3}) == 2


def test_campaigns_count_in_the_limits_of_the_queue(store: Store) -> None:
    with pytest.raises(QueueFullError, match="0 jobs of this key are queued, and 2501 more are wanted, at most 2500"):
        campaign(store, "a", "ada", 2501)
    campaign(store, "a", "ada", 2500)
    with pytest.raises(QueueFullError, match="2500 jobs of this key are queued, at most 2500"):
        submit(store, "one more", "ada")
    with pytest.raises(QueueFullError, match="2500 jobs are queued, and 501 more are wanted, at most 3000"):
        campaign(store, "b", "ben", 501)
    assert store.counts()["queued"] == 2500


def test_only_so_many_are_remembered() -> None:
    turns = Turns()
    for number in range(30_000):
        turns.serve(f"key{number}/")
    assert turns.choose({"key29999/": 1, "new/": 2}) == "new/"
    assert len(turns._served) <= 10_000
