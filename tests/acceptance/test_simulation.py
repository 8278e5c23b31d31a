"""The real simulation through the real service, and the commands that a newcomer types."""

from __future__ import annotations

import hashlib
import json
import os
import re
import signal
import socket
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from needlebench import Scenario, run
from service.settings import RUNNER
from simcore.rollout.artefacts import RESULT
from tests.acceptance.server import ROOT, Server, alive, children, running_server, until
from tests.simcore.mesh.test_mesh_file import write_box

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.slow

SHORT: dict[str, Any] = {
    "name": "short",
    "tissue": {"element_size_mm": 10},
    "trajectory": {"kind": "line", "target_mm": [18, 31, 15]},
}
ON_MESH: dict[str, Any] = {
    "name": "on a mesh",
    "tissue": {"fixed_faces": ["y_min", "y_max"]},
    "interaction": {"spacing_mm": 11},
    "trajectory": {"kind": "line", "entry_mm": [10, 20, 0], "target_mm": [11, 21, 15]},
}
LONG = {**SHORT, "name": "long", "dt_s": 0.0005}


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    with running_server(tmp_path_factory.mktemp("data"), runner=RUNNER) as running:
        yield running


def needlebench(*words: str, data: Path, **variables: str) -> subprocess.CompletedProcess[str]:
    kept = {name: value for name, value in os.environ.items() if not name.startswith("NEEDLEBENCH_")}
    environment = {**kept, "NEEDLEBENCH_DATA": str(data), "PYTHONPATH": str(ROOT), **variables}
    command = [sys.executable, "-m", "service.cli", *words]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300, check=False)


def test_a_job_gives_bit_for_bit_what_a_run_in_this_process_gives(server: Server, tmp_path: Path) -> None:
    done = server.client.wait(server.client.submit(SHORT).id)
    assert done.state == "finished", done.error
    assert done.result is not None
    rollout = run(Scenario.load(SHORT))
    assert done.result["digest"] == rollout.digest
    with np.load(server.client.series(done.id, tmp_path / "s.npz")) as series:
        assert np.array_equal(series["tip_m"], rollout.series["tip_m"])
    assert done.progress.fraction == 1.0
    recording = server.client.recording(done.id, tmp_path / "r.rrd").read_bytes()
    assert recording[:4] == b"RRF2"
    stored = json.loads((server.data / "jobs" / done.id / "1" / RESULT).read_text())
    assert stored == done.result


def test_a_job_is_verified_and_its_recording_fetched(server: Server, tmp_path: Path) -> None:
    done = server.client.wait(server.client.submit(SHORT).id)
    told = needlebench("verify", done.id, "--url", server.url, data=tmp_path)
    assert (told.returncode, told.stdout.splitlines()[0]) == (0, "identical: every bit of every state"), told.stderr
    assert server.client.verify(done.id).reproduced
    assert f"digest={(done.result or {})['digest']}" in server.client.log(done.id)
    target = tmp_path / "a.rrd"
    told = needlebench("recording", "fetch", done.id, str(target), "--url", server.url, data=tmp_path)
    assert (told.returncode, told.stdout) == (0, f"{target}\n"), told.stderr
    assert target.read_bytes()[:4] == b"RRF2"


def test_an_uploaded_mesh_gives_bit_for_bit_what_its_file_gives(server: Server, tmp_path: Path) -> None:
    path, _ = write_box(tmp_path, "box.vtu")
    sent = needlebench("upload", str(path), "--url", server.url, data=tmp_path)
    assert sent.returncode == 0, sent.stderr
    reference = sent.stdout.strip()
    assert server.client.upload(path).reference == reference
    file = tmp_path / "on_mesh.json"
    file.write_text(json.dumps(ON_MESH))
    done = needlebench(
        "submit", str(file), "--wait", "--url", server.url, "--set", f"tissue.mesh_file={reference}", data=tmp_path
    )
    assert done.returncode in (0, 3), done.stderr
    local = needlebench(
        "run", str(file), "--out", str(tmp_path / "out"), "--set", f"tissue.mesh_file={path}", data=tmp_path
    )
    assert local.returncode == done.returncode, local.stderr
    result = server.client.job(done.stdout.split()[0]).result
    assert result is not None
    assert result["digest"] == json.loads((tmp_path / "out" / RESULT).read_text())["digest"]
    tissue = result["provenance"]["scenario"]["tissue"]
    assert tissue["mesh_file"] == reference
    assert tissue["mesh_sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()


def test_a_running_simulation_is_cancelled_and_its_recording_kept(server: Server) -> None:
    job = server.client.submit(LONG)
    until(lambda: server.client.job(job.id).progress.step > 100)
    server.client.cancel(job.id)
    done = server.client.wait(job.id, timeout_s=30)
    assert (done.state, done.result) == ("cancelled", None)
    assert (server.data / "jobs" / job.id / "1" / "recording.rrd").stat().st_size > 10_000


def test_a_worker_killed_in_a_simulation_leaves_the_other_untouched(server: Server) -> None:
    victim = server.client.submit({**LONG, "name": "victim"})
    until(lambda: server.client.job(victim.id).progress.step > 10)
    other = server.client.submit(SHORT)
    os.kill(next(pid for pid in children(server.process.pid) if _works_on(pid, victim.id)), signal.SIGKILL)
    until(lambda: server.client.job(victim.id).attempt == 2)
    assert server.client.wait(other.id).attempt == 1
    server.client.cancel(victim.id)


def _works_on(pid: int, job_id: str) -> bool:
    """Whether a process has a file of the job open (Linux)."""
    for link in Path(f"/proc/{pid}/fd").iterdir():
        try:
            if job_id in str(link.readlink()):
                return True
        except OSError:
            continue
    return False


def test_submit_wait_prints_metrics_and_ends_with_the_runs_code(server: Server, tmp_path: Path) -> None:
    file = tmp_path / "short.json"
    file.write_text(json.dumps(SHORT))
    done = needlebench("submit", str(file), "--wait", "--url", server.url, data=tmp_path)
    assert done.returncode == 0, done.stderr
    job_id = done.stdout.split()[0]
    assert "rmse_commanded_mm" in done.stdout
    assert f"{server.url}/recordings/{job_id}.rrd" in done.stdout
    stopped = {**SHORT, "solver": {"max_iterations": 1}}
    file.write_text(json.dumps(stopped))
    assert needlebench("submit", str(file), "--wait", "--url", server.url, data=tmp_path).returncode == 3
    listed = needlebench("jobs", "--url", server.url, data=tmp_path)
    assert job_id in listed.stdout
    shown = needlebench("show", job_id, "--url", server.url, data=tmp_path)
    assert json.loads(shown.stdout)["state"] == "finished"


def test_bad_input_and_no_service_have_their_codes(server: Server, tmp_path: Path) -> None:
    file = tmp_path / "bad.json"
    file.write_text(json.dumps({"dt_s": 5}))
    bad = needlebench("submit", str(file), "--url", server.url, data=tmp_path)
    assert (bad.returncode, "dt_s = 5" in bad.stderr) == (2, True)
    nobody = needlebench("submit", "demo", "--url", "http://127.0.0.1:9", data=tmp_path)
    assert (nobody.returncode, "needlebench serve" in nobody.stderr) == (1, True)
    missing = needlebench("show", "unknown", "--url", server.url, data=tmp_path)
    assert (missing.returncode, "no job unknown" in missing.stderr) == (1, True)


def test_the_demo_ends_with_its_code_and_says_where_the_recording_is(tmp_path: Path) -> None:
    done = needlebench("demo", data=tmp_path, CI="1")
    assert done.returncode == 0, done.stderr
    path = re.search(r"needlebench view (\S+\.rrd)", done.stdout)
    assert path is not None
    assert Path(path[1]).read_bytes()[:4] == b"RRF2"
    assert "rmse_commanded_mm" in done.stdout


def test_the_demo_takes_the_next_port_and_stays_until_ctrl_c(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as holder:
        port = holder.getsockname()[1]
        command = [
            sys.executable,
            "-m",
            "service.cli",
            "demo",
            "--keep",
            "--data",
            str(tmp_path),
            "--port",
            str(port),
        ]
        with subprocess.Popen(
            command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        ) as process:
            assert process.stdout is not None
            told = []
            for line in process.stdout:
                told.append(line)
                if "Ctrl-C ends" in line:
                    break
            family = children(process.pid)
            process.send_signal(signal.SIGINT)
            assert process.wait(timeout=60) == 0
    assert any(f"port {port} is taken: using" in line for line in told)
    assert family
    assert not any(alive(pid) for pid in family)
