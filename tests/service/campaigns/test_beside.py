"""What a small tip error may have been paid with stands beside it, wherever an RMSE is shown."""

from __future__ import annotations

import csv
import math
from typing import TYPE_CHECKING, Any

import pytest

from benchmarks.paper.table import BESIDE
from service.campaigns.cases import FIELDS, CaseResult, Column, sorted_cases
from service.store.campaign import CampaignCase
from service.store.job import Outcome
from tests.service.http import idle_service

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from starlette.testclient import TestClient

    from service.api.context import Service

VALUES = dict(zip(BESIDE, (1.27, 3.41, 0.83, 4.19, 0.27, 1234.0), strict=True))
GRID = {"scenario": "line", "name": "beside", "grid": {"controller.kind": ["ifem", "open_loop"], "dt_s": [0.01, 0.02]}}


@pytest.fixture
def both(tmp_path: Path) -> Iterator[tuple[TestClient, Service]]:
    with idle_service(tmp_path) as pair:
        yield pair


def ended(http: TestClient, service: Service, **changes: float) -> dict[str, Any]:
    """A campaign of four insertions with these values."""
    made: dict[str, Any] = http.post("/api/v1/campaigns", json=GRID).json()
    while (job := service.store.claim()) is not None:
        metrics = {"stable": True, "success": False, "rmse_commanded_mm": 0.1, **VALUES, **changes}
        origin = {"scenario": (job.spec or {})["scenario"], "commit": "abc", "cpu": "cpu", "cpu_count": 2}
        result = {"status": "completed", "metrics": metrics, "timing": {}, "digest": "d", "provenance": origin}
        service.store.finish(job, Outcome(state="finished", result=result))
    service.keeper.tick()
    return made


def shown(metric: str) -> str:
    return f"{VALUES[metric]:.{BESIDE[metric][1]}f}"


@pytest.mark.slow
def test_every_page_and_report_with_an_rmse_has_the_columns(both: tuple[TestClient, Service]) -> None:
    http, service = both
    made = ended(http, service)
    links = made["links"]
    pages = ["/?all=1", f"/campaigns/{made['id']}", "/trends", "/trends/beside", links["report"]]
    pages.append(f"/compare?a={made['id']}&first=ifem&second=open_loop")
    for address in pages:
        text = http.get(address).text
        for metric, (heading, _) in BESIDE.items():
            assert heading in text, (address, heading)
            assert shown(metric) in text, (address, metric)
    assert "Would yield" in http.get(f"/campaigns/{made['id']}").text


@pytest.mark.slow
def test_the_answers_of_the_api_have_them(both: tuple[TestClient, Service]) -> None:
    http, service = both
    made = ended(http, service)
    cases = http.get(made["links"]["jobs"]).json()["items"]
    assert [(case["beside"], case["outcome"]) for case in cases] == [(VALUES, "missed")] * 4
    rows = list(csv.DictReader(http.get(made["links"]["results"], params={"format": "csv"}).text.splitlines()))
    assert [{metric: float(row[metric]) for metric in BESIDE} for row in rows] == [VALUES] * 4
    body = {"campaigns": [made["id"]], "arms": ["ifem", "open_loop"]}
    (test,) = http.post("/api/v1/comparisons", json=body).json()["comparisons"]
    assert test["beside_first"] == test["beside_second"] == VALUES
    (score, _) = http.get(made["links"]["results"]).json()["scores"]
    assert (score["beside"], score["yielded"]) == (VALUES, 1.0)  # 1234 MPa is past the default of 1030


def case(number: int, **metrics: float | None) -> CaseResult:
    result = {"status": "completed", "metrics": metrics, "timing": {}}
    case = CampaignCase(
        number=number,
        case_id=f"case {number}",
        labels={},
        job_id=None,
        state=None,
        error_kind=None,
        error=None,
        result=result,
    )
    return CaseResult.of(case)


@pytest.mark.parametrize("down", [False, True])
@pytest.mark.parametrize("column", ["rcm", "push", "lateral", "drag", "strain", "stress", "rmse"])
def test_cases_sort_by_them_and_what_is_no_number_comes_last(column: Column, down: bool) -> None:
    values = [2.0, None, 1.0, math.nan, 3.0, math.inf]
    found = sorted_cases([case(i, **{FIELDS[column]: v}) for i, v in enumerate(values)], column, descending=down)
    order = [row.number for row in found]
    assert order[:3] == ([4, 0, 2] if down else [2, 0, 4])
    assert order[3:] == [1, 3, 5]
