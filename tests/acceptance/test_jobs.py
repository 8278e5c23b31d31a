"""Jobs through a real server and real worker processes; the simulation is a stand-in."""

from __future__ import annotations

import os
import signal
import threading
from typing import TYPE_CHECKING

import httpx2
import numpy as np
import pytest
from click.testing import CliRunner, Result

from needlebench import Client
from service.cli.main import main
from service.client.client import JobStatus, ServiceError
from tests.acceptance.server import Server, alive, running_server, until

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    with running_server(tmp_path_factory.mktemp("data")) as running:
        yield running


def test_submit_wait_and_fetch(server: Server, tmp_path: Path) -> None:
    seen: list[JobStatus] = []
    done = server.client.wait(server.client.submit({"name": "quick"}).id, progress=seen.append)
    assert (done.state, done.success, done.attempt) == ("finished", True, 1)
    assert done.result == {"status": "completed", "metrics": {"success": True, "rmse_commanded_mm": 0.5, "bad": None}}
    assert seen[-1] == done
    with np.load(server.client.series(done.id, tmp_path / "series.npz")) as series:
        assert series["tip_m"].shape == (2, 3)
    assert server.client.recording(done.id, tmp_path / "a.rrd").read_bytes() == b"step 1\n"


def test_the_command_sent_again_with_its_idempotency_key_makes_no_second_job(server: Server) -> None:
    def sent(*words: str) -> Result:
        return CliRunner().invoke(main, ["submit", "-", "--url", server.url, *words], input='{"name": "quick"}')

    first, second = (sent("--idempotency-key", "night-42") for _ in range(2))
    assert (first.exit_code, first.stdout) == (0, second.stdout)
    assert sent().stdout != first.stdout
    other = sent("--idempotency-key", "night-42", "--priority", "3")
    assert (other.exit_code, "Idempotency-Key" in other.stderr) == (2, True)


def test_a_job_that_raises_has_failed_and_is_not_tried_again(server: Server) -> None:
    done = server.client.wait(server.client.submit({"name": "raises"}).id)
    assert (done.state, done.attempt) == ("failed", 1)
    assert done.error is not None
    assert done.error["kind"] == "exception"
    assert "ValueError: asked to" in done.error["message"]
    log = server.client.log(done.id)
    assert "INFO this is raises\n" in log
    assert "Traceback" in log
    assert [file["name"] for file in server.client.artefacts(done.id)] == ["job.log"]


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("exits", "SystemExit: 3 (fakes.py, line "),
        ("interrupts", "KeyboardInterrupt (fakes.py, line "),
        ("closes", "GeneratorExit (fakes.py, line "),
        ("raises a base", "BaseException: asked to (fakes.py, line "),
        ("raises a surrogate", "ValueError: \\ud800 asked to (fakes.py, line "),
        ("raises a nan", "ValueError: nan (fakes.py, line "),
        ("raises 50 MB", "ValueError: asked toasked to"),
        ("raises the unprintable", "UnprintableError: its message cannot be shown (fakes.py, line "),
        (
            "returns an object",
            "its result cannot be encoded: TypeError: Object of type object is not JSON serializable",
        ),
        ("returns a function", "its result cannot be encoded: TypeError"),
        ("returns a loop", "its result cannot be encoded: RecursionError"),
        ("returns 70 MB", "its result is too long: 70.0 MB, at most 64 are kept"),
    ],
)
def test_whatever_a_job_raises_or_returns_it_has_failed_and_its_slot_goes_on(
    server: Server, name: str, told: str
) -> None:
    again = [server.client.submit({"name": name}).id for _ in range(2)]  # one a slot
    for job in again:
        done = server.client.wait(job, timeout_s=30)
        assert (done.state, done.attempt) == ("failed", 1)
        assert done.error is not None
        assert done.error["kind"] == "exception"
        assert done.error["message"].startswith(told)
        assert len(done.error["message"]) < 3000
    (log,) = (file for file in server.client.artefacts(again[0]) if file["name"] == "job.log")
    assert 0 < log["bytes"] < 11 * 2**20
    after = [server.client.submit({"name": "quick"}).id for _ in range(2)]
    assert [server.client.wait(job, timeout_s=30).state for job in after] == ["finished"] * 2
    assert server.client.ready()["workers"] == 2


def test_progress_that_cannot_be_encoded_is_left_out(server: Server) -> None:
    done = server.client.wait(server.client.submit({"name": "bad progress"}).id, timeout_s=30)
    assert done.state == "finished"


def test_a_running_job_is_cancelled_and_its_worker_gone(server: Server) -> None:
    job = server.running("long")
    pid = server.worker_of(job)
    server.client.cancel(job.id)
    done = server.client.wait(job.id, timeout_s=30)
    assert done.state == "cancelled"
    assert not alive(pid)
    assert server.client.cancel(job.id).state == "cancelled"


def test_a_job_that_takes_too_long_is_timed_out(server: Server) -> None:
    job = server.client.submit({"name": "long"}, timeout_s=1)
    done = server.client.wait(job.id, timeout_s=30)
    assert done.state == "timed_out"
    assert done.error is not None
    assert "timeout_s = 1" in done.error["message"]


def test_a_live_recording_is_followed_to_its_end(server: Server) -> None:
    job = server.running("long")
    received = b""
    with httpx2.Client(trust_env=False) as http, http.stream("GET", f"{server.url}/recordings/{job.id}.rrd") as answer:
        assert answer.headers.get("transfer-encoding") == "chunked"
        for chunk in answer.iter_bytes():
            if received.count(b"step") < 8 <= (received + chunk).count(b"step"):
                threading.Thread(target=server.client.cancel, args=(job.id,)).start()
            received += chunk
    file = server.data / "jobs" / job.id / "1" / "recording.rrd"
    assert received == file.read_bytes()
    assert received.startswith(b"step 1\nstep 2\n")


def test_a_worker_that_dies_costs_its_own_job_one_attempt(server: Server) -> None:
    victim, other = server.running("long"), server.running("long")
    other_pid = server.worker_of(other)
    os.kill(server.worker_of(victim), signal.SIGKILL)
    until(lambda: server.client.job(victim.id).attempt == 2)
    assert (server.client.job(other.id).attempt, server.worker_of(other)) == (1, other_pid)
    assert alive(other_pid)
    for job in (victim, other):
        server.client.cancel(job.id)
        server.client.wait(job.id, timeout_s=30)


def test_a_job_that_kills_its_worker_is_given_up_after_three_attempts(server: Server) -> None:
    done = server.client.wait(server.client.submit({"name": "dies"}).id)
    assert (done.state, done.attempt) == ("failed", 3)
    assert done.error is not None
    assert done.error["kind"] == "worker_died"
    assert "exit code 9" in done.error["message"]


def test_a_job_that_takes_too_much_memory_has_failed_and_the_other_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NEEDLEBENCH_JOB_MEMORY_MB", "700")
    with running_server(tmp_path) as server:
        other = server.running("long")
        pid = server.worker_of(other)
        done = server.client.wait(server.client.submit({"name": "greedy"}).id)
        assert (done.state, done.attempt) == ("failed", 1)
        assert done.error is not None
        assert done.error["kind"] == "out_of_memory"
        assert "at most 700 are allowed" in done.error["message"]
        assert (server.client.job(other.id).attempt, server.worker_of(other)) == (1, pid)
        assert server.client.wait(server.client.submit({"name": "quick"}).id).state == "finished"


def test_a_worker_killed_while_idle_is_replaced(server: Server) -> None:
    until(lambda: server.client.ready()["workers_ready"] == 2)
    done = server.client.wait(server.client.submit({"name": "quick"}).id)
    os.kill(server.worker_of(done), signal.SIGKILL)
    again = [server.client.submit({"name": "quick"}).id for _ in range(4)]
    assert [server.client.wait(job).state for job in again] == ["finished"] * 4


def test_what_the_service_refuses_is_raised_with_its_problems(server: Server) -> None:
    with pytest.raises(ServiceError) as caught:
        server.client.submit({"dt_s": 5})
    assert caught.value.status == 422
    assert str(caught.value).startswith("dt_s = 5: ")
    with pytest.raises(ServiceError, match="there is no job"):
        server.client.job("unknown")


def test_jobs_are_paged_through(server: Server) -> None:
    ids = [server.client.submit({"name": "quick"}, priority=-5).id for _ in range(3)]
    assert [job.id for job in server.client.jobs(limit=3)] == ids[::-1]
    assert list(server.client.scenarios()) == ["demo", "line", "sine", "replay"]


def test_a_proxy_is_not_asked_for_this_machine(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("HTTP_PROXY", "http_proxy", "ALL_PROXY", "all_proxy"):
        monkeypatch.setenv(name, "http://127.0.0.1:9")
    with Client(server.url) as client:
        assert client.ready()["workers"] == 2
