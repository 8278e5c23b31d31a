from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import pytest

from service.settings import Limits
from simcore.scenario.presets import preset
from tests.service.http import finish, idle_service

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from starlette.testclient import TestClient

    from service.api.context import Service
    from service.store.job import Job

JOBS = "/api/v1/jobs"


@pytest.fixture
def both(tmp_path: Path) -> Iterator[tuple[TestClient, Service]]:
    with idle_service(tmp_path) as pair:
        yield pair


@pytest.fixture
def http(both: tuple[TestClient, Service]) -> TestClient:
    return both[0]


def submit(http: TestClient, **more: Any) -> dict[str, Any]:
    answer = http.post(JOBS, json={"scenario": "line", **more})
    assert answer.status_code == 202, answer.text
    body: dict[str, Any] = answer.json()
    return body


@pytest.mark.slow
def test_a_submitted_job_is_accepted_and_can_be_read(http: TestClient) -> None:
    answer = http.post(JOBS, json={"scenario": {"name": "mine", "tissue": {"young_kpa": 3}}, "priority": 7})
    job = answer.json()
    assert (answer.status_code, answer.headers["location"]) == (202, f"{JOBS}/{job['id']}")
    assert (job["state"], job["attempt"], job["priority"], job["timeout_s"]) == ("queued", 0, 7, 3600)
    assert job["scenario"]["tissue"]["young_kpa"] == 3.0
    assert job["scenario"]["schema"] == "needlebench/scenario/1"
    measured = {"depth_mm", "tip_error_mm", "cross_track_mm", "insertion_force_n"}
    assert set(job["progress"]) == {"fraction", "step", "steps", "eta_s", *measured}
    assert (job["result"], job["error"]) == (None, None)
    assert http.get(answer.headers["location"]).json() == job


def test_a_built_in_scenario_is_resolved_by_name(http: TestClient) -> None:
    assert submit(http, scenario="replay")["scenario"] == preset("replay").resolved()


@pytest.mark.parametrize("path", ["/etc/passwd", "/no/such/file.msh", "box.vtu"])
def test_a_path_on_the_servers_disk_is_refused_unopened(http: TestClient, path: str) -> None:
    """The answer is the same whether there is such a file or not."""
    answer = http.post(JOBS, json={"scenario": {"tissue": {"mesh_file": path}}})
    assert answer.status_code == 422
    (error,) = answer.json()["errors"]
    assert error["field"] == "tissue.mesh_file"
    assert "not accepted here" in error["message"]


def test_an_idempotency_key_gives_the_same_answer_again(http: TestClient) -> None:
    first, second = (http.post(JOBS, json={"scenario": "line"}, headers={"Idempotency-Key": "k"}) for _ in range(2))
    assert (first.status_code, first.json()) == (second.status_code, second.json())
    other = http.post(JOBS, json={"scenario": "sine"}, headers={"Idempotency-Key": "k"})
    assert (other.status_code, other.json()["errors"][0]["field"]) == (422, "Idempotency-Key")
    assert http.post(JOBS, json={"scenario": "line"}, headers={"Idempotency-Key": ""}).status_code == 422


@pytest.mark.parametrize("key", ["", "k" * 201])
def test_an_empty_or_long_idempotency_key_is_422(http: TestClient, key: str) -> None:
    answer = http.post(JOBS, json={"scenario": "line"}, headers={"Idempotency-Key": key})
    assert (answer.status_code, answer.headers["content-type"]) == (422, "application/problem+json")


@pytest.mark.slow
def test_past_the_queue_limit_jobs_are_refused_for_now(tmp_path: Path) -> None:
    with idle_service(tmp_path / "full", limits=Limits(queue=2)) as (http, service):
        known = {"Idempotency-Key": "k"}
        first = http.post(JOBS, json={"scenario": "line"}, headers=known).json()
        submit(http)
        answer = http.post(JOBS, json={"scenario": "line"})
        assert (answer.status_code, answer.headers["content-type"]) == (429, "application/problem+json")
        assert int(answer.headers["retry-after"]) > 0
        assert "2 jobs are queued, at most 2" in answer.json()["detail"]
        assert http.post(JOBS, json={"scenario": "line"}, headers=known).json() == first
        finish(service)
        submit(http)


def test_one_key_cannot_fill_the_queue(tmp_path: Path) -> None:
    with idle_service(tmp_path / "keys", limits=Limits(queue_per_key=1)) as (http, service):
        one, two = ({"Authorization": f"Bearer {service.keys.create(scope='submit')[1]}"} for _ in range(2))
        codes = [http.post(JOBS, json={"scenario": "line"}, headers=by).status_code for by in (one, one, two)]
    assert codes == [202, 429, 202]


def test_a_draining_service_takes_nothing_more(both: tuple[TestClient, Service]) -> None:
    http, service = both
    service.changes.close()
    upload = http.post("/api/v1/uploads", params={"kind": "model", "name": "a.json"}, content=b"{}")
    for answer in (http.post(JOBS, json={"scenario": "line"}), upload):
        assert (answer.status_code, answer.headers["content-type"]) == (503, "application/problem+json")
        assert int(answer.headers["retry-after"]) > 0
    assert http.get(JOBS).status_code == 200


def test_jobs_are_listed_by_page_and_by_state(http: TestClient) -> None:
    ids = [submit(http)["id"] for _ in range(3)]
    page = http.get(JOBS, params={"limit": 2}).json()
    assert [item["id"] for item in page["items"]] == [ids[2], ids[1]]
    rest = http.get(JOBS, params={"limit": 2, "cursor": page["next_cursor"]}).json()
    assert ([item["id"] for item in rest["items"]], rest["next_cursor"]) == ([ids[0]], None)
    assert "scenario" not in rest["items"][0]
    http.post(f"{JOBS}/{ids[0]}/cancel")
    assert [item["id"] for item in http.get(JOBS, params={"state": "cancelled"}).json()["items"]] == [ids[0]]


def test_an_unchanged_job_is_304(both: tuple[TestClient, Service]) -> None:
    http, service = both
    url = f"{JOBS}/{submit(http)['id']}"
    tag = http.get(url).headers["etag"]
    assert http.get(url, headers={"If-None-Match": tag}).status_code == 304
    finish(service)
    changed = http.get(url, headers={"If-None-Match": tag}, params={"wait": 30})
    assert (changed.status_code, changed.json()["state"]) == (200, "finished")
    assert changed.headers["etag"] != tag


@pytest.mark.slow
def test_a_long_poll_ends_after_its_time(http: TestClient) -> None:
    job = submit(http)
    assert http.get(f"{JOBS}/{job['id']}", params={"wait": 0.2}).json()["state"] == "queued"


@pytest.mark.slow
def test_a_long_poll_misses_no_change(both: tuple[TestClient, Service], monkeypatch: pytest.MonkeyPatch) -> None:
    http, service = both
    job_id = http.post(JOBS, json={"scenario": "line"}).json()["id"]
    get = service.store.get

    def then_cancelled(asked: str) -> Job:
        """The job as it is, and a change before the one who asks can act on it."""
        found = get(asked)
        if not found.terminal:
            service.store.cancel(asked)
            time.sleep(0.2)
        return found

    monkeypatch.setattr(service.store, "get", then_cancelled)
    assert http.get(f"{JOBS}/{job_id}?wait=30").json()["state"] == "cancelled"


def test_a_job_is_cancelled_once_and_more(http: TestClient) -> None:
    url = f"{JOBS}/{submit(http)['id']}"
    assert http.delete(url).status_code == 409
    for _ in range(2):
        answer = http.post(f"{url}/cancel")
        assert (answer.status_code, answer.json()["state"]) == (202, "cancelled")
    assert http.delete(url).status_code == 204
    assert http.get(url).status_code == 404


@pytest.mark.slow
def test_a_finished_job_shows_what_it_left(both: tuple[TestClient, Service]) -> None:
    http, service = both
    url = f"{JOBS}/{submit(http)['id']}"
    for part in ("metrics", "series"):
        assert http.get(f"{url}/{part}").status_code == 409
    finish(service)
    assert http.get(f"{url}/metrics").json()["metrics"] == {"success": True, "rmse_commanded_mm": 0.5}
    items = http.get(f"{url}/artefacts").json()["items"]
    assert [item["name"] for item in items] == ["recording.rrd", "result.json", "series.npz"]
    for item in items:
        assert len(http.get(item["url"]).content) == item["bytes"]
    assert http.post(f"{url}/cancel").status_code == 409
    assert http.delete(url).status_code == 204
    assert list(service.settings.jobs.iterdir()) == []


def test_a_cancelled_job_has_no_series(http: TestClient) -> None:
    url = f"{JOBS}/{submit(http)['id']}"
    http.post(f"{url}/cancel")
    assert http.get(f"{url}/series").status_code == 404


@pytest.mark.slow
@pytest.mark.parametrize("name", ["other.txt", "..%2f..%2fneedlebench.sqlite", "%2e%2e/series.npz", "progress.json"])
def test_only_registered_files_can_be_fetched(both: tuple[TestClient, Service], name: str) -> None:
    http, service = both
    url = f"{JOBS}/{submit(http)['id']}"
    finish(service)
    assert http.get(f"{url}/artefacts/{name}").status_code == 404


@pytest.mark.slow
def test_series_come_in_three_formats(both: tuple[TestClient, Service]) -> None:
    http, service = both
    url = f"{JOBS}/{submit(http)['id']}/series"
    finish(service)
    assert http.get(url).json() == {"t_s": [0.0, None], "tip_m": [[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]]}
    csv = http.get(url, headers={"Accept": "text/csv"})
    assert csv.headers["content-type"].startswith("text/csv")
    assert csv.text.splitlines() == ["t_s,tip_m_x,tip_m_y,tip_m_z", "0.0,0.0,1.0,2.0", "nan,3.0,4.0,5.0"]
    assert http.get(url, params={"format": "npz"}).content[:2] == b"PK"
    assert http.get(url, params={"names": "tissue_rest_m"}).json() == {"tissue_rest_m": [[0.0] * 3] * 5}
    assert http.get(url, params={"names": "tissue_rest_m,t_s", "format": "csv"}).status_code == 422
    unknown = http.get(url, params={"names": "tip"})
    assert unknown.status_code == 422
    assert "tip_m" in unknown.json()["errors"][0]["message"]


@pytest.mark.slow
def test_a_complete_recording_has_ranges_and_a_tag(both: tuple[TestClient, Service]) -> None:
    http, service = both
    url = f"/recordings/{submit(http)['id']}.rrd"
    finish(service)
    whole = http.get(url)
    assert (whole.status_code, whole.content) == (200, b"0123456789")
    part = http.get(url, headers={"Range": "bytes=2-4"})
    assert (part.status_code, part.content) == (206, b"234")
    assert http.get(url, headers={"If-None-Match": whole.headers["etag"]}).status_code == 304


@pytest.mark.slow
@pytest.mark.parametrize(("asked", "status"), [("bytes=99-", 416), ("bytes=x", 400)])
def test_a_range_that_cannot_be_given_is_a_problem(both: tuple[TestClient, Service], asked: str, status: int) -> None:
    http, service = both
    job = http.post(JOBS, json={"scenario": "line"}).json()
    finish(service)
    for path in (f"/recordings/{job['id']}.rrd", f"{JOBS}/{job['id']}/artefacts/recording.rrd"):
        answer = http.get(path, headers={"Range": asked})
        assert (answer.status_code, answer.headers["content-type"]) == (status, "application/problem+json")
        assert (answer.json()["status"], answer.json()["instance"]) == (status, path)
        assert answer.headers.get("content-range") == ("bytes */10" if status == 416 else None)


def test_a_job_without_recording_says_so(both: tuple[TestClient, Service]) -> None:
    http, service = both
    job = submit(http, scenario={"recording": {"enabled": False}})
    finish(service, files=False)
    answer = http.get(f"/recordings/{job['id']}.rrd")
    assert answer.status_code == 404
    assert "recording.enabled" in answer.json()["detail"]


@pytest.mark.slow
def test_built_in_scenarios_are_a_start_for_others(http: TestClient) -> None:
    items = http.get("/api/v1/scenarios").json()["items"]
    assert [item["name"] for item in items] == ["demo", "line", "sine", "replay"]
    assert http.get("/api/v1/scenarios/sine").json() == items[2]
    assert http.get("/api/v1/scenarios/none").status_code == 404
    coarse = {**items[1]["scenario"], "tissue": {"element_size_mm": 10}}
    assert submit(http, scenario=coarse)["scenario"]["interaction"]["spacing_mm"] == 3.0
    hard = {**coarse, "interaction": {**coarse["interaction"], "line_compliance": False}}
    assert submit(http, scenario=hard)["scenario"]["interaction"]["spacing_mm"] == 10.0


def test_health_readiness_and_version(both: tuple[TestClient, Service]) -> None:
    http, service = both
    assert http.get("/healthz").json() == {"status": "ok"}
    assert http.get("/readyz").json()["status"] == "starting"
    assert http.get("/version").json()["scenario_schema"] == "needlebench/scenario/1"
    service.changes.close()
    assert http.get("/readyz").status_code == 503
    refused = http.post(JOBS, json={"scenario": "line"})
    assert (refused.status_code, refused.headers["retry-after"]) == (503, "10")
