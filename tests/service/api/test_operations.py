"""What an operator reads: metrics, readiness, the doctor's table, copies of the database."""

from __future__ import annotations

import json
import sqlite3
from typing import TYPE_CHECKING, Any

import pytest
from click.testing import CliRunner, Result
from prometheus_client.parser import text_string_to_metric_families

from service.cli.main import main
from service.engine import health_checks as checks
from service.files import disk
from service.recording import web_viewer as viewer_files
from service.store.database import open_database
from tests.service.http import finish, idle_service

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from starlette.testclient import TestClient

    from service.api.context import Service

JOBS = "/api/v1/jobs"


@pytest.fixture
def both(tmp_path: Path) -> Iterator[tuple[TestClient, Service]]:
    with idle_service(tmp_path) as pair:
        yield pair


def figures(http: TestClient) -> dict[str, dict[tuple[str, ...], float]]:
    """Sample name -> label values -> value."""
    found: dict[str, dict[tuple[str, ...], float]] = {}
    for family in text_string_to_metric_families(http.get("/metrics").text):
        for sample in family.samples:
            found.setdefault(sample.name, {})[tuple(sample.labels.values())] = sample.value
    return found


@pytest.mark.slow
def test_metrics_count_jobs_answers_and_room(both: tuple[TestClient, Service]) -> None:
    http, service = both
    for _ in range(3):
        http.post(JOBS, json={"scenario": "line"})
    finish(service)
    http.get(f"{JOBS}/unknown")
    found = figures(http)
    assert found["needlebench_jobs"][("queued",)] == 2
    assert found["needlebench_jobs"][("finished",)] == 1
    assert found["needlebench_jobs"][("timed_out",)] == 0
    assert found["needlebench_queue_length"][()] == 2
    assert found["needlebench_workers"][("slots",)] == 2
    assert found["needlebench_disk_free_bytes"][()] > 0
    answers = found["needlebench_http_answer_seconds_count"]
    assert answers[("POST", JOBS, "202")] == 3
    assert answers[("GET", f"{JOBS}/{{job_id}}", "404")] == 1
    assert "needlebench_build_info" in found
    assert found["process_open_fds"][()] > 0


@pytest.mark.slow
def test_made_up_methods_are_counted_as_one(both: tuple[TestClient, Service]) -> None:
    http, _ = both
    for number in range(5):
        assert http.request(f"BREW{number}", JOBS).status_code == 405
    counted = figures(http)["needlebench_http_answer_seconds_count"]
    assert {labels[0] for labels in counted} <= {"other", "GET"}
    assert sum(count for labels, count in counted.items() if labels[0] == "other") == 5


@pytest.mark.slow
def test_methods_that_a_route_does_not_take_are_counted_as_one(both: tuple[TestClient, Service]) -> None:
    http, _ = both
    for method in ("PUT", "PATCH", "DELETE", "OPTIONS"):
        assert http.request(method, JOBS).status_code == 405
    counted = figures(http)["needlebench_http_answer_seconds_count"]
    assert {labels: count for labels, count in counted.items() if labels[2] == "405"} == {("other", JOBS, "405"): 4}


@pytest.mark.slow
def test_two_services_do_not_share_their_figures(tmp_path: Path) -> None:
    with idle_service(tmp_path / "a") as (one, _), idle_service(tmp_path / "b") as (other, _):
        one.post(JOBS, json={"scenario": "line"})
        assert figures(one)["needlebench_queue_length"][()] == 1
        assert figures(other)["needlebench_queue_length"][()] == 0


def levels(body: dict[str, Any]) -> dict[str, str]:
    return {check["name"]: check["level"] for check in body["checks"]}


@pytest.mark.slow
def test_readiness_names_what_was_looked_at(both: tuple[TestClient, Service]) -> None:
    told = both[0].get("/readyz").json()
    well = {"service": "ok", "workers": "warn", "threads": "ok", "disk": "ok", "data folder": "ok", "database": "ok"}
    assert levels(told) == well
    assert told["warnings"] == ["workers: 0 of 2 workers are warm; wait: they are starting and compiling"]


def test_readiness_warns_of_a_disk_that_runs_short_and_then_refuses(
    both: tuple[TestClient, Service], monkeypatch: pytest.MonkeyPatch
) -> None:
    http, _ = both
    monkeypatch.setattr(checks, "free_bytes", lambda _: 2**30)
    short = http.get("/readyz")
    assert (short.status_code, levels(short.json())["disk"]) == (200, "warn")
    assert any("1.0 GB free; remove old jobs" in text for text in short.json()["warnings"])
    monkeypatch.setattr(checks, "free_bytes", lambda _: 2**20)
    full = http.get("/readyz")
    assert (full.status_code, full.headers["content-type"]) == (503, "application/problem+json")
    assert levels(full.json())["disk"] == "bad"
    assert "no job is started below 256.0 MB" in full.json()["detail"]


@pytest.mark.slow
def test_readiness_warns_when_files_run_short_and_then_refuses(
    both: tuple[TestClient, Service], monkeypatch: pytest.MonkeyPatch
) -> None:
    http, _ = both
    monkeypatch.setattr(checks, "free_bytes", lambda _: 2**40)
    for files, level in ((None, "ok"), (10_000, "ok"), (9_999, "warn"), (1_000, "warn"), (999, "bad"), (0, "bad")):
        monkeypatch.setattr(checks, "free_files", lambda _, files=files: files)
        told = http.get("/readyz")
        assert (told.status_code, levels(told.json())["disk"]) == (503 if level == "bad" else 200, level)
    assert "room for 0 more files (inodes): no job is started below 1000" in told.json()["detail"]


@pytest.mark.slow
def test_readiness_sees_a_database_that_is_locked_and_one_that_is_free_again(
    both: tuple[TestClient, Service],
) -> None:
    http, service = both
    holder = sqlite3.connect(service.settings.database)
    holder.execute("BEGIN IMMEDIATE")
    told = http.get("/readyz")
    assert (told.status_code, levels(told.json())["database"]) == (503, "bad")
    assert "database is locked" in told.json()["detail"]
    holder.close()
    assert http.get("/readyz").status_code == 200


def test_readiness_sees_a_data_folder_that_is_gone(both: tuple[TestClient, Service]) -> None:
    http, service = both
    away = service.settings.data.with_name("away")
    service.settings.data.rename(away)
    told = http.get("/readyz")
    assert (told.status_code, levels(told.json())["data folder"]) == (503, "bad")
    away.rename(service.settings.data)
    assert http.get("/readyz").status_code == 200


@pytest.mark.slow
def test_a_draining_service_refuses_new_work(both: tuple[TestClient, Service]) -> None:
    http, service = both
    job = http.post(JOBS, json={"scenario": "line"}).json()["id"]
    http.post(f"{JOBS}/{job}/cancel")
    service.engine.drain()
    assert http.get("/readyz").status_code == 503
    for path, body in ((JOBS, {"scenario": "line"}), (f"{JOBS}/{job}/retry", None)):
        refused = http.post(path, json=body)
        assert (refused.status_code, refused.headers["retry-after"]) == (503, "10")
    assert http.get(f"{JOBS}/{job}").status_code == 200


def doctor(*words: str) -> Result:
    return CliRunner().invoke(main, ("doctor", *words))


@pytest.mark.slow
def test_the_doctor_finds_a_fresh_place_well_and_changes_nothing(tmp_path: Path) -> None:
    told = doctor("--data", str(tmp_path / "data"), "--json")
    found = {check["name"]: check for check in map(json.loads, told.output.splitlines())}
    assert told.exit_code == 0, told.output
    assert found["database"]["found"] == "will be made"
    assert {found[name]["level"] for name in ("recordings", "viewer", "web viewer")} == {"ok"}
    assert found["web viewer"]["found"].startswith("in the wheel, ")
    assert "examination" not in found
    assert not (tmp_path / "data").exists()


@pytest.mark.slow
def test_the_doctor_finds_a_newer_and_a_broken_database(tmp_path: Path) -> None:
    path = tmp_path / "needlebench.sqlite"
    open_database(path).dispose()
    assert "the newest" in doctor("--data", str(tmp_path)).output
    with sqlite3.connect(path) as connection:
        connection.execute("UPDATE alembic_version SET version_num = '9999'")
    connection.close()
    newer = doctor("--data", str(tmp_path))
    assert (newer.exit_code, "another version of needlebench" in newer.output) == (1, True)
    path.write_bytes(b"no database" * 100)
    broken = doctor("--data", str(tmp_path))
    assert (broken.exit_code, "is damaged" in broken.output) == (1, True)


@pytest.mark.slow
def test_the_doctor_finds_a_full_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checks, "free_bytes", lambda _: 10)
    full = doctor("--data", str(tmp_path))
    assert (full.exit_code, "needlebench gc" in full.output) == (1, True)


@pytest.mark.slow
def test_the_doctor_finds_a_damaged_web_viewer(tmp_path: Path) -> None:
    home = tmp_path / "viewer" / viewer_files.edition()
    home.mkdir(parents=True)
    missing = doctor("--data", str(tmp_path))
    assert (missing.exit_code, f"remove {home}" in missing.output) == (1, True)
    for name in viewer_files.FILES:
        (home / name).write_bytes(viewer_files.WASM)
    assert doctor("--data", str(tmp_path)).exit_code == 0
    (home / viewer_files.PROGRAM).write_bytes(b"<html>")
    damaged = doctor("--data", str(tmp_path))
    assert (damaged.exit_code, "re_viewer_bg.wasm is damaged" in damaged.output) == (1, True)


def test_sizes_are_told_in_words() -> None:
    assert [disk.readable(count) for count in (0, 1023, 1536, 2**20, 5 * 2**30, 3000 * 2**30)] == [
        "0 bytes",
        "1023 bytes",
        "1.5 KB",
        "1.0 MB",
        "5.0 GB",
        "3000.0 GB",
    ]
