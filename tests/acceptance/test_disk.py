"""A disk that is full or read-only, a database that is locked, a clock that is set back: told clearly, nothing is
broken, and it goes on when it is mended. The disks are real ones, in memory (Linux, as root)."""

from __future__ import annotations

import os
import sqlite3
import subprocess
import sys
import time
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import pytest

from service.client.client import ServiceError
from service.server.server import ServiceStartError, serve
from service.settings import Settings
from service.worker import attempt as worker
from tests.acceptance.server import Server, running_server, until

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytestmark = pytest.mark.slow


def mount(*words: str) -> bool:
    return subprocess.run(["mount", *words], capture_output=True, check=False).returncode == 0


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 16 MB of its own."""
    folder = tmp_path / "disk"
    folder.mkdir()
    if sys.platform != "linux" or os.geteuid() != 0 or not mount("-t", "tmpfs", "-o", "size=16m", "tmpfs", str(folder)):
        pytest.skip("mounting a disk needs root on Linux")
    yield folder
    subprocess.run(["umount", "--lazy", str(folder)], check=True)


def fill(disk: Path) -> Path:
    """A file that takes all that is left."""
    filler = disk / "filler"
    with filler.open("wb", buffering=0) as file:
        for size in (65536, 4096, 512, 1):
            try:
                while file.write(b"x" * size):
                    pass
            except OSError:
                continue
    return filler


def submit_many(server: Server) -> None:
    for _ in range(50):
        server.client.submit({"name": "quick"}, priority=-100)


def check_whole(database: Path) -> None:
    with sqlite3.connect(database) as connection:
        assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
    connection.close()


def level(server: Server, name: str) -> str:
    """Of one check, whether the service is ready or not."""
    answer = server.client._http.get("/readyz").json()
    return str(next(check["level"] for check in answer["checks"] if check["name"] == name))


def test_a_full_disk_is_told_and_nothing_is_lost(small_disk: Path) -> None:
    with running_server(small_disk, minimum_free_mb=0) as server:
        kept = server.client.wait(server.client.submit({"name": "quick"}).id)
        running = server.running("long")
        filler = fill(small_disk)
        with pytest.raises(ServiceError, match="full") as refused:
            submit_many(server)  # the database may have some room of its own left
        assert refused.value.status == 503
        assert level(server, "disk") in ("warn", "bad")
        assert server.client.job(kept.id).result == kept.result
        filler.unlink()
        ended = server.client.wait(running.id, timeout_s=120)
        if ended.state == "failed":  # it wrote while there was no room
            assert (ended.error or {})["kind"] == "disk"
            assert "No space left" in (ended.error or {})["message"]
        later = server.client.submit({"name": "quick"}, priority=100)
        assert server.client.wait(later.id, timeout_s=120).state == "finished"
        until(lambda: level(server, "database") == "ok")
    check_whole(small_disk / "needlebench.sqlite")


def test_no_job_is_begun_without_room_and_all_are_when_there_is(small_disk: Path) -> None:
    with running_server(small_disk, minimum_free_mb=32) as server:
        job = server.client.submit({"name": "quick"})
        until(lambda: server.client._http.get("/readyz").status_code == 503)
        told = server.client._http.get("/readyz").json()
        assert "no job is started below 32.0 MB" in told["detail"]
        assert "needlebench gc" in str(told["checks"])
        assert server.client.job(job.id).state == "queued"
        assert mount("-o", "remount,size=64m", str(small_disk))
        assert server.client.wait(job.id, timeout_s=60).state == "finished"
        until(lambda: level(server, "disk") == "warn")


def test_no_job_is_begun_or_fails_without_room_for_files_and_all_are_begun_when_there_is(small_disk: Path) -> None:
    assert mount("-o", "remount,nr_inodes=1500", str(small_disk))
    with running_server(small_disk, minimum_free_mb=0) as server:
        until(lambda: level(server, "workers") == "ok")
        fillers = []
        with suppress(OSError):
            for number in range(1500):
                fillers.append(small_disk / f"filler {number}")
                fillers[-1].touch()
        until(lambda: server.client._http.get("/readyz").json()["status"] == 503)
        assert "0 more files (inodes): no job is started below 1000" in server.client._http.get("/readyz").text
        time.sleep(1.5)  # an idle slot looks at the disk every half second
        jobs = [server.client.submit({"name": "quick"}).id for _ in range(5)]
        time.sleep(2.0)
        assert [server.client.job(job).state for job in jobs] == ["queued"] * 5
        for filler in fillers:
            filler.unlink(missing_ok=True)
        assert [server.client.wait(job, timeout_s=60).state for job in jobs] == ["finished"] * 5
        assert [server.client.job(job).attempt for job in jobs] == [1] * 5


def test_a_read_only_data_folder_is_refused_and_served_when_it_can_be_written(small_disk: Path) -> None:
    with running_server(small_disk) as server:
        kept = server.client.submit({"name": "long"})
    assert mount("-o", "remount,ro", str(small_disk))
    with pytest.raises(ServiceStartError, match=r"cannot be used: Read-only file system.*--data"):
        serve(Settings(data=small_disk, port=0), announce=print)
    assert mount("-o", "remount,rw", str(small_disk))
    check_whole(small_disk / "needlebench.sqlite")
    with running_server(small_disk, minimum_free_mb=0) as again:
        until(lambda: again.client.job(kept.id).progress.step > 0)
        again.client.cancel(kept.id)


def test_a_locked_database_is_told_and_a_running_job_goes_on(tmp_path: Path) -> None:
    with running_server(tmp_path) as server:
        job = server.running("long")
        holder = sqlite3.connect(tmp_path / "needlebench.sqlite", isolation_level=None)
        holder.execute("BEGIN IMMEDIATE")
        before = server.client.job(job.id)
        with pytest.raises(ServiceError, match="locked") as refused:
            server.client.submit({"name": "quick"})
        assert refused.value.status == 503
        assert level(server, "database") == "bad"
        holder.rollback()
        holder.close()
        until(lambda: server.client.job(job.id).progress.step > before.progress.step)
        assert server.client.job(job.id).attempt == 1
        assert server.client.wait(server.client.submit({"name": "quick"}).id, timeout_s=60).state == "finished"
        server.client.cancel(job.id)


def test_results_are_whole_or_not_there_when_the_disk_fills_while_they_are_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any, **__: Any) -> None:
        raise OSError(28, os.strerror(28))

    monkeypatch.setattr("numpy.savez", full)
    spec = {"scenario": {"name": "quick"}, "job_id": "a"}
    report = worker.execute("tests.acceptance.fakes:run_job", spec, str(tmp_path / "1"))
    assert (report.result, report.error_kind) == (None, "disk")
    assert {file["name"] for file in report.artefacts} == {"recording.rrd", "job.log"}
    monkeypatch.undo()
    again = worker.execute("tests.acceptance.fakes:run_job", spec, str(tmp_path / "2"))
    assert again.error is None
