"""One rule for whoever changes something: its owner or an admin, not while it is pinned or has not ended."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from fastapi.routing import APIRoute

from service.access import SAFE_METHODS
from service.api.ownership import FOR_ADMINS, OWNERS
from service.app import PAGES, ROUTES
from service.store.job import CANCELLED
from tests.service.http import finish, idle_service

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from starlette.testclient import TestClient

    from service.api.context import Service

API = "/api/v1"
GRID = {"scenario": {"noise_mm": 0.25}, "grid": {"seed": [0, 1]}}
MAKES_SOMETHING = {  # operations that change nothing which is there
    "submit_job", "create_campaign", "create_schedule", "create_upload", "create_comparison", "compare_campaigns",
    "train_model",
}  # fmt: skip
ASKED_FOR_EACH = {"act_on_jobs"}  # the rule is asked for each thing that its body names
FOR_ADMINS_ALONE = {"create_key", "revoke_key", "clear_jobs"}
Headers = dict[str, str]
Both = tuple["TestClient", "Service"]


@pytest.fixture
def both(tmp_path: Path) -> Iterator[Both]:
    with idle_service(tmp_path) as pair:
        yield pair


def key(service: Service, scope: str) -> Headers:
    return {"Authorization": f"Bearer {service.keys.create(scope=scope)[1]}"}


def make(http: TestClient, who: Headers) -> dict[str, str]:
    """A thing of each kind, by the parameter of an address that names it."""
    file = io.BytesIO()
    np.save(file, np.array([[0.0, 0.0, len(who["Authorization"]), 1.0, 0.0, 0.0, 0.0]]))
    upload = http.post(
        f"{API}/uploads", params={"kind": "poses", "name": "a.npy"}, content=file.getvalue(), headers=who
    )
    schedule = {"name": f"s{len(who)}", "cron": "0 2 * * *", "campaign": GRID}
    answers = {
        "job_id": http.post(f"{API}/jobs", json={"scenario": "line"}, headers=who),
        "campaign_id": http.post(f"{API}/campaigns", json=GRID, headers=who),
        "schedule_id": http.post(f"{API}/schedules", json=schedule, headers=who),
        "upload_id": upload,
    }
    assert {name: answer.status_code for name, answer in answers.items() if answer.status_code >= 300} == {}
    return {name: answer.json()["id"] for name, answer in answers.items()}


def changes(http: TestClient, who: Headers) -> list[tuple[str, str, dict[str, Any]]]:
    """Every operation of the document that is not safe: method, path, description."""
    paths = http.get("/openapi.json", headers=who).json()["paths"]
    return [
        (method.upper(), path, operation)
        for path, methods in paths.items()
        for method, operation in methods.items()
        if method.upper() not in SAFE_METHODS
    ]


@pytest.mark.slow
def test_of_every_change_in_the_document_it_is_known_who_may_make_it(both: Both) -> None:
    http, service = both
    for method, path, operation in changes(http, key(service, "admin")):
        name = operation["operationId"]
        if "{" not in path:
            assert name in MAKES_SOMETHING | FOR_ADMINS_ALONE | ASKED_FOR_EACH, f"{method} {path}: who may do this?"
        else:
            assert path[path.index("{") + 1 : path.index("}")] in OWNERS.keys() | FOR_ADMINS, f"{method} {path}"


@pytest.mark.slow
def test_every_change_of_what_is_there_is_for_its_owner_and_for_admins(both: Both) -> None:
    http, service = both
    ada, ben, admin = key(service, "submit"), key(service, "submit"), key(service, "admin")
    things = make(http, ada)
    tried = 0
    for method, path, operation in changes(http, admin):
        if operation["operationId"] in MAKES_SOMETHING | ASKED_FOR_EACH:
            continue
        address = path.format(**things, key_id=service.keys.all()[0].id)
        answer = http.request(method, address, json={}, headers=ben)
        assert (answer.status_code, answer.json()["code"]) == (403, "scope-missing"), f"{method} {path}"
        tried += 1
    assert tried >= 15
    for name, value in things.items():  # nothing of it happened
        kind = name.removesuffix("_id") + "s"
        assert http.get(f"{API}/{kind}/{value}", headers=ada).status_code == 200
    assert http.get(f"{API}/jobs/{things['job_id']}", headers=ada).json()["state"] == "queued"
    for who in (ada, admin):
        assert http.post(f"{API}/jobs/{things['job_id']}/pin", headers=who).status_code == 200
        assert http.post(f"{API}/campaigns/{things['campaign_id']}/cancel", headers=who).status_code == 202
        assert http.patch(f"{API}/schedules/{things['schedule_id']}", json={}, headers=who).status_code == 200
        assert http.post(f"{API}/uploads/{things['upload_id']}/pin", headers=who).status_code == 200


def test_a_route_whose_owner_nobody_knows_is_refused() -> None:
    for part in (*ROUTES, *PAGES):
        for route in part.router.routes:
            if isinstance(route, APIRoute) and set(route.methods or ()) - SAFE_METHODS:
                named = {param.name for param in route.dependant.path_params}
                assert named <= OWNERS.keys() | FOR_ADMINS, route.path


@pytest.mark.slow
@pytest.mark.parametrize("action", ["cancel", "retry", "pin", "unpin", "delete"])
def test_an_action_over_many_jobs_is_refused_for_those_of_others_alone(both: Both, action: str) -> None:
    http, service = both
    ada, ben, admin = key(service, "submit"), key(service, "submit"), key(service, "admin")
    jobs = [http.post(f"{API}/jobs", json={"scenario": "line"}, headers=who).json()["id"] for who in (ada, ben)]
    if action in ("retry", "delete"):
        for job in jobs:
            service.store.cancel(job)
    answer = http.post(f"{API}/jobs/actions", json={"action": action, "jobs": jobs}, headers=ben).json()
    assert [(item["job"], item["done"], item["code"]) for item in answer["items"]] == [
        (jobs[0], False, "scope-missing"),
        (jobs[1], True, None),
    ]
    assert answer["done"] == 1
    again = http.post(f"{API}/jobs/actions", json={"action": action, "jobs": jobs[:1]}, headers=admin).json()
    assert again["done"] == 1
    reader = http.post(f"{API}/jobs/actions", json={"action": action, "jobs": jobs}, headers=key(service, "read"))
    assert reader.status_code == 403


@pytest.mark.slow
def test_what_is_pinned_or_has_not_ended_is_not_deleted(both: Both) -> None:
    http, service = both
    campaign = http.post(f"{API}/campaigns", json=GRID).json()["id"]
    url = f"{API}/campaigns/{campaign}"

    def refused(code: str, address: str = url) -> None:
        answer = http.delete(address)
        assert (answer.status_code, answer.json()["code"]) == (409, code)

    refused("campaign-state")
    first = finish(service)
    http.post(f"{API}/jobs/{first.id}/pin")
    refused("job-pinned", f"{API}/jobs/{first.id}")
    http.post(f"{url}/cancel")
    service.campaigns.settle()
    assert service.campaigns.get(campaign).terminal
    refused("campaign-pinned")
    http.delete(f"{API}/jobs/{first.id}/pin")
    second = next(job for job in service.store.page().items if job.id != first.id)
    assert second.state == CANCELLED
    assert http.post(f"{API}/jobs/{second.id}/retry").status_code == 202
    refused("campaign-state")
    finish(service)
    assert http.delete(url).status_code == 204
    assert service.store.page().items == []


@pytest.mark.slow
def test_a_priority_above_the_normal_one_needs_an_admin(both: Both) -> None:
    http, service = both
    submitter, admin = key(service, "submit"), key(service, "admin")
    training = {"data": f"artefact:{'0' * 64}.npz", "priority": 1}
    schedule = {"name": "s", "cron": "0 2 * * *", "campaign": {**GRID, "priority": 1}}
    requests: tuple[tuple[str, dict[str, Any]], ...] = (
        ("jobs", {"scenario": "line", "priority": 1}),
        ("campaigns", {**GRID, "priority": 1}),
        ("schedules", schedule),
        ("models/train", training),
    )
    for path, body in requests:
        answer = http.post(f"{API}/{path}", json=body, headers=submitter)
        assert (answer.status_code, answer.json()["code"]) == (403, "scope-missing"), path
        assert "priority 1" in answer.json()["detail"]
        assert http.post(f"{API}/{path}", json=body, headers=admin).status_code in (201, 202, 422), path
    assert http.post(f"{API}/jobs", json={"scenario": "line", "priority": 0}, headers=submitter).status_code == 202
    made = http.post(f"{API}/schedules", json={**schedule, "name": "t", "campaign": GRID}, headers=submitter).json()
    change = {"campaign": {**GRID, "priority": 5}}
    assert http.patch(f"{API}/schedules/{made['id']}", json=change, headers=submitter).status_code == 403


def test_a_campaign_that_the_queue_does_not_take_is_429(tmp_path: Path) -> None:
    from service.settings import Limits

    with idle_service(tmp_path, limits=Limits(queue=3)) as (http, service):
        assert http.post(f"{API}/campaigns", json=GRID).status_code == 202
        answer = http.post(f"{API}/campaigns", json=GRID)
        assert (answer.status_code, answer.json()["code"]) == (429, "queue-full")
        made = http.post(f"{API}/schedules", json={"name": "s", "cron": "0 2 * * *", "campaign": GRID}).json()
        run = http.post(f"{API}/schedules/{made['id']}/trigger").json()
        assert (run["outcome"], run["campaign"]) == ("failed", None)
        assert service.store.counts()["queued"] == 2
