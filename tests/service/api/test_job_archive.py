"""All of a job in one archive."""

from __future__ import annotations

import io
import json
import zipfile
from typing import TYPE_CHECKING

import pytest

from service.logs import LOG
from service.store.job import Outcome
from tests.service.http import finish, idle_service

if TYPE_CHECKING:
    from pathlib import Path

API = "/api/v1/jobs"


@pytest.mark.slow
def test_the_archive_of_a_job_has_whatever_there_is_of_it(tmp_path: Path) -> None:
    with idle_service(tmp_path) as (http, service):
        job = http.post(API, json={"scenario": {"name": "whole"}}).json()["id"]
        waits = http.get(f"{API}/{job}/zip")
        assert (waits.status_code, waits.json()["code"]) == (409, "result-pending")
        done = finish(service)
        (service.settings.data / done.folder / LOG).write_text("said\n")
        http.patch(f"{API}/{job}", json={"tags": ["a"], "note": "b"})
        answer = http.get(f"{API}/{job}/zip")
        assert answer.headers["content-type"] == "application/zip"
        assert int(answer.headers["content-length"]) == len(answer.content)
        with zipfile.ZipFile(io.BytesIO(answer.content)) as archive:
            names = set(archive.namelist())
            assert names == {"job.json", "scenario.json", "result.json", "series.npz", "recording.rrd", LOG}
            assert archive.read("recording.rrd") == b"0123456789"
            assert archive.read(LOG) == b"said\n"
            assert json.loads(archive.read("scenario.json"))["name"] == "whole"
            assert json.loads(archive.read("job.json"))["tags"] == ["a"]
            sizes = [one.file_size for one in archive.infolist()]
        page = http.get(f"/jobs/{job}").text
        assert f'href="/api/v1/jobs/{job}/zip"' in page
        assert f"recording.rrd {10} B" in page
        assert sum(sizes) > 0
        (service.settings.data / done.folder / "series.npz").write_bytes(b"changed")
        assert http.get(f"{API}/{job}/zip").json()["code"] == "file-damaged"
        (service.settings.data / done.folder / "series.npz").unlink()
        assert http.get(f"{API}/{job}/zip").json()["code"] == "file-missing"


@pytest.mark.slow
def test_the_archive_of_a_job_that_failed_says_what_was_asked(tmp_path: Path) -> None:
    with idle_service(tmp_path) as (http, service):
        job = http.post(API, json={"scenario": {"name": "broken"}}).json()["id"]
        running = service.store.claim()
        assert running is not None
        service.store.finish(running, Outcome(state="failed", error_kind="exception", error="it broke"))
        with zipfile.ZipFile(io.BytesIO(http.get(f"{API}/{job}/zip").content)) as archive:
            assert set(archive.namelist()) == {"job.json", "scenario.json"}
            assert json.loads(archive.read("job.json"))["error"]["message"] == "it broke"
        assert http.get(f"{API}/0000/zip").status_code == 404
