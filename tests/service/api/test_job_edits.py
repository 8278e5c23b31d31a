"""Name, tags and note of a job; one action over many of them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from tests.service.http import finish, idle_service

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from starlette.testclient import TestClient

    from service.api.context import Service

API = "/api/v1/jobs"
pytestmark = pytest.mark.slow


@pytest.fixture
def both(tmp_path: Path) -> Iterator[tuple[TestClient, Service]]:
    with idle_service(tmp_path) as pair:
        yield pair


def submit(http: TestClient, name: str = "one") -> str:
    job: str = http.post(API, json={"scenario": {"name": name}}).json()["id"]
    return job


def test_a_job_is_renamed_tagged_and_noted_without_its_scenario(both: tuple[TestClient, Service]) -> None:
    http, _ = both
    job = submit(http)
    first = http.get(f"{API}/{job}")
    change = {"name": "other", "tags": ["a", "b", "a"], "note": "one\r\ntwo\n"}
    answer = http.patch(f"{API}/{job}", json=change, headers={"If-Match": first.headers["etag"]})
    now = http.get(f"{API}/{job}")
    assert answer.json() == now.json()
    assert answer.headers["etag"] == now.headers["etag"] != first.headers["etag"]
    assert {name: now.json()[name] for name in change} == {"name": "other", "tags": ["a", "b"], "note": "one\ntwo"}
    assert now.json()["scenario"]["name"] == "one"
    assert http.patch(f"{API}/{job}", json={"note": ""}).json()["tags"] == ["a", "b"]
    assert http.patch(f"{API}/{job}", json={}).headers["etag"] == http.get(f"{API}/{job}").headers["etag"]
    for query, found in (("q=other", 1), ("q=one", 0), ("tag=b", 1), ("tag=c", 0), ("q=B", 1)):
        assert len(http.get(f"{API}?{query}").json()["items"]) == found, query


def test_a_change_based_on_an_old_version_is_refused(both: tuple[TestClient, Service]) -> None:
    http, _ = both
    job = submit(http)
    old = http.get(f"{API}/{job}").headers["etag"]
    http.patch(f"{API}/{job}", json={"note": "first"}, headers={"If-Match": old})
    answer = http.patch(f"{API}/{job}", json={"note": "second"}, headers={"If-Match": old})
    assert (answer.status_code, answer.json()["code"]) == (412, "version-changed")
    assert http.get(f"{API}/{job}").json()["note"] == "first"
    assert http.patch(f"{API}/{job}", json={}, headers={"If-Match": "mine"}).status_code == 412
    assert http.patch(f"{API}/{'0' * 16}", json={}).status_code == 404


@pytest.mark.parametrize(
    ("body", "field"),
    [
        ({"name": ""}, "name"),
        ({"name": "a\nb"}, "name"),
        ({"tags": ["a,b"]}, "tags.0"),
        ({"tags": ["ok", " a"]}, "tags.1"),
        ({"tags": [""]}, "tags.0"),
        ({"tags": ["x" * 41]}, "tags.0"),
        ({"tags": [str(n) for n in range(21)]}, "tags"),
        ({"tags": "a"}, "tags"),
        ({"note": "x" * 4001}, "note"),
        ({"note": "a\u202eb"}, "note"),
        ({"state": "finished"}, "state"),
    ],
)
def test_what_cannot_be_said_is_refused_by_its_field(
    both: tuple[TestClient, Service], body: dict[str, Any], field: str
) -> None:
    http, _ = both
    job = submit(http)
    answer = http.patch(f"{API}/{job}", json=body)
    assert answer.status_code == 422
    assert [one["field"] for one in answer.json()["errors"]] == [field]
    assert http.get(f"{API}/{job}").json()["name"] == "one"


def test_an_action_over_many_jobs_says_for_each_what_came_of_it(both: tuple[TestClient, Service]) -> None:
    http, service = both
    done, queued, pinned = submit(http), "", ""
    finish(service)
    queued, pinned = submit(http, "two"), submit(http, "three")
    service.store.cancel(pinned)
    service.store.pin(pinned, pinned=True)
    unknown = "0" * 16

    def act(action: str, *jobs: str) -> dict[str, str | None]:
        answer = http.post(f"{API}/actions", json={"action": action, "jobs": [*jobs]})
        assert answer.status_code == 200
        items = answer.json()["items"]
        assert all(item["done"] == (item["detail"] is None) for item in items)
        return {item["job"]: item["code"] for item in items}

    everything = (done, queued, pinned, unknown)
    assert act("delete", *everything) == {
        done: None, queued: "job-state", pinned: "job-pinned", unknown: "job-unknown",
    }  # fmt: skip
    assert not (service.settings.jobs / done).exists()
    assert act("cancel", queued, pinned, queued) == {queued: None, pinned: None}
    assert act("retry", queued, pinned) == {queued: None, pinned: None}
    assert act("retry", queued) == {queued: "job-state"}
    assert act("unpin", pinned) == {pinned: None}
    assert act("pin", pinned, queued) == {pinned: None, queued: None}
    assert {job.pinned for job in service.store.page().items} == {True}
    for body in (
        {"action": "explode", "jobs": [queued]},
        {"action": "pin", "jobs": []},
        {"action": "pin", "jobs": ["../x"]},
    ):
        assert http.post(f"{API}/actions", json=body).status_code == 422


def test_jobs_are_sorted_and_paged_over_http(both: tuple[TestClient, Service]) -> None:
    http, _ = both
    for name in ("b", "a", "c"):
        submit(http, name)
    first = http.get(API, params={"sort": "name", "down": False, "limit": 2}).json()
    assert [job["name"] for job in first["items"]] == ["a", "b"]
    more = {"sort": "name", "down": False, "limit": 2, "cursor": first["next_cursor"]}
    assert [job["name"] for job in http.get(API, params=more).json()["items"]] == ["c"]
    answer = http.get(API, params={**more, "down": True})
    assert (answer.status_code, answer.json()["errors"][0]["field"]) == (422, "cursor")
    assert http.get(API, params={"sort": "colour"}).status_code == 422
