"""Jobs side by side: what differs between them, and what does not."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from service.recording.observer import RerunObserver
from service.web.side_by_side import fields_apart, numbers
from simcore.scenario.scenario import Scenario
from tests.service.fake_run import FakeRun
from tests.service.http import finish, idle_service
from tests.service.recording.recorded import short, static

if TYPE_CHECKING:
    from pathlib import Path


def test_only_fields_that_differ_are_told_and_a_name_is_none() -> None:
    one = Scenario.load({"name": "a", "tissue": {"young_kpa": 3.0}}).resolved()
    other = Scenario.load({"name": "b", "controller": {"kind": "elm"}}).resolved()
    told = {line.name: line.values for line in fields_apart([one, other])}
    assert told["tissue.young_kpa"] == [3.0, 6.3]
    assert told["controller.kind"] == ["ifem", "elm"]
    assert told["controller.gain"] == [1.0, None]
    assert "name" not in told
    assert "tissue.poisson" not in told
    assert fields_apart([one, one, one]) == []


def test_numbers_stand_below_each_other_with_their_unit() -> None:
    lines = {line.name: line for line in numbers([{"metrics": {"rcm_max_mm": 1.0, "stable": True}}, {}])}
    assert (lines["rcm_max_mm"].values, lines["rcm_max_mm"].unit, lines["rcm_max_mm"].apart) == (
        [1.0, None],
        "mm",
        True,
    )
    same = numbers([{"metrics": {"rcm_max_mm": 1.0}}] * 2)
    assert [line.apart for line in same] == [False]
    assert numbers([{}, {}]) == []


@pytest.mark.slow
def test_the_page_needs_two_insertions_that_there_are(tmp_path: Path) -> None:
    with idle_service(tmp_path) as (http, service):
        ids = [http.post("/api/v1/jobs", json={"scenario": {"name": name}}).json()["id"] for name in ("one", "two")]
        page = http.get("/side-by-side", params={"job": ids})
        assert page.status_code == 200
        assert "None of them has finished." in page.text
        assert "None: the scenarios are the same." in page.text
        finish(service)
        finish(service)
        text = http.get("/side-by-side", params={"job": [ids[1], ids[0], ids[1]]}).text
        assert "they are the same to the last bit" in text
        assert text.index(ids[1]) < text.index(ids[0])
        assert http.get("/side-by-side", params={"job": ids[:1]}).status_code == 404
        assert http.get("/side-by-side", params={"job": [*ids, "0" * 16]}).status_code == 404
        assert http.get("/side-by-side", params={"job": [str(i) for i in range(7)]}).status_code == 422


@pytest.mark.slow
def test_recordings_are_put_together_under_one_address(tmp_path: Path) -> None:
    with idle_service(tmp_path) as (http, service):
        ids = [http.post("/api/v1/jobs", json={"scenario": {"name": "same"}}).json()["id"] for _ in range(2)]
        waiting = http.post("/api/v1/jobs", json={"scenario": {"name": "later"}}).json()["id"]
        for _ in ids:
            job = finish(service)
            found = next(one for one in service.store.artefacts(job.id) if one.name == "recording.rrd")
            with RerunObserver(tmp_path / found.path, recording_id=job.id) as recorder:
                FakeRun(short()).run(recorder)
        page = http.get("/side-by-side", params={"job": ids}).text
        assert f'href="/side-by-side/{ids[0]}-{ids[1]}.rrd"' in page
        answer = http.get(f"/side-by-side/{ids[0]}-{ids[1]}.rrd")
        assert answer.status_code == 200
        both = tmp_path / "both.rrd"
        both.write_bytes(answer.content)
        names = [static(both, f"run{i}/metrics/error")["SeriesLines:names"][0] for i in (1, 2)]
        assert names == ["same (1): tip error, mm", "same (2): tip error, mm"]
        assert http.get(f"/side-by-side/{ids[0]}-{waiting}.rrd").status_code == 404
        assert http.get(f"/side-by-side/{ids[0]}.rrd").status_code == 422
        assert http.get(f"/side-by-side/{ids[0]}-{ids[0]}.rrd").status_code == 422
