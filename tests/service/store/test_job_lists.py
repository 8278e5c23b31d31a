"""Lists of jobs in any order: every job once, whatever arrives between two pages."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from service.store.database import open_database
from service.store.job import Outcome
from service.store.job_lists import SORTS, CursorError, JobFilter, JobOrder
from service.store.jobs import Store
from tests.service.databases import lay_down

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

VALUES = (0.5, None, 0.1, 0.5, 2.0, None, 0.25)  # of the RMSE, two of them without any


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    path = tmp_path / "needlebench.sqlite"
    lay_down(path)
    clock = iter(range(10**6))
    made = Store(open_database(path), now=lambda: float(next(clock)))
    for number, rmse in enumerate(VALUES):
        add(made, f"job {'bacbdba'[number]}", rmse)
    yield made
    made.close()


def add(store: Store, name: str, rmse: float | None) -> str:
    job = store.submit(
        name=name, spec={}, spec_hash="0", steps=1, priority=len(name) % 3, timeout_s=1.0, request_hash="0"
    )
    if (claimed := store.claim()) is not None and rmse is not None:
        metrics = {"success": rmse < 1, "rmse_commanded_mm": rmse, "max_strain": rmse / 10}
        store.finish(claimed, Outcome(state="finished", result={"metrics": metrics}))
    return job.id


def walk(store: Store, order: JobOrder, between: Any = lambda: None, size: int = 2) -> list[Any]:
    """Every job, by pages of two."""
    found: list[Any] = []
    cursor: str | None = None
    while True:
        page = store.page(JobFilter(), order, size=size, cursor=cursor)
        found += page.items
        between()
        if (cursor := page.next_cursor) is None:
            return found


@pytest.mark.parametrize("down", [False, True])
@pytest.mark.parametrize("sort", SORTS)
def test_pages_of_every_order_hold_every_job_once_and_in_order(store: Store, sort: Any, down: bool) -> None:
    order = JobOrder(sort=sort, down=down)
    found = walk(store, order)
    whole = store.page(JobFilter(), order, size=100).items
    assert [job.id for job in found] == [job.id for job in whole]
    assert len({job.id for job in found}) == len(VALUES)


@pytest.mark.parametrize(
    ("down", "expected"), [(False, [0.1, 0.25, 0.5, 0.5, 2.0]), (True, [2.0, 0.5, 0.5, 0.25, 0.1])]
)
def test_jobs_without_a_value_come_last_and_of_equal_ones_the_newest_is_first(
    store: Store, down: bool, expected: list[float]
) -> None:
    found = walk(store, JobOrder(sort="rmse", down=down))
    assert [(job.metrics or {}).get("rmse_commanded_mm") for job in found] == [*expected, None, None]
    halves = [job.seq for job in found if (job.metrics or {}).get("rmse_commanded_mm") == 0.5]
    assert halves == sorted(halves, reverse=True)


def test_names_are_sorted_whatever_their_case(store: Store) -> None:
    add(store, "JOB AA", 1.0)
    assert [job.name for job in walk(store, JobOrder(sort="name", down=False))][:4] == [
        "job a", "job a", "JOB AA", "job b",
    ]  # fmt: skip


def test_what_arrives_between_two_pages_makes_no_job_come_twice(store: Store) -> None:
    known = {job.id for job in store.page().items}
    late = iter([0.05, 0.3, 3.0])
    found = [job.id for job in walk(store, JobOrder(sort="rmse"), lambda: add(store, "late", next(late, 0.0)))]
    assert len(found) == len(set(found))
    assert known <= set(found)


def test_a_cursor_of_another_order_or_none_is_refused(store: Store) -> None:
    cursor = store.page(JobFilter(), JobOrder(sort="rmse"), size=2).next_cursor
    assert cursor is not None
    for order in (JobOrder(sort="name"), JobOrder(sort="rmse", down=False), JobOrder()):
        with pytest.raises(CursorError, match="next_cursor"):
            store.page(JobFilter(), order, size=2, cursor=cursor)
    for wrong in ("x", "bm9uZQ", "W10", "MQ", cursor[:-4], "WyJybXNlIix0cnVlLGZhbHNlLFtdLDEsMV0"):
        with pytest.raises(CursorError):
            store.page(JobFilter(), JobOrder(sort="rmse"), size=2, cursor=wrong)


def test_what_is_said_of_a_job_while_it_runs_is_kept_at_its_end(store: Store) -> None:
    store.submit(name="runs", spec={}, spec_hash="0", steps=1, priority=9, timeout_s=1.0)
    running = store.claim()
    assert running is not None
    assert running.name == "runs"
    store.edit(running.id, {"name": "renamed", "tags": ["a b", "ü"], "note": "one\ntwo"})
    done = store.finish(running, Outcome(state="finished", result={"metrics": {}}))
    for job in (done, store.get(running.id)):
        assert (job.name, list(job.tags), job.note) == ("renamed", ["a b", "ü"], "one\ntwo")
    assert [event.kind for event in store.events(running.id)][-2:] == ["edited", "finished"]


def test_jobs_are_found_by_their_tags(store: Store) -> None:
    tagged = store.page().items[0]
    store.edit(tagged.id, {"tags": ["Liver", "größe 2"]})
    for text in ("liver", "LIV", "größe", "2"):
        assert [job.id for job in store.page(JobFilter(containing=text)).items if job.id == tagged.id], text
    assert store.page(JobFilter(containing='"')).items == []
    assert [job.id for job in store.page(JobFilter(tag="Liver")).items] == [tagged.id]
    assert store.page(JobFilter(tag="Liv")).items == []
