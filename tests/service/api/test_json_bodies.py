"""Bodies of JSON: read and checked in a thread, bounded in what they cost and in what is told of them."""

from __future__ import annotations

import json
import threading
from typing import TYPE_CHECKING, Any

import pytest

from service.api import json_bodies
from service.api.json_bodies import JsonBodyRoute
from tests.service.http import idle_service

if TYPE_CHECKING:
    from collections.abc import Iterator

    from starlette.testclient import TestClient

JOBS, CAMPAIGNS = "/api/v1/jobs", "/api/v1/campaigns"
JSON = {"Content-Type": "application/json"}


@pytest.fixture(scope="module")
def http(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    with idle_service(tmp_path_factory.mktemp("data")) as (client, _):
        yield client


def test_every_route_that_takes_json_checks_it_off_the_event_loop(http: TestClient) -> None:
    taking = [route for route in http.app.state.every_route if getattr(route, "body_field", None) is not None]  # type: ignore[attr-defined]
    assert len(taking) >= 6
    assert [route.path for route in taking if not isinstance(route, JsonBodyRoute)] == []


def test_a_body_is_parsed_and_validated_in_a_thread(http: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    threads: list[str] = []
    checked = json_bodies._checked

    def watched(body: bytes, field: Any) -> Any:
        threads.append(threading.current_thread().name)
        return checked(body, field)

    monkeypatch.setattr(json_bodies, "_checked", watched)
    long = json.dumps({"scenario": {"name": "a", "warnings": "x" * 5000}})
    assert http.post(JOBS, content=long, headers=JSON).status_code == 422
    assert len(threads) == 1
    assert "AnyIO worker thread" in threads[0]


MANY = 40_000
WIDE = {
    "names of a job": (JOBS, {"scenario": "demo", **{f"k{i}": 1 for i in range(MANY)}}),
    "fields of a scenario": (JOBS, {"scenario": {f"k{i}": 1 for i in range(MANY)}}),
    "fields of a block": (JOBS, {"scenario": {"tissue": {f"youn{i}": 1 for i in range(MANY)}}}),
    "wrong items": (JOBS, {"scenario": {"tissue": {"fixed_faces": ["q"] * MANY}}}),
    "one long name": (JOBS, {"scenario": "demo", "x" * 900_000: 1}),
    "one long field": (JOBS, {"scenario": {"x" * 900_000: 1}}),
    "axes that are none": (CAMPAIGNS, {"grid": {f"k{i}": 1 for i in range(MANY)}}),
    "too many axes": (CAMPAIGNS, {"grid": {f"k{i}": [1] for i in range(MANY)}}),
    "too many values": (CAMPAIGNS, {"grid": {"seed": list(range(2 * MANY))}}),
    "the same value": (CAMPAIGNS, {"grid": {"seed": [0] * 2 * MANY}}),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", WIDE)
def test_the_answer_to_very_many_faults_is_short(http: TestClient, case: str) -> None:
    path, body = WIDE[case]
    answer = http.post(path, content=json.dumps(body), headers=JSON)
    assert answer.status_code == 422
    assert len(answer.content) < 40_000
    assert 1 <= len(answer.json()["errors"]) <= 51


@pytest.mark.parametrize(
    "body",
    [
        b'{"scenario":' + b"[" * 100_000 + b"]" * 100_000 + b"}",
        b'{"scenario": {"seed": ' + b"9" * 500_000 + b"}}",
        b'{"scenario": "\xff"}',
        b'{"scenario": ' * 3,
    ],
    ids=["nested", "digits", "no text", "cut"],
)
def test_what_is_no_json_is_told_as_such(http: TestClient, body: bytes) -> None:
    answer = http.post(JOBS, content=body, headers=JSON)
    assert (answer.status_code, answer.json()["code"]) == (400, "json-invalid")


def test_faults_of_the_address_and_of_the_body_are_told_together(http: TestClient) -> None:
    answer = http.post(f"{CAMPAIGNS}?dry_run=perhaps", json={"grid": 1, "colour": 2})
    assert {error["field"] for error in answer.json()["errors"]} == {"dry_run", "grid", "colour"}
