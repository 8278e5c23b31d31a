"""A named suite as a campaign, by real insertions through a real server: to its report and into its trend."""

from __future__ import annotations

import csv
import io
from typing import TYPE_CHECKING

import httpx2
import pytest

from benchmarks.suites.catalogue import suite
from service.settings import RUNNER
from tests.acceptance.server import running_server, until

if TYPE_CHECKING:
    from pathlib import Path

NAME = "lin100-v2-smoke"


@pytest.mark.slow
def test_a_suite_runs_to_its_report_and_into_its_trend(tmp_path: Path) -> None:
    cases = suite(NAME).cases
    with running_server(tmp_path, runner=RUNNER) as server, httpx2.Client(base_url=server.url, timeout=60) as http:
        made = http.post("/api/v1/campaigns", json={"suite": NAME}).json()
        links = made["links"]
        assert (made["cases"], made["suite_sha256"]) == (len(cases), suite(NAME).sha256)
        until(lambda: http.get(links["self"]).json()["state"] == "done", patience_s=900, pause_s=0.5)
        assert http.get(links["self"]).json()["jobs"] == {"finished": len(cases)}

        lines = list(csv.DictReader(io.StringIO(http.get(f"{links['results']}?format=csv").text)))
        assert [line["id"] for line in lines] == sorted(case.id for case in cases)
        assert all(line["status"] == "completed" for line in lines if line["arm"] in ("ifem", "open_loop")), lines
        assert all(float(line["rmse_commanded_mm"]) > 0 for line in lines if line["stable"] == "yes")
        report = http.get(links["results"]).json()
        assert {score["arm"] for score in report["scores"]} == {case.labels["arm"] for case in cases}
        assert len(report["claims"]) == 11
        page = http.get(links["report"])
        assert page.headers["content-type"].startswith("text/html")
        assert NAME in page.text

        (point,) = http.get(f"/api/v1/trends/{NAME}").json()["points"]
        assert (point["campaign"], point["cases"]) == (made["id"], len(cases))
        assert point["median_rmse_mm"] > 0
        assert point["step_ms"] > 0
        assert point["commit"] == report["provenance"]["commit"]
