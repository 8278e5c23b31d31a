"""A browser that logs in: cookie, session, same-origin requests only."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import pytest

from service.access import SESSION_COOKIE
from service.store.keys import SESSION_S, Keys
from service.web.login import inside
from tests.service.http import HERE, idle_service

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from starlette.testclient import TestClient

    from service.api.context import Service

JOBS = "/api/v1/jobs"
KEY = "correct-horse"
BROWSER = {"Accept": "text/html,application/xhtml+xml"}


@pytest.fixture
def both(tmp_path: Path) -> Iterator[tuple[TestClient, Service]]:
    with idle_service(tmp_path, api_key=KEY) as (http, service):
        http.follow_redirects = False
        yield http, service


def log_in(http: TestClient, key: str = KEY, goal: str = "/") -> str:
    """The cookie's own line; the client keeps it."""
    answer = http.post("/login", data={"key": key, "next": goal}, headers={"Origin": HERE})
    assert answer.status_code == 303, answer.text
    assert answer.headers["location"] == goal
    return str(answer.headers["set-cookie"])


def test_a_page_leads_to_the_login_and_back(both: tuple[TestClient, Service]) -> None:
    http, _ = both
    sent_on = http.get("/api/v1/jobs?limit=5", headers=BROWSER)
    assert (sent_on.status_code, sent_on.headers["location"]) == (303, "/login?next=%2Fapi%2Fv1%2Fjobs%3Flimit%3D5")
    form = http.get(sent_on.headers["location"])
    assert form.status_code == 200
    assert '<label for="key">' in form.text
    assert 'name="next" value="/api/v1/jobs?limit=5"' in form.text
    policy = form.headers["content-security-policy"]
    nonce = re.search(r"'nonce-([^']+)'", policy)
    assert nonce is not None
    assert f'<style nonce="{nonce[1]}">' in form.text
    assert "script" not in form.text.lower()
    assert "default-src 'none'" in policy


def test_a_key_becomes_a_cookie_that_scripts_and_other_sites_do_not_get(both: tuple[TestClient, Service]) -> None:
    http, _ = both
    cookie = log_in(http, goal="/api/v1/jobs?limit=5")
    name, _, attributes = cookie.partition("=")
    assert name == SESSION_COOKIE
    assert {"httponly", "samesite=strict", "path=/"} <= {part.strip().lower() for part in attributes.split(";")}
    assert KEY not in cookie
    assert http.get(JOBS).status_code == 200
    assert http.get("/", headers=BROWSER).status_code == 200


def test_a_cookie_changes_things_from_the_services_own_page_only(both: tuple[TestClient, Service]) -> None:
    http, _ = both
    log_in(http)
    codes = {
        origin: http.post(JOBS, json={"scenario": "line"}, headers={"Origin": origin} if origin else {}).status_code
        for origin in (HERE, "", "null", "https://evil.example", "http://127.0.0.1:9", "http://localhost:8321")
    }
    assert codes == {origin: 202 if origin == HERE else 403 for origin in codes}


def test_a_header_comes_before_the_cookie(both: tuple[TestClient, Service]) -> None:
    http, _ = both
    log_in(http)
    assert http.get(JOBS, headers={"Authorization": "Bearer wrong"}).status_code == 401


def test_after_the_logout_the_cookie_opens_nothing(both: tuple[TestClient, Service]) -> None:
    http, _ = both
    log_in(http)
    token = http.cookies[SESSION_COOKIE]
    gone = http.post("/logout", headers={"Origin": HERE})
    assert (gone.status_code, gone.headers["location"]) == (303, "/login")
    assert SESSION_COOKIE not in http.cookies
    assert http.get(JOBS, headers={"Cookie": f"{SESSION_COOKIE}={token}"}).status_code == 401


@pytest.mark.slow
@pytest.mark.parametrize("form", [{"key": "wrong"}, {"key": ""}, {}, {"key": "x" * 20_000}])
def test_a_wrong_key_gives_the_form_again(both: tuple[TestClient, Service], form: dict[str, str]) -> None:
    http, _ = both
    answer = http.post("/login", data=form, headers={"Origin": HERE})
    assert answer.status_code == 401
    assert 'role="alert"' in answer.text
    assert "set-cookie" not in answer.headers


def test_a_form_of_another_page_or_a_broken_one_is_refused(both: tuple[TestClient, Service]) -> None:
    http, _ = both
    assert http.post("/login", data={"key": KEY}, headers={"Origin": "https://evil.example"}).status_code == 403
    for body in (b"\xff=%ff&" * 10, b"a=1&" * 100, b"=" * 5000):
        assert http.post("/login", content=body, headers={"Origin": HERE}).status_code == 401


@pytest.mark.slow
def test_a_session_has_the_scope_of_its_key_and_ends_with_it(both: tuple[TestClient, Service]) -> None:
    http, service = both
    made, key = service.keys.create(scope="read")
    log_in(http, key)
    assert http.get(JOBS).status_code == 200
    assert http.post(JOBS, json={"scenario": "line"}, headers={"Origin": HERE}).status_code == 403
    service.keys.revoke(made.id)
    assert http.get(JOBS).status_code == 401


def test_a_reader_can_log_out(both: tuple[TestClient, Service]) -> None:
    http, service = both
    log_in(http, service.keys.create(scope="read")[1])
    assert http.post("/logout", headers={"Origin": HERE}).status_code == 303


def test_a_session_ends_in_time_and_with_the_key_of_the_environment(tmp_path: Path) -> None:
    with idle_service(tmp_path, api_key=KEY) as (_, service):
        token = service.keys.log_in(KEY)
        assert token is not None
        assert service.keys.browser(token) is not None
        assert Keys(service.store, environment_key="another").browser(token) is None
        assert Keys(service.store).browser(token) is None
        real = service.store.now
        service.store._now = lambda: real + SESSION_S + 10
        assert service.keys.browser(token) is None


def test_where_no_key_is_asked_for_there_is_no_login(tmp_path: Path) -> None:
    with idle_service(tmp_path) as (http, _):
        answer = http.get("/login?next=/openapi.json", follow_redirects=False)
    assert (answer.status_code, answer.headers["location"]) == (303, "/openapi.json")


@pytest.mark.parametrize(
    "goal",
    ["https://evil.example", "//evil.example", "/\\evil.example", "javascript:alert(1)", "", "/a\r\nb", "/\u202e"],
)
def test_the_login_leads_to_nowhere_else(goal: str) -> None:
    assert inside(goal) == "/"


def test_a_hostile_goal_is_escaped(both: tuple[TestClient, Service]) -> None:
    http, _ = both
    assert '"><script>' not in http.get("/login", params={"next": '/"><script>alert(1)</script>'}).text


@pytest.mark.slow
def test_over_https_the_cookie_stays_there(tmp_path: Path) -> None:
    with idle_service(tmp_path, api_key=KEY) as (http, _):
        http.base_url = HERE.replace("http:", "https:")
        answer = http.post("/login", data={"key": KEY}, follow_redirects=False)
    assert "secure" in answer.headers["set-cookie"].lower()


def test_cookies_of_others_are_not_looked_at(both: tuple[TestClient, Service], monkeypatch: pytest.MonkeyPatch) -> None:
    """The standard library takes a second over one that is full of backslashes."""
    http, _ = both
    log_in(http)
    token = http.cookies[SESSION_COOKIE]
    http.cookies.clear()
    read: list[str] = []

    def unquoted(text: str) -> str:
        read.append(text)
        return text

    monkeypatch.setattr("http.cookies._unquote", unquoted)
    strange = 'a="' + "\\\\" * 5000 + '"'
    answer = http.get("/api/v1/jobs", headers={"Cookie": f"{strange}; {SESSION_COOKIE}={token}; b=1"})
    assert (answer.status_code, set(read)) == (200, {token})
    wrong = http.get("/api/v1/jobs", headers={"Cookie": f"{SESSION_COOKIE}={strange}"})
    assert (wrong.status_code, set(read)) == (401, {token})
