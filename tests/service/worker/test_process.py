from __future__ import annotations

import os
import threading
import time
from concurrent.futures import wait
from typing import TYPE_CHECKING

import pytest

from service.worker.process import WorkerDiedError, WorkerProcess, answer
from service.worker.specs import AttemptReport, InsertionSpec, TrainingSpec
from tests.acceptance.server import alive

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

RUNNER = "tests.service.many_runner:insertion"


@pytest.fixture
def worker(tmp_path: Path) -> Iterator[WorkerProcess]:
    made = WorkerProcess(RUNNER, tmp_path / "lock")
    made.start()
    yield made
    made.kill()
    assert not made.alive


def warm(worker: WorkerProcess) -> int:
    end = time.monotonic() + 60
    while not worker.ready(1.0):
        assert time.monotonic() < end
    assert worker.pid is not None
    return worker.pid


def collected(worker: WorkerProcess) -> AttemptReport:
    assert worker.wait(60)
    return worker.collect()


def spec(name: str, folder: Path) -> InsertionSpec:
    return InsertionSpec(job_id="a", scenario={"name": name}, files=folder)


@pytest.mark.slow
def test_calls_are_answered_in_their_order_by_one_process(worker: WorkerProcess) -> None:
    calls = [worker.call(os.getpid), worker.call(abs, -2), worker.call(os.getpid)]
    first, two, last = [call.result(timeout=60) for call in calls]
    assert (first, two) == (last, 2)
    assert first == warm(worker) != os.getpid()


@pytest.mark.slow
def test_what_is_raised_there_is_raised_here_and_the_worker_goes_on(worker: WorkerProcess) -> None:
    with pytest.raises(ValueError, match="invalid literal"):
        worker.call(int, "x").result(timeout=60)
    with pytest.raises(TypeError, match="pickle"):
        worker.call(threading.Lock).result(timeout=60)
    assert worker.call(abs, -3).result(timeout=60) == 3


@pytest.mark.slow
def test_a_death_is_told_to_who_waits_and_to_who_asks_later(worker: WorkerProcess) -> None:
    warm(worker)
    call = worker.call(os._exit, 7)
    wait([call], timeout=60)
    with pytest.raises(WorkerDiedError, match=r"died \(exit code 7\)"):
        answer(call)
    worker.kill()
    assert not worker.alive
    with pytest.raises(WorkerDiedError, match="gone"):
        worker.call(abs, -1)


@pytest.mark.slow
def test_an_attempt_is_sent_awaited_and_collected(worker: WorkerProcess, tmp_path: Path) -> None:
    pid = warm(worker)
    assert worker.pending is None
    worker.send(RUNNER, spec("ok", tmp_path), tmp_path / "1")
    report = collected(worker)
    assert (report.result["pid"], report.error) == (pid, None)
    worker.send(RUNNER, spec("raises", tmp_path), tmp_path / "2")
    failed = collected(worker)
    assert (failed.result, failed.error_kind) == (None, "exception")
    assert (failed.error or "").startswith("ValueError: no good")
    assert worker.ready()


@pytest.mark.slow
def test_a_death_ends_the_waiting_and_a_start_replaces_the_process(worker: WorkerProcess, tmp_path: Path) -> None:
    pid = warm(worker)
    worker.send(RUNNER, spec("dies", tmp_path), tmp_path / "1")
    with pytest.raises(WorkerDiedError, match="its worker process died"):
        collected(worker)
    worker.start()
    assert warm(worker) != pid
    assert worker.starts == 2


@pytest.mark.slow
def test_a_kill_ends_the_process_in_the_middle_of_an_attempt(worker: WorkerProcess, tmp_path: Path) -> None:
    pid = warm(worker)
    worker.send(RUNNER, spec("sleeps", tmp_path), tmp_path / "1")
    assert not worker.wait(0.1)
    worker.kill()
    assert (worker.pid, worker.pending, alive(pid)) == (None, None, False)


def test_a_specification_is_read_as_it_was_written(tmp_path: Path) -> None:
    insertion = InsertionSpec(job_id="a", scenario={"x": 1}, files=tmp_path, names="paths", full_series=False)
    assert InsertionSpec.from_json(insertion.to_json()) == insertion
    training = TrainingSpec(job_id="a", training={"kind": "elm"}, files=tmp_path)
    assert TrainingSpec.from_json(training.to_json()) == training


def test_names_in_scenarios_mean_uploads_or_paths(tmp_path: Path) -> None:
    from simcore.errors import ScenarioError
    from simcore.file_names import located

    (tmp_path / "mesh.msh").write_text("")
    with InsertionSpec(job_id="a", scenario={}, files=tmp_path, names="paths").file_names():
        assert located("tissue.mesh_file", "mesh.msh") == tmp_path / "mesh.msh"
    with spec("ok", tmp_path).file_names(), pytest.raises(ScenarioError, match="needlebench upload"):
        located("tissue.mesh_file", "mesh.msh")
