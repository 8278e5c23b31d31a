from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from service.api.problems import echoed
from service.settings import Limits
from tests.budget import examples
from tests.service.http import idle_service

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from starlette.testclient import TestClient

JOBS = "/api/v1/jobs"
JSON = {"Content-Type": "application/json"}


@pytest.fixture
def http(tmp_path: Path) -> Iterator[TestClient]:
    with idle_service(tmp_path, limits=Limits(body_mb=0.02)) as (client, _):
        yield client


def problem(answer: Any, status: int) -> dict[str, Any]:
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    body: dict[str, Any] = json.loads(answer.text, parse_constant=lambda text: pytest.fail(text))
    assert {"type", "title", "status", "detail", "instance"} <= set(body)
    assert (body["status"], body["type"]) == (status, "about:blank")
    return body


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "path", "status"),
    [
        ("GET", "/nothing", 404),
        ("GET", "/redoc", 404),
        ("PUT", JOBS, 405),
        ("GET", f"{JOBS}/", 404),
        ("GET", f"{JOBS}/unknown", 404),
        ("DELETE", f"{JOBS}/unknown", 404),
        ("POST", f"{JOBS}/unknown/cancel", 404),
        ("GET", f"{JOBS}/unknown/series", 404),
        ("GET", f"{JOBS}/unknown/metrics", 404),
        ("GET", f"{JOBS}/unknown/artefacts", 404),
        ("GET", f"{JOBS}/unknown/artefacts/x", 404),
        ("GET", "/recordings/unknown.rrd", 404),
        ("GET", f"{JOBS}/NOT-AN-ID", 422),
        ("GET", "/recordings/%2e%2e%2fx.rrd", 404),
        ("GET", f"{JOBS}/unknown?wait=nan", 422),
        ("GET", f"{JOBS}?limit=0", 422),
        ("GET", f"{JOBS}?limit=1e3", 422),
        ("GET", f"{JOBS}?cursor=x", 422),
        ("GET", f"{JOBS}?cursor=9999999999999999999", 422),
        ("GET", f"{JOBS}?state=done", 422),
    ],
)
def test_errors_of_every_route_are_problems(http: TestClient, method: str, path: str, status: int) -> None:
    problem(http.request(method, path), status)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("body", "status"),
    [
        (b"", 422),
        (b"{", 400),
        (b"\xff\xfe", 400),
        (b"[" * 9000, 400),
        (b'{"scenario": ' + b"9" * 5000 + b"}", 400),
        (b"[]", 422),
        (b'"demo"', 422),
        (b'{"scenario": "demo", "more": 1}', 422),
        (b'{"scenario": 3}', 422),
        (b'{"scenario": null}', 422),
        (b'{"scenario": "\\ud800"}', 422),
        (b'{"scenario": {"name": "\\ud800"}}', 422),
        (b'{"scenario": "demo", "priority": true}', 422),
        (b'{"scenario": "demo", "priority": 1e999}', 422),
        (b'{"scenario": "demo", "priority": 101}', 422),
        (b'{"scenario": "demo", "timeout_s": NaN}', 422),
        (b'{"scenario": "demo", "timeout_s": "60"}', 422),
        (b'{"scenario": {"dt_s": NaN}}', 422),
        (b'{"scenario": {"dt_s": 1e999}}', 422),
        (b'{"scenario": {"schema": "needlebench/scenario/2"}}', 422),
    ],
)
def test_bad_bodies_are_problems(http: TestClient, body: bytes, status: int) -> None:
    told = problem(http.post(JOBS, content=body, headers=JSON), status)
    assert ("errors" in told) == (status == 422)


def test_a_bad_scenario_is_told_field_by_field(http: TestClient) -> None:
    scenario = {"dt_s": 5, "needle": {"inner_diameter_mm": "wide"}, "surprise": 1}
    told = problem(http.post(JOBS, json={"scenario": scenario}), 422)
    assert {(error["field"], error["value"]) for error in told["errors"]} == {
        ("dt_s", 5),
        ("needle.inner_diameter_mm", "wide"),
        ("surprise", 1),
    }
    assert "0.0001 to 0.1" in next(e["message"] for e in told["errors"] if e["field"] == "dt_s")


def test_a_body_of_another_type_is_415(http: TestClient) -> None:
    for media_type in ("text/plain", "application/x-www-form-urlencoded"):
        problem(http.post(JOBS, content=b'{"scenario": "demo"}', headers={"Content-Type": media_type}), 415)


def test_a_long_body_is_413_declared_or_not(http: TestClient) -> None:
    problem(http.post(JOBS, content=b" " * 20_001, headers=JSON), 413)
    problem(http.post(JOBS, content=iter([b" " * 15_000] * 2), headers=JSON), 413)


def test_a_crash_is_a_problem_without_details(http: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    def crash(*_: object, **__: object) -> None:
        raise RuntimeError("a secret")

    monkeypatch.setattr("service.store.jobs.Store.page", crash)
    assert "secret" not in str(problem(http.get(JOBS), 500))


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)


@pytest.mark.slow
@settings(max_examples=examples(150), deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(VALUES)
def test_no_body_makes_the_server_fail(http: TestClient, value: Any) -> None:
    for body in (value, {"scenario": value}, {"scenario": {"tissue": value, "controller": value}}):
        answer = http.post(JOBS, content=json.dumps(body), headers=JSON)
        if answer.status_code != 202:
            problem(answer, answer.status_code)
            assert answer.status_code in (400, 422)


@given(st.integers() | st.floats() | st.text() | VALUES)
def test_what_is_echoed_is_short_and_is_json(value: Any) -> None:
    text = json.dumps(echoed(value), allow_nan=False)
    assert len(text) < 1500


def test_what_is_echoed_of_strange_numbers() -> None:
    assert (echoed(math.inf), echoed(True), echoed(10**400)[:3]) == ("inf", True, "100")


def test_a_body_whose_fields_are_all_optional_is_refused_like_any_other(http: TestClient) -> None:
    """What stands in the place of a refused body must not be read as an empty one: this one would clear old jobs."""
    answer = http.post("/api/v1/gc", json={"older_than_s": -1})
    assert (answer.status_code, answer.json()["errors"][0]["field"]) == (422, "older_than_s")
