from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from tests.service.http import HERE, idle_service

if TYPE_CHECKING:
    from pathlib import Path

JOBS = "/api/v1/jobs"
KEY = "correct-horse"


@pytest.mark.parametrize("host", ["evil.example", "evil.example:8321", "127.0.0.1.evil.example", "", "10.0.0.1"])
def test_on_loopback_a_foreign_host_is_refused(tmp_path: Path, host: str) -> None:
    with idle_service(tmp_path) as (http, _):
        answer = http.get(JOBS, headers={"Host": host})
    assert (answer.status_code, answer.headers["content-type"]) == (421, "application/problem+json")


@pytest.mark.slow
@pytest.mark.parametrize("host", ["localhost", "localhost:1", "127.0.0.1:8321", "[::1]:8321", "127.1.2.3"])
def test_on_loopback_its_names_are_fine(tmp_path: Path, host: str) -> None:
    with idle_service(tmp_path) as (http, _):
        assert http.get(JOBS, headers={"Host": host}).status_code == 200


def test_a_page_of_elsewhere_may_not_change_anything(tmp_path: Path) -> None:
    with idle_service(tmp_path) as (http, _):
        for origin in ("https://evil.example", "null", "http://127.0.0.1:1"):
            assert http.post(JOBS, json={"scenario": "line"}, headers={"Origin": origin}).status_code == 403
        assert http.post(JOBS, json={"scenario": "line"}, headers={"Origin": HERE}).status_code == 202


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_a_browser_that_says_that_a_page_of_elsewhere_asks_is_believed(tmp_path: Path, site: str) -> None:
    with idle_service(tmp_path) as (http, _):
        told = {"Sec-Fetch-Site": site}
        assert http.post(JOBS, json={"scenario": "line"}, headers=told).status_code == 403
        reads = http.get(JOBS, headers={**told, "Sec-Fetch-Mode": "no-cors"}).status_code
        assert reads == (403 if site == "cross-site" else 200)
        assert http.get("/", headers={**told, "Sec-Fetch-Mode": "navigate"}).status_code == 200


@pytest.mark.slow
def test_no_answer_may_be_embedded_by_a_page_of_elsewhere(tmp_path: Path) -> None:
    with idle_service(tmp_path) as (http, _):
        for answer in (http.get(JOBS), http.get("/nothing"), http.get(JOBS, headers={"Host": "evil.example"})):
            assert answer.headers["cross-origin-resource-policy"] == "same-origin"
            assert answer.headers["x-content-type-options"] == "nosniff"


def test_long_addresses_and_headers_are_refused(tmp_path: Path) -> None:
    with idle_service(tmp_path) as (http, _):
        assert http.get(f"{JOBS}?cursor={'1' * 8_000}").status_code == 414
        answer = http.get(JOBS, headers={"X-Long": "x" * 16_001})
    assert (answer.status_code, answer.headers["content-type"]) == (431, "application/problem+json")


def test_a_key_is_asked_for_everywhere_but_at_the_health_checks(tmp_path: Path) -> None:
    with idle_service(tmp_path, host="0.0.0.0", api_key=KEY) as (http, _):
        for path in ("/", JOBS, "/openapi.json", "/version", "/nothing", "/recordings/a.rrd"):
            answer = http.get(path)
            assert (answer.status_code, answer.headers["content-type"]) == (401, "application/problem+json")
            assert answer.headers["www-authenticate"].startswith("Bearer")
        assert http.get("/healthz").status_code == http.get("/readyz").status_code == 200
        assert http.get(JOBS, headers={"Authorization": f"Bearer {KEY}"}).status_code == 200


@pytest.mark.parametrize("value", ["", "Bearer", "Bearer ", f"Basic {KEY}", f"Bearer {KEY}x", KEY, "Bearer \xe4"])
def test_a_wrong_key_is_refused(tmp_path: Path, value: str) -> None:
    with idle_service(tmp_path, api_key=KEY) as (http, _):
        assert http.get(JOBS, headers=[(b"authorization", value.encode("latin-1"))]).status_code == 401
