"""What those who run a service do with a real one: end it, watch it, clear it, read its log."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from typing import TYPE_CHECKING

import httpx2
import pytest
from prometheus_client.parser import text_string_to_metric_families

from service.client.client import Client, ServiceError
from tests.acceptance.server import ROOT, Server, running_server, until

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.slow


def needlebench(*words: str, data: Path) -> subprocess.CompletedProcess[str]:
    kept = {name: value for name, value in os.environ.items() if not name.startswith("NEEDLEBENCH_")}
    environment = {**kept, "NEEDLEBENCH_DATA": str(data), "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "service.cli", *words]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, check=False)


def test_a_drain_lets_running_jobs_end_refuses_new_ones_and_keeps_the_queue(tmp_path: Path) -> None:
    server = Server(tmp_path, workers=1, drain_s=50)
    running = server.running("some seconds")
    queued = server.client.submit({"name": "quick"})
    server.process.send_signal(signal.SIGTERM)
    until(lambda: server.client._http.get("/readyz").status_code == 503)
    with pytest.raises(ServiceError) as refused:
        server.client.submit({"name": "quick"})
    assert refused.value.status == 503
    assert server.client.job(running.id).state == "running"
    assert server.client.wait(running.id, timeout_s=50).state == "finished"
    assert server.ended() == 0
    with running_server(tmp_path) as again:
        done = again.client.wait(queued.id, timeout_s=60)
        assert (done.state, done.attempt) == ("finished", 1)
        assert again.client.job(running.id).attempt == 1


def test_a_second_signal_ends_the_waiting(tmp_path: Path) -> None:
    server = Server(tmp_path, drain_s=3600)
    job = server.running("long")
    server.process.send_signal(signal.SIGTERM)
    until(lambda: server.client._http.get("/readyz").status_code == 503)
    assert server.stop(signal.SIGTERM) == 0
    with running_server(tmp_path) as again:
        kinds = [item["kind"] for item in again.client._json("GET", f"/api/v1/jobs/{job.id}/events")["items"]]
        assert kinds[:3] == ["queued", "started", "requeued"]
        again.client.cancel(job.id)


def test_a_monitor_sees_jobs_end_and_workers_being_replaced(tmp_path: Path) -> None:
    with running_server(tmp_path) as server:
        server.client.wait(server.client.submit({"name": "quick"}).id)
        job = server.running("long")
        os.kill(server.worker_of(job), signal.SIGKILL)
        until(lambda: server.client.job(job.id).attempt == 2)
        server.client.cancel(job.id)
        server.client.wait(job.id, timeout_s=30)
        until(lambda: figure(server, "needlebench_worker_restarts_total") == 2)
        assert figure(server, "needlebench_job_duration_seconds_count", state="finished") == 1
        assert figure(server, "needlebench_job_duration_seconds_count", state="cancelled") == 1
        assert figure(server, "needlebench_jobs", state="cancelled") == 1


def figure(server: Server, name: str, **labels: str) -> float:
    text = httpx2.get(f"{server.url}/metrics", trust_env=False).text
    samples = (sample for family in text_string_to_metric_families(text) for sample in family.samples)
    return next(sample.value for sample in samples if sample.name == name and sample.labels == labels)


def test_gc_is_done_by_the_service_that_runs_and_without_one_by_the_command(tmp_path: Path) -> None:
    with running_server(tmp_path) as server:
        ids = []
        for _ in range(4):  # one after the other: the order in which they end decides which are the last
            ids.append(server.client.wait(server.client.submit({"name": "quick"}).id).id)
        server.client.pin(ids[0])
        told = needlebench("gc", "--keep-last", "2", "--json", data=tmp_path)
        assert json.loads(told.stdout)["jobs"] == [ids[1]], told.stderr
        with pytest.raises(ServiceError, match="no job"):
            server.client.job(ids[1])
    told = needlebench("gc", "--max-gb", "0", data=tmp_path)
    assert sorted(told.stdout.split()) == sorted(ids[2:])
    assert os.listdir(tmp_path / "jobs") == [ids[0]]


def test_a_job_is_named_tagged_and_found_from_the_command_line(tmp_path: Path) -> None:
    with running_server(tmp_path) as server:
        job, other = (server.client.wait(server.client.submit({"name": "quick"}).id).id for _ in range(2))
        told = needlebench("edit", job, "--name", "soft", "--tag", "liver", "--tag", "paper 2", data=tmp_path)
        assert told.stdout == f"{job} soft [liver, paper 2]\n", told.stderr
        needlebench("edit", job, "--note", "a note", data=tmp_path)
        (line,) = needlebench("jobs", "--tag", "liver", data=tmp_path).stdout.splitlines()
        assert line.startswith(job)
        assert "soft  [liver, paper 2]" in line
        shown = json.loads(needlebench("show", job, data=tmp_path).stdout)
        assert (shown["tags"], shown["note"]) == (["liver", "paper 2"], "a note")
        assert needlebench("edit", job, data=tmp_path).returncode == 2
        needlebench("edit", job, "--no-tags", data=tmp_path)
        assert needlebench("jobs", "--tag", "liver", data=tmp_path).stdout == ""
        outcomes = server.client.act("delete", [job, "0" * 16, other])
        assert [(one.job, one.done, one.code) for one in outcomes][1] == ("0" * 16, False, "job-unknown")
        assert list(server.client.jobs()) == []


def test_one_job_is_pinned_shown_and_unpinned_from_the_command_line(tmp_path: Path) -> None:
    with running_server(tmp_path) as server:
        job = server.client.wait(server.client.submit({"name": "quick"}).id).id
        assert needlebench("pin", job, data=tmp_path).stdout == f"{job} is pinned\n"
        assert server.client.clear(max_bytes=0)["jobs"] == []
        events = needlebench("show", job, "--events", data=tmp_path).stdout.splitlines()
        assert [line.split()[3] for line in events] == ["queued", "started", "finished", "pinned"]
        assert "this is quick" in needlebench("show", job, "--log", data=tmp_path).stdout
        assert json.loads(needlebench("show", job, data=tmp_path).stdout)["pinned"] is True
        assert needlebench("unpin", job, data=tmp_path).returncode == 0
        assert server.client.clear(max_bytes=0)["jobs"] == [job]
        missing = needlebench("pin", job, data=tmp_path)
        assert (missing.returncode, "no job" in missing.stderr) == (1, True)


def test_the_log_of_a_service_is_json_lines_about_jobs_and_requests(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "service.cli", "serve", "--log-format", "json"]
    command += ["--port", "0", "--data", str(tmp_path)]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        lines: list[str] = []
        reader = threading.Thread(target=lambda: lines.extend(process.stderr or ()))
        reader.start()
        url = process.stdout.readline().split()[-1]
        with Client(url) as client:
            job = client.submit({"name": "a", "recording": {"enabled": False}, "dt_s": 0.05})
            client.cancel(job.id)
            client.wait(job.id, timeout_s=60)
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=60) == 0
        reader.join()
    told = [json.loads(line) for line in lines]
    assert {"POST", "GET"} <= {line.get("method") for line in told}
    assert all(line["request_id"] for line in told if "method" in line)


def test_the_doctor_knows_a_folder_in_use(tmp_path: Path) -> None:
    with running_server(tmp_path) as server:
        told = needlebench("doctor", "--json", data=tmp_path)
        found = {check["name"]: check for check in map(json.loads, told.stdout.splitlines())}
        assert server.url in found["service"]["found"]
        assert f"process {server.process.pid}" in found["service"]["found"]
