"""What the pages say beside the values: why a job waits, its campaign, what it did so far, what went wrong."""

from __future__ import annotations

import json
from html import unescape
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest

from service.engine.attempt_trace import MOST_POINTS, AttemptTrace
from tests.service.http import finish, idle_service

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from starlette.testclient import TestClient

    from service.api.context import Service

BROWSER = {"Accept": "text/html,application/xhtml+xml"}


@pytest.fixture
def pages(tmp_path: Path) -> Iterator[tuple[TestClient, Service]]:
    with idle_service(tmp_path) as found:
        yield found


def submit(http: TestClient, **more: Any) -> str:
    made: str = http.post("/api/v1/jobs", json={"scenario": "demo", **more}).json()["id"]
    return made


@pytest.mark.slow
def test_a_job_that_waits_says_why(pages: tuple[TestClient, Service], monkeypatch: pytest.MonkeyPatch) -> None:
    http, service = pages
    first, second, third = submit(http), submit(http), submit(http)
    urgent = submit(http, priority=5)
    assert "The workers are starting." in http.get(f"/jobs/{first}").text
    monkeypatch.setattr(type(service.engine), "ready", 2)
    assert "It is the next one to start." in http.get(f"/jobs/{urgent}").text
    assert "1 job is ahead of it; 2 run at a time." in http.get(f"/jobs/{first}").text
    assert "2 jobs are ahead of it" in http.get(f"/jobs/{second}").text
    assert "3 jobs are ahead of it" in http.get(f"/jobs/{third}").text
    monkeypatch.setattr(type(service.engine), "problem", "the disk is full")
    assert "No job can start: the disk is full" in http.get(f"/jobs/{first}").text
    assert finish(service).id == urgent
    assert "ahead of it" not in http.get(f"/jobs/{urgent}").text


@pytest.mark.slow
def test_a_job_leads_to_its_campaign_and_a_case_says_its_values(pages: tuple[TestClient, Service]) -> None:
    http, _ = pages
    alone = submit(http)
    grid = {"grid": {"controller.kind": ["ifem", "open_loop"], "seed": [7]}, "name": "two of them"}
    campaign = http.post("/api/v1/campaigns", json=grid).json()["id"]
    job = http.get(f"/api/v1/campaigns/{campaign}/jobs").json()["items"][1]["job"]
    link = f'<a href="/campaigns/{campaign}">two of them</a>'
    assert link in http.get(f"/jobs/{job}").text
    assert link not in http.get(f"/jobs/{alone}").text
    assert http.get("/").text.count(link) == 1  # one line, whatever the number of its jobs
    assert http.get("/?all=1").text.count(link) == 2 + 1
    assert http.get("/?state=queued").text.count(link) == 2
    assert "open_loop" in http.get(f"/campaigns/{campaign}").text


@pytest.mark.slow
def test_jobs_are_found_by_a_part_of_their_name_or_the_beginning_of_their_id(pages: tuple[TestClient, Service]) -> None:
    http, service = pages
    ids = {name: named_job(http, name) for name in ("first sine", "Second SINE", "x_1 line", "xx1 line")}

    def found(search: str, **more: Any) -> set[str]:
        text = http.get("/", params={"q": search, **more}).text
        listed = {one["id"] for one in http.get("/api/v1/jobs", params={"q": search, **more}).json()["items"]}
        assert listed == {job_id for job_id in ids.values() if f'data-key="{job_id}"' in text}
        return {name for name, job_id in ids.items() if job_id in listed}

    assert found("sine") == {"first sine", "Second SINE"}
    assert found("  SECOND ") == {"Second SINE"}
    assert found("x_1") == found("_") == {"x_1 line"}
    assert found("%") == set()
    assert found(ids["xx1 line"][:10]) == {"xx1 line"}
    assert found("sine", state="queued") == {"first sine", "Second SINE"}
    assert found("sine", state="failed") == set()
    assert "None with this name, tag or id." in http.get("/", params={"q": "<script>"}).text
    assert "<script>alert" not in http.get("/", params={"q": "<script>alert"}).text
    assert 'href="/?state=queued&amp;q=a%26b"' in http.get("/", params={"q": "a&b"}).text
    finish(service)
    running = service.store.claim()
    assert running is not None
    page = http.get("/").text
    assert page.index(f'data-key="{running.id}"') < min(
        page.index(f'data-key="{one}"') for one in ids.values() if one != running.id
    )
    assert page.count(f'data-key="{running.id}"') == 1


def named_job(http: TestClient, name: str) -> str:
    made: str = http.post("/api/v1/jobs", json={"scenario": {"name": name}}).json()["id"]
    return made


def test_a_page_that_is_opened_in_the_middle_gets_the_way_so_far(pages: tuple[TestClient, Service]) -> None:
    http, service = pages
    made = submit(http)
    job = service.store.claim()
    assert job is not None
    trace = AttemptTrace()
    service.engine._slots[0].trace = trace
    trace.add(job, {"depth_mm": 1.0, "tip_error_mm": 0.25, "cross_track_mm": None, "insertion_force_n": 0.5})
    trace.add(job, {"step": 3})  # a training tells no depth
    text = http.get(f"/jobs/{made}").text
    (told,) = [part.split('"')[0] for part in text.split('data-course="')[1:]]
    assert json.loads(unescape(told)) == [[1.0, 0.25, None, 0.5]]


def test_a_course_is_of_one_attempt_and_never_long() -> None:
    trace = AttemptTrace()
    first, second = (SimpleNamespace(id="a", attempt=number) for number in (1, 2))
    for depth in range(3 * MOST_POINTS):
        trace.add(first, {"depth_mm": float(depth), "tip_error_mm": 0.0})  # type: ignore[arg-type]
    points = trace.points_of(first)  # type: ignore[arg-type]
    assert MOST_POINTS / 2 <= len(points) <= MOST_POINTS
    depths = [point.depth_mm for point in points]
    assert depths == sorted(depths)
    assert (depths[0], depths[-1]) == (0.0, 3 * MOST_POINTS - 1)
    trace.add(second, {"depth_mm": 0.5, "tip_error_mm": 0.0})  # type: ignore[arg-type]
    assert trace.points_of(first) == ()  # type: ignore[arg-type]
    assert len(trace.points_of(second)) == 1  # type: ignore[arg-type]


@pytest.mark.slow
@pytest.mark.parametrize(
    "address", ["/nothing", "/?state=odd", "/jobs/%3Cscript%3E", "/trends/", "/campaigns?cursor=x"]
)
def test_a_browser_gets_a_page_of_what_went_wrong(pages: tuple[TestClient, Service], address: str) -> None:
    http, _ = pages
    page = http.get(address, headers=BROWSER)
    told = http.get(address)
    assert page.status_code == told.status_code >= 400
    assert page.headers["content-type"].startswith("text/html")
    assert page.headers["content-security-policy"].startswith("default-src 'none'")
    assert "<nav" in page.text
    assert "<script>" not in page.text
    assert told.headers["content-type"] == "application/problem+json"


@pytest.mark.slow
def test_addresses_that_are_no_pages_tell_their_problem_as_json(pages: tuple[TestClient, Service]) -> None:
    http, _ = pages
    for address in ("/api/v1/jobs/0", "/static/0/none.css", "/recordings/0.rrd", "/viewer/none"):
        assert http.get(address, headers=BROWSER).headers["content-type"] == "application/problem+json", address
    assert http.post("/nothing", headers=BROWSER).headers["content-type"] == "application/problem+json"
