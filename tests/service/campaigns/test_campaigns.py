"""Campaigns over HTTP and in the store, without an engine: jobs are moved on by hand."""

from __future__ import annotations

import csv
import io
import re
from dataclasses import replace
from typing import TYPE_CHECKING, Any
from urllib.parse import urljoin

import pytest

from benchmarks.paper.table import rows
from service.campaigns.cases import CaseResult
from service.campaigns.results import outcomes
from service.campaigns.trends import point
from service.store.job import CANCELLED, FAILED, FINISHED, Outcome
from simcore.arms import Arm
from tests.service.http import idle_service

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from starlette.testclient import TestClient

    from service.api.context import Service

GRID = {
    "name": "two by two",
    "scenario": {"noise_mm": 0.25, "recording": {"enabled": False}},
    "grid": {"controller.kind": ["ifem", "open_loop"], "seed": [0, 1]},
}


@pytest.fixture
def both(tmp_path: Path) -> Iterator[tuple[TestClient, Service]]:
    with idle_service(tmp_path) as (http, service):
        yield http, service


def start(http: TestClient, body: dict[str, Any] | None = None) -> dict[str, Any]:
    answer = http.post("/api/v1/campaigns", json=body or GRID)
    assert answer.status_code == 202, answer.text
    assert answer.headers["location"] == answer.json()["links"]["self"]
    found: dict[str, Any] = answer.json()
    return found


def run_all(service: Service, *, rmse_commanded_mm: float = 0.1, digest: str = "d", state: str = FINISHED) -> int:
    """End every queued job; how many there were."""
    count = 0
    while (job := service.store.claim()) is not None:
        metrics = {
            "stable": True,
            "success": True,
            "rmse_commanded_mm": rmse_commanded_mm + 1e-3 * count,
            "max_commanded_mm": 0.4,
        }
        timing = {"plant": {"median_ms": 2.0}, "jacobian": {"median_ms": 0.2}, "command": {"median_ms": 0.1}}
        origin = {"scenario": (job.spec or {})["scenario"], "commit": "abc", "cpu": "cpu", "cpu_count": 2}
        result = {"status": "completed", "metrics": metrics, "timing": timing, "digest": digest, "provenance": origin}
        if state == FINISHED:
            service.store.finish(job, Outcome(state=state, result=result))
        else:
            service.store.finish(job, Outcome(state=state, error_kind="exception", error="it broke"))
        count += 1
    return count


def ended(both: tuple[TestClient, Service], **how: Any) -> dict[str, Any]:
    """A campaign from its beginning to its end."""
    http, service = both
    made = start(http)
    assert run_all(service, **how) == 4
    service.keeper.tick()
    found: dict[str, Any] = http.get(made["links"]["self"]).json()
    assert found["state"] == "done"
    return found


def test_a_grid_over_element_sizes_takes_the_spacing_of_hard_points_along(both: tuple[TestClient, Service]) -> None:
    http, service = both
    hard = {"interaction": {"line_compliance": False}}
    start(http, {"scenario": hard, "grid": {"tissue.element_size_mm": [6, 10]}})
    specs = [job.spec or {} for job in (service.store.claim(), service.store.claim()) if job is not None]
    assert sorted(spec["scenario"]["interaction"]["spacing_mm"] for spec in specs) == [6.0, 10.0]


@pytest.mark.slow
def test_a_campaign_makes_its_jobs_and_ends_with_them(both: tuple[TestClient, Service]) -> None:
    http, service = both
    made = start(http)
    assert (made["state"], made["cases"], made["jobs"], made["fraction"]) == ("running", 4, {"queued": 4}, 0.0)
    service.keeper.tick()
    assert http.get(made["links"]["self"]).json()["state"] == "running"
    run_all(service)
    service.keeper.tick()
    done = http.get(made["links"]["self"]).json()
    assert (done["state"], done["jobs"], done["fraction"]) == ("done", {"finished": 4}, 1.0)
    cases = http.get(made["links"]["jobs"]).json()["items"]
    assert [case["labels"] for case in cases][:2] == [
        {"controller.kind": "ifem", "seed": 0, "arm": "ifem", "end_point": "18 31 122"},
        {"controller.kind": "ifem", "seed": 1, "arm": "ifem", "end_point": "18 31 122"},
    ]
    assert [case["case"] for case in cases] == [
        "ifem, seed 0",
        "ifem, seed 1",
        "open_loop, seed 0",
        "open_loop, seed 1",
    ]
    assert all(case["success"] for case in cases)


def test_a_dry_run_queues_nothing(both: tuple[TestClient, Service]) -> None:
    http, service = both
    answer = http.post("/api/v1/campaigns?dry_run=1", json=GRID)
    assert answer.status_code == 200
    assert answer.json()["jobs"] == 4
    assert answer.json()["seconds"] > 0
    assert service.store.claim() is None
    assert http.get("/api/v1/campaigns").json()["items"] == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("body", "words"),
    [
        ({}, "either suite or grid"),
        ({"suite": "nonsense-v1"}, "lin100-v2"),
        ({"suite": "lin100-v2-smoke", "grid": {"seed": [0]}}, "either suite or grid"),
        ({"grid": {"seed": []}}, "at least one"),
        ({"grid": {"seed": [0, 1]}}, "has no effect while noise_mm = 0"),
        ({"grid": {"tissue.mesh_file": ["/etc/passwd"]}}, "not accepted here"),
        ({"grid": {"seed": [0]}, "priority": 1000}, "100"),
    ],
)
def test_a_wrong_request_is_refused_whole(both: tuple[TestClient, Service], body: dict[str, Any], words: str) -> None:
    http, service = both
    answer = http.post("/api/v1/campaigns", json=body)
    assert answer.status_code == 422
    assert words in answer.text
    assert service.store.claim() is None


@pytest.mark.slow
def test_single_jobs_go_before_campaigns(both: tuple[TestClient, Service]) -> None:
    http, service = both
    start(http)
    single = http.post("/api/v1/jobs", json={"scenario": "demo"}).json()
    claimed = service.store.claim()
    assert claimed is not None
    assert claimed.id == single["id"]


@pytest.mark.slow
def test_cancelling_keeps_what_is_finished(both: tuple[TestClient, Service]) -> None:
    http, service = both
    made = start(http)
    first, second = service.store.claim(), service.store.claim()
    assert first is not None
    assert second is not None
    service.store.finish(first, Outcome(state=FINISHED, result={"metrics": {}, "status": "completed"}))
    for _ in range(2):
        assert http.post(made["links"]["cancel"]).status_code == 202
    service.keeper.tick()
    now = http.get(made["links"]["self"]).json()
    assert (now["state"], now["cancelling"]) == ("running", True)
    assert now["jobs"] == {"finished": 1, "running": 1, "cancelled": 2}
    assert service.store.get_summary(second.id).cancel_requested
    service.store.finish(second, Outcome(state=CANCELLED))
    service.keeper.tick()
    assert http.get(made["links"]["self"]).json()["state"] == "cancelled"


@pytest.mark.slow
def test_results_outlive_their_jobs(both: tuple[TestClient, Service]) -> None:
    http, service = both
    done = ended(both)
    before = http.get(done["links"]["results"]).json()
    for case in http.get(done["links"]["jobs"]).json()["items"]:
        service.store.delete(case["job"])
    after = http.get(done["links"]["results"]).json()
    assert [insertion.pop("link") for insertion in after["chosen"]] == [None] * 4
    assert all(insertion.pop("link").startswith("/jobs/") for insertion in before["chosen"])
    assert after == before
    assert [score["arm"] for score in before["scores"]] == ["ifem", "open_loop"]


def test_the_measured_part_of_results_is_enough_for_tables_and_trends(both: tuple[TestClient, Service]) -> None:
    http, service = both
    made = start(http)
    arm = Arm(
        kind="plugin",
        controller="mine",
        settings={"gain": 0.1 + 0.2},
        version="1.2",
        code_sha256="ab" * 32,
        files={"weights": "cd" * 32},
    )
    for number in range(3):
        job = service.store.claim()
        assert job is not None
        metrics = {"stable": True, "rmse_commanded_mm": 1 / 3, "max_needle_stress_mpa": 1e-17, "success": None}
        rest = {"message": "ä\n“x”"} if number else {}
        origin = {
            "scenario": (job.spec or {})["scenario"],
            "commit": "abc",
            "cpu": "cpu",
            "cpu_count": 2,
            "arm": arm.data(),
        }
        result = {"status": "completed", "metrics": metrics, "warnings": ["1.5 mm"], "provenance": origin, **rest}
        service.store.finish(job, Outcome(state=FINISHED, result=result))
    last = service.store.claim()
    assert last is not None
    service.store.finish(last, Outcome(state=FAILED, error_kind="exception", error="it broke"))
    service.keeper.tick()
    whole, measured = (service.campaigns.cases(made["id"], whole=whole) for whole in (True, False))
    assert [case.result is None for case in measured] == [False, False, False, True]
    assert [CaseResult.of(case) for case in measured] == [CaseResult.of(case) for case in whole]
    tables = [rows(outcomes(cases)) for cases in (whole, measured)]
    kept = [[replace(row, scenario={}) for row in table] for table in tables]
    assert kept[0] == kept[1]
    for told in ("entry_mm", "end_mm", "yielded"):
        assert [getattr(row, told) for row in tables[0]] == [getattr(row, told) for row in tables[1]]
    campaign = service.campaigns.get(made["id"])
    assert point(campaign, outcomes(measured)) == point(campaign, outcomes(whole))


@pytest.mark.slow
def test_results_as_csv_and_as_a_page(both: tuple[TestClient, Service]) -> None:
    http, _ = both
    done = ended(both)
    lines = list(csv.DictReader(io.StringIO(http.get(done["links"]["results"] + "?format=csv").text)))
    assert [line["arm"] for line in lines] == ["ifem", "ifem", "open_loop", "open_loop"]
    page = http.get(done["links"]["report"])
    assert page.headers["content-type"].startswith("text/html"), page.text
    assert "I-FEM" in page.text
    assert "<script" not in page.text
    assert "<h1>two by two</h1>" in page.text
    assert "Perrusi" not in page.text
    (job, *_) = http.get(done["links"]["jobs"]).json()["items"]
    assert f'href="/jobs/{job["job"]}" target="_top"' in page.text
    for link in re.findall('href="(results[^"]*)"', page.text):
        assert http.get(urljoin(done["links"]["report"], link)).status_code == 200


@pytest.mark.slow
def test_a_named_suite_has_the_report_of_the_paper(both: tuple[TestClient, Service]) -> None:
    http, service = both
    made = start(http, {"suite": "lin100-v2-smoke"})
    run_all(service)
    service.keeper.tick()
    page = http.get(made["links"]["report"]).text
    assert "The paper’s claims" in page
    assert 'href="/jobs/' in page
    assert "needlebench view" not in page


@pytest.mark.slow
def test_jobs_without_a_result_are_failures_that_stay_in(both: tuple[TestClient, Service]) -> None:
    http, _ = both
    done = ended(both, state=FAILED)
    assert [score["stable"] for score in http.get(done["links"]["results"]).json()["scores"]] == [0.0, 0.0]


@pytest.mark.slow
def test_only_what_has_ended_can_be_deleted(both: tuple[TestClient, Service]) -> None:
    http, _ = both
    made = start(http)
    assert http.delete(made["links"]["self"]).status_code == 409
    done = ended(both) if http.post(made["links"]["cancel"]) else made
    assert http.delete(done["links"]["self"]).status_code == 204
    assert http.get(done["links"]["self"]).status_code == 404


@pytest.mark.slow
def test_two_campaigns_and_two_arms_are_compared(both: tuple[TestClient, Service]) -> None:
    http, _ = both
    one, other = ended(both, rmse_commanded_mm=0.1), ended(both, rmse_commanded_mm=0.3, digest="e")
    found = http.post("/api/v1/comparisons", json={"campaigns": [one["id"], other["id"]]}).json()
    assert (found["shared_cases"], found["same_digests"]) == (4, 0)
    assert [round(c["difference_mm"], 6) for c in found["comparisons"]] == [-0.2, -0.2]
    arms = {"campaigns": [one["id"]], "arms": ["ifem", "open_loop"]}
    (test,) = http.post("/api/v1/comparisons", json=arms).json()["comparisons"]
    assert test["difference_mm"] < 0
    assert (test["pairs"], test["unit"], test["p_holm"]) == (2, "case", test["p_primary"])
    every = http.post("/api/v1/comparisons", json={"campaigns": [one["id"]]}).json()
    assert (every["arms"], every["comparisons"]) == (["ifem", "open_loop"], [test])
    unknown = {"campaigns": [one["id"]], "arms": ["ifem", "elm"]}
    assert http.post("/api/v1/comparisons", json=unknown).status_code == 422
    assert http.post("/api/v1/comparisons", json={"campaigns": [], "arms": None}).status_code == 422
    assert http.post("/api/v1/comparisons", json={"campaigns": [one["id"], "ffff"]}).status_code == 404


@pytest.mark.slow
def test_a_trend_marks_what_got_worse(both: tuple[TestClient, Service]) -> None:
    http, _ = both
    ended(both)
    ended(both)
    ended(both, state=FAILED)
    assert http.get("/api/v1/trends").json()["items"] == ["two by two"]
    points = http.get("/api/v1/trends/two by two").json()["points"]
    assert [point["regression"] for point in points] == [False, False, True]
    assert points[1]["accuracy_why"] == "all 4 digests unchanged"
    ended(both, state=FAILED)
    trend = http.get("/api/v1/trends/two by two").json()
    assert trend["points"][-1]["regression"] is False
    assert [(loss["figure"], loss["campaign"]) for loss in trend["losses"]] == [("success", points[2]["campaign"])]
    assert "Not recovered yet" in http.get("/trends/two by two").text
    assert "worse since" in http.get("/trends").text
    ended(both)
    assert http.get("/api/v1/trends/two by two").json()["losses"] == []
    assert points[0]["step_ms"] == pytest.approx(2.3)


@pytest.mark.slow
def test_campaigns_are_listed_page_by_page(both: tuple[TestClient, Service]) -> None:
    http, _ = both
    made = [start(http)["id"] for _ in range(3)]
    first = http.get("/api/v1/campaigns?limit=2").json()
    rest = http.get(f"/api/v1/campaigns?limit=2&cursor={first['next_cursor']}").json()
    assert [item["id"] for item in first["items"] + rest["items"]] == made[::-1]
    assert rest["next_cursor"] is None


def test_suites_are_listed(both: tuple[TestClient, Service]) -> None:
    http, _ = both
    assert "lin100-v2-smoke" in [item["name"] for item in http.get("/api/v1/suites").json()["items"]]


@pytest.mark.slow
def test_a_page_of_a_campaign_names_its_cases_and_says_what_they_warn_of(both: tuple[TestClient, Service]) -> None:
    http, service = both
    made = start(http)
    while (job := service.store.claim()) is not None:
        metrics = {"stable": True, "success": True, "rmse_commanded_mm": 0.1}
        result = {"status": "completed", "metrics": metrics, "timing": {}, "warnings": [f"lost at {job.seq} mm"]}
        service.store.finish(job, Outcome(state=FINISHED, result=result))
    service.keeper.tick()
    page = http.get(f"/campaigns/{made['id']}").text
    assert "open_loop, seed 1" in page
    assert "4 of 4 insertions (ifem, seed 0; ifem, seed 1; open_loop, seed 0; …): lost at" in page
    assert "case-0" not in page
    report = http.get(made["links"]["results"]).json()
    assert [(one["cases"], one["text"].startswith("lost at")) for one in report["cautions"]] == [(4, True)]
    assert "lost at" in http.get(made["links"]["report"]).text
    assert "lost at" in http.get(made["links"]["results"], params={"format": "csv"}).text
    assert "constant" not in http.get(made["links"]["report"]).text.partition("</style>")[2]


def test_the_arms_of_a_campaign_are_compared_on_a_page(both: tuple[TestClient, Service]) -> None:
    http, _ = both
    done = ended(both)
    page = http.get(f"/compare?a={done['id']}&every=1").text
    assert "p, Holm" in page
    assert "1 case of 2 pairs: nothing is tested" in page
    assert "seeds that gave the same result to the bit count once" in page
