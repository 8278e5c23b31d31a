"""API keys and scopes, over HTTP and as the database keeps them."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from typing import TYPE_CHECKING

import pytest

from service.api.middleware.rate_limit import RateLimit
from service.api_key import digest_of, id_of, keys_exist, new_key
from service.environment import SettingsError
from service.settings import Limits, Settings
from service.store.database import open_database
from service.store.jobs import Store
from service.store.keys import ENVIRONMENT, Keys, UnknownKeyError
from simcore.errors import ScenarioError
from tests.service.http import idle_service
from tests.service.learned import model_bytes

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from starlette.testclient import TestClient

    from service.api.context import Service

JOBS = "/api/v1/jobs"
UPLOADS = "/api/v1/uploads"


@pytest.fixture
def both(tmp_path: Path) -> Iterator[tuple[TestClient, Service]]:
    with idle_service(tmp_path) as pair:
        yield pair


def bearer(service: Service, scope: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {service.keys.create(scope=scope)[1]}"}


def test_a_key_has_a_form_and_is_never_the_same() -> None:
    made = [new_key() for _ in range(50)]
    assert len({key for key, _ in made}) == 50
    assert all(id_of(key) == key_id for key, key_id in made)
    assert [id_of(text) for text in ("", "nb_", "nb_0123456789_short", "x" * 200)] == [None] * 4


def test_without_a_key_nobody_is_asked_and_from_the_first_one_on_everybody(both: tuple[TestClient, Service]) -> None:
    http, service = both
    assert http.get(JOBS).status_code == 200
    headers = bearer(service, "read")
    assert http.get(JOBS).status_code == 401
    assert http.get(JOBS, headers=headers).status_code == 200
    service.keys.revoke(service.keys.all()[0].id)
    assert http.get(JOBS, headers=headers).status_code == 401, "a service does not open because its last key goes"
    assert http.get(JOBS).status_code == 401
    again = Keys(service.store)  # of the next start
    assert again.wanted()
    assert http.get(JOBS, headers=bearer(service, "admin")).status_code == 200, "the command line is the way back in"


@pytest.mark.slow
def test_scopes_are_steps(both: tuple[TestClient, Service]) -> None:
    http, service = both
    by = {scope: bearer(service, scope) for scope in ("read", "submit", "admin")}
    codes = {}
    for scope, headers in by.items():
        job = http.post(JOBS, json={"scenario": "line"}, headers=headers)
        codes[scope] = [http.get(JOBS, headers=headers).status_code, job.status_code]
    assert codes == {"read": [200, 403], "submit": [200, 202], "admin": [200, 202]}
    refused = http.post(JOBS, json={"scenario": "line"}, headers=by["read"])
    assert refused.headers["content-type"] == "application/problem+json"
    assert "scope submit; yours has read" in refused.json()["detail"]


@pytest.mark.slow
def test_what_another_key_made_is_changed_by_admin_only(both: tuple[TestClient, Service]) -> None:
    http, service = both
    mine, other, admin = (bearer(service, scope) for scope in ("submit", "submit", "admin"))
    urls = [http.post(JOBS, json={"scenario": "line"}, headers=mine).headers["location"] for _ in range(2)]
    assert http.get(urls[0], headers=mine).json()["key"] == service.keys.all()[0].id
    query = {"kind": "model", "name": "a.json"}
    sent = http.post(UPLOADS, params=query, content=model_bytes("linear"), headers=mine)
    for url in urls:
        assert http.post(f"{url}/cancel", headers=other).status_code == 403
        assert http.delete(url, headers=other).status_code == 403
        assert http.get(url, headers=other).json()["state"] == "queued"
        assert http.post(f"{url}/cancel", headers=mine).status_code == 202
    assert http.delete(sent.headers["location"], headers=other).status_code == 403
    assert http.delete(sent.headers["location"], headers=mine).status_code == 204
    assert http.delete(urls[0], headers=mine).status_code == 204
    assert http.delete(urls[1], headers=admin).status_code == 204


@pytest.mark.slow
def test_admins_make_list_and_revoke_keys(both: tuple[TestClient, Service]) -> None:
    http, service = both
    assert http.post("/api/v1/keys", json={"scope": "admin"}).status_code == 409, "it would lock everybody out"
    admin, submit = bearer(service, "admin"), bearer(service, "submit")
    made = http.post("/api/v1/keys", json={"scope": "read", "note": "lab"}, headers=admin)
    assert (made.status_code, made.headers["cache-control"]) == (201, "no-store")
    key = made.json().pop("key")
    assert http.get(JOBS, headers={"Authorization": f"Bearer {key}"}).status_code == 200
    items = http.get("/api/v1/keys", headers=admin).json()["items"]
    assert [(item["scope"], item["note"]) for item in items] == [("admin", ""), ("submit", ""), ("read", "lab")]
    assert key not in json.dumps(items)
    url = made.headers["location"]
    assert http.get(url, headers=admin).json()["id"] == id_of(key)
    for _ in range(2):
        assert http.delete(url, headers=admin).status_code == 204
    assert http.get(JOBS, headers={"Authorization": f"Bearer {key}"}).status_code == 401
    assert http.get("/api/v1/keys/unknown", headers=admin).status_code == 404
    for body in ({"scope": "root"}, {"scope": "read", "note": "a\nb"}, {"scope": "read", "more": 1}, {}):
        assert http.post("/api/v1/keys", json=body, headers=admin).status_code == 422
    codes = {http.request(method, path, headers=submit, json={"scope": "read"}).status_code
             for method, path in (("GET", "/api/v1/keys"), ("POST", "/api/v1/keys"), ("DELETE", url))}  # fmt: skip
    assert codes == {403}


def test_two_keys_may_use_the_same_idempotency_key(both: tuple[TestClient, Service]) -> None:
    http, service = both
    one, two = (bearer(service, "submit") for _ in range(2))

    def job(headers: dict[str, str]) -> str:
        answer = http.post(JOBS, json={"scenario": "line"}, headers={**headers, "Idempotency-Key": "k" * 200})
        assert answer.status_code == 202
        return str(answer.json()["id"])

    assert job(one) == job(one)
    assert job(one) != job(two)


@pytest.mark.slow
@pytest.mark.parametrize("change", ["cut", "longer", "other", "revoked", "basic", "none"])
def test_a_wrong_key_is_401(both: tuple[TestClient, Service], change: str) -> None:
    http, service = both
    service.keys.create(scope="admin")
    made, key = service.keys.create(scope="admin")
    if change == "revoked":
        service.keys.revoke(made.id)
    other = key[:-1] + ("A" if key[-1] != "A" else "B")
    sent = {"cut": key[:-1], "longer": f"{key}A", "other": other}.get(change, key)
    header = {"basic": f"Basic {sent}", "none": ""}.get(change, f"Bearer {sent}")
    answer = http.get(JOBS, headers={"Authorization": header})
    assert (answer.status_code, answer.headers["content-type"]) == (401, "application/problem+json")
    assert answer.headers["www-authenticate"].startswith("Bearer")


def test_the_database_holds_hashes_only(both: tuple[TestClient, Service], tmp_path: Path) -> None:
    http, service = both
    _, key = service.keys.create(scope="submit", note="nightly")
    token = service.keys.log_in(key)
    assert token is not None
    assert http.get(JOBS, headers={"Authorization": f"Bearer {key}"}).status_code == 200
    files = b"".join(path.read_bytes() for path in tmp_path.glob("needlebench.sqlite*"))
    assert key.split("_", 2)[2].encode() not in files
    assert token.encode() not in files
    assert digest_of(key).encode() in files


def test_its_last_use_is_noted_to_the_minute(tmp_path: Path) -> None:
    now = [1000.0]
    store = Store(open_database(tmp_path / "a.sqlite"), now=lambda: now[0])
    keys = Keys(store)
    made, key = keys.create(scope="read", note="whose")
    used = []
    for second in (1000.0, 1030.0, 1061.0):
        now[0] = second
        keys.caller(key)
        used.append(keys.get(made.id).used_at)
    assert used == [1000.0, 1000.0, 1061.0]
    store.close()


def test_a_key_of_a_wrong_scope_or_note_is_refused(both: tuple[TestClient, Service]) -> None:
    for wrong in ({"scope": "root"}, {"scope": "read", "note": "x" * 201}, {"scope": "read", "note": "a\nb"}):
        with pytest.raises(ScenarioError):
            both[1].keys.create(**wrong)
    with pytest.raises(UnknownKeyError):
        both[1].keys.revoke("unknown")


def test_the_key_of_the_environment_is_admin(tmp_path: Path) -> None:
    with idle_service(tmp_path, api_key="correct-horse") as (http, service):
        caller = service.keys.caller("correct-horse")
        assert caller is not None
        assert (caller.key_id, caller.scope) == (ENVIRONMENT, "admin")
        service.keys.create(scope="read")
        assert http.get(JOBS, headers={"Authorization": "Bearer correct-horse"}).status_code == 200


@pytest.mark.slow
def test_an_open_address_is_accepted_once_there_is_a_key(tmp_path: Path) -> None:
    settings = Settings(data=tmp_path)
    assert not keys_exist(settings.database)
    store = Store(open_database(settings.database))
    made, _ = Keys(store).create(scope="read")
    with idle_service(tmp_path, host="0.0.0.0") as (http, service):
        assert http.get(JOBS).status_code == 401
        service.keys.revoke(made.id)
        assert http.get(JOBS).status_code == 401, "an open address never serves without a key"
    with pytest.raises(SettingsError, match="needlebench key create"):
        Settings(data=tmp_path, host="0.0.0.0").check_exposure()
    store.close()


def test_a_file_that_is_no_database_of_ours_holds_no_keys(tmp_path: Path) -> None:
    path = tmp_path / "a.sqlite"
    path.write_bytes(b"no database at all, but long enough to be read as a header" * 10)
    assert not keys_exist(path)
    with closing(sqlite3.connect(tmp_path / "b.sqlite")) as other:
        other.execute("CREATE TABLE a (b)")
    assert not keys_exist(tmp_path / "b.sqlite")


@pytest.mark.slow
def test_a_key_that_asks_too_often_has_to_wait(tmp_path: Path) -> None:
    with idle_service(tmp_path, limits=Limits(rate_per_key=0.5)) as (http, service):
        first, second = bearer(service, "read"), bearer(service, "read")
        codes = [http.get(JOBS, headers=first).status_code for _ in range(2)]
        answer = http.get(JOBS, headers=first)
        assert (codes, answer.status_code) == ([200, 429], 429)
        assert answer.headers["content-type"] == "application/problem+json"
        assert 1 <= int(answer.headers["retry-after"]) <= 2
        assert http.get(JOBS, headers=second).status_code == 200
        assert http.get("/healthz", headers=first).status_code == 200


def test_a_bucket_fills_at_its_rate() -> None:
    now = [0.0]
    rate = RateLimit(2.0, lambda: now[0])
    assert [rate.wait_s("a") for _ in range(5)] == [0, 0, 0, 0, 0.5]
    now[0] = 0.5
    assert [rate.wait_s("a"), rate.wait_s("a"), rate.wait_s("b")] == [0, 0.5, 0]
    now[0] = 1000.0
    assert sum(not rate.wait_s("a") for _ in range(10)) == 4
    assert not any(RateLimit(0.0, lambda: 0.0).wait_s("a") for _ in range(1000))


def test_who_asked_long_ago_is_forgotten_and_who_asked_too_often_is_not() -> None:
    now = [0.0]
    rate = RateLimit(2.0, lambda: now[0])
    for number in range(5000):
        now[0] += 0.1
        rate.wait_s(f"key {number}")
        assert len(rate._buckets) <= 1001
    while not rate.wait_s("greedy"):
        pass
    for number in range(3000):
        rate.wait_s(f"other {number}")
    assert rate.wait_s("greedy") == 0.5
    now[0] += 10.0
    for number in range(10_000):
        rate.wait_s(f"newcomer {number}")
    assert "greedy" not in rate._buckets
