"""A remembered status is never an old one, whatever changed the job."""

from __future__ import annotations

import asyncio
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.api.context import Service
from service.api.job_view_cache import EncodedJob, JobViewCache
from service.settings import Settings
from service.store.job import IllegalTransitionError, Job, Outcome, UnknownJobError
from tests.budget import examples
from tests.service.http import idle_service

if TYPE_CHECKING:
    from collections.abc import Callable

    from service.store.jobs import Store

_GRID = {"scenario": "line", "grid": {"dt_s": [0.01, 0.02]}}


def submit(store: Store) -> Job:
    spec: dict[str, Any] = {"scenario": {}}
    return store.submit(name="a", spec=spec, spec_hash="0", steps=10, priority=0, timeout_s=60.0)


def now(views: JobViewCache, job_id: str) -> EncodedJob | None:
    try:
        return asyncio.run(views.of(job_id))
    except UnknownJobError:
        return None


def stored(store: Store, job_id: str) -> EncodedJob | None:
    try:
        return EncodedJob.of(store.get(job_id))
    except UnknownJobError:
        return None


def change(service: Service, what: str, job: Job) -> None:
    """One change of the job, or none where it is not in a state for it."""
    store, mine = service.store, service.store.get(job.id)
    changes: dict[str, Callable[[], Any]] = {
        "claim": store.claim,
        "beat": lambda: store.beat(mine, {"step": mine.version, "steps": 10}),
        "finish": lambda: store.finish(mine, Outcome(state="finished", result={"metrics": {}})),
        "exchange": lambda: store.publish(store.exchange(mine, Outcome(state="failed", error_kind="a"))[0].id),
        "crash": lambda: store.requeue(mine, reason="b", crashed=True),
        "recover": store.recover,
        "retry": lambda: store.retry(job.id),
        "edit": lambda: store.edit(job.id, {"note": "new"}),
        "pin": lambda: store.pin(job.id, pinned=True),
        "unpin": lambda: store.pin(job.id, pinned=False),
        "cancel": lambda: store.cancel(job.id),
        "delete": lambda: store.delete(job.id),
    }
    with suppress(IllegalTransitionError):
        changes[what]()


_CHANGES = (
    "claim",
    "beat",
    "finish",
    "exchange",
    "crash",
    "recover",
    "retry",
    "edit",
    "pin",
    "unpin",
    "cancel",
    "delete",
)


@pytest.mark.slow
@settings(max_examples=examples(25))
@given(st.lists(st.sampled_from(_CHANGES), max_size=12))
def test_every_change_is_seen(changes: list[str]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        service = Service.open(Settings(data=Path(folder)))
        job = submit(service.store)
        for what in changes:
            assert now(service.job_views, job.id) == stored(service.store, job.id)
            if stored(service.store, job.id) is not None:
                change(service, what, job)
        assert now(service.job_views, job.id) == stored(service.store, job.id)
        service.store.close()


@pytest.mark.slow
@pytest.mark.parametrize("verb", ["cancel", "delete"])
def test_what_is_done_to_a_campaign_is_done_to_its_jobs(tmp_path: Path, verb: str) -> None:
    with idle_service(tmp_path) as (http, service):
        campaign = http.post("/api/v1/campaigns", json=_GRID).json()
        (first, second) = (job.id for job in service.store.page().items)
        assert [now(service.job_views, job_id) for job_id in (first, second)].count(None) == 0
        assert http.post(campaign["links"]["cancel"]).status_code == 202
        service.campaigns.settle()
        if verb == "delete":
            assert http.delete(campaign["links"]["self"]).status_code == 204
        for job_id in (first, second):
            assert now(service.job_views, job_id) == stored(service.store, job_id)
            assert http.get(f"/api/v1/jobs/{job_id}").status_code == (404 if verb == "delete" else 200)


def test_an_unchanged_job_is_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with idle_service(tmp_path) as (_, service):
        job, get = submit(service.store), service.store.get
        reads: list[str] = []

        def counted(job_id: str) -> Job:
            reads.append(job_id)
            return get(job_id)

        monkeypatch.setattr(service.store, "get", counted)
        for _ in range(3):
            now(service.job_views, job.id)
        assert reads == [job.id]
        service.store.cancel(job.id)
        now(service.job_views, job.id)
        assert reads == [job.id] * 2


def test_what_changes_while_it_is_read_is_not_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with idle_service(tmp_path) as (_, service):
        job = submit(service.store)
        get = service.store.get

        def then_cancelled(job_id: str) -> Job:
            found = get(job_id)
            service.store.cancel(job_id)
            return found

        with monkeypatch.context() as patch:
            patch.setattr(service.store, "get", then_cancelled)
            before = now(service.job_views, job.id)
        after = now(service.job_views, job.id)
        assert before is not None
        assert after is not None
        assert (before.terminal, after.terminal) == (False, True)


def test_no_more_are_kept_than_there_is_room_for(tmp_path: Path) -> None:
    with idle_service(tmp_path) as (_, service):
        few = JobViewCache(service.store, most=2)
        first, second, third = (submit(service.store).id for _ in range(3))
        for job_id in (first, second, first, third):  # the second was asked for longest ago
            now(few, job_id)
        assert set(few._known) == {first, third}


def test_a_long_one_is_not_kept(tmp_path: Path) -> None:
    """Five hundred jobs with a megabyte of poses each would be half a gigabyte."""
    with idle_service(tmp_path) as (_, service):
        spec = {"scenario": {"controller": {"poses": [[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]] * 5000}}}
        job = service.store.submit(name="a", spec=spec, spec_hash="x", steps=5000, priority=0, timeout_s=60)
        shown = now(service.job_views, job.id)
        assert shown is not None
        assert len(shown.body) > 100_000
        assert service.job_views._known == {}
