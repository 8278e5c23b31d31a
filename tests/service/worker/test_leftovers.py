"""Whatever a job starts ends with it, wherever it went; what it prints by descriptor is in its log."""

from __future__ import annotations

import os
import resource
import sys
from typing import TYPE_CHECKING

import pytest

from service.engine.attempt_watch import AttemptWatch
from service.logs import FULL, LOG, MAXIMUM_BYTES
from service.worker.leftovers import Belongings, end_leftovers
from service.worker.process import WorkerDiedError, WorkerProcess
from service.worker.processes import descendants, session_members
from service.worker.specs import AttemptReport, InsertionSpec
from tests.acceptance.server import alive, until

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="reads the process table")
RUNNER = "tests.service.worker.leaving_runner:insertion"


@pytest.fixture(scope="module")
def worker(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WorkerProcess]:
    made = WorkerProcess(RUNNER, tmp_path_factory.mktemp("worker") / "lock")
    yield made
    made.kill()


def begin(worker: WorkerProcess, folder: Path, name: str, *, plugin: bool = False) -> int:
    """Send the job to a warm worker; the process id of that."""
    if not worker.alive:
        worker.start()
    until(lambda: worker.ready(1.0))
    assert worker.pid is not None
    scenario = {"name": name, "controller": {"kind": "plugin" if plugin else "ifem"}}
    worker.send(RUNNER, InsertionSpec(job_id="a", scenario=scenario, files=folder), folder / "1")
    return worker.pid


def run(worker: WorkerProcess, folder: Path, name: str, *, plugin: bool = False) -> AttemptReport:
    begin(worker, folder, name, plugin=plugin)
    assert worker.wait(60)
    report = worker.collect()
    if report.leftovers:
        worker.kill()
    return report


def test_a_library_that_a_plug_in_imports_costs_no_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """scikit-learn and joblib set a variable for OpenMP each, which is no other environment for anybody."""
    before = Belongings.now()
    monkeypatch.setenv("KMP_DUPLICATE_LIB_OK", "another value")
    monkeypatch.setenv("KMP_INIT_AT_FORK", "another value")
    assert end_leftovers(before, strict=True) == ()
    monkeypatch.setenv("ANOTHER", "value")
    assert end_leftovers(before, strict=True) == ("another environment",)


def started(folder: Path) -> int:
    pids = folder / "1" / "pids"
    until(pids.exists)
    return int(pids.read_text())


@pytest.mark.slow
@pytest.mark.parametrize("name", ["forks", "forks apart"])
def test_a_forked_child_ends_with_its_job(worker: WorkerProcess, tmp_path: Path, name: str) -> None:
    report = run(worker, tmp_path, name)
    assert not alive(started(tmp_path))
    assert (report.error, report.leftovers) == (None, ("1 process",))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "left"), [("thread", "1 thread"), ("descriptor", "1 descriptor")])
def test_what_a_plug_in_leaves_in_its_process_is_reported(
    worker: WorkerProcess, tmp_path: Path, name: str, left: str
) -> None:
    assert run(worker, tmp_path, name, plugin=True).leftovers == (left,)
    assert left in (tmp_path / "1" / LOG).read_text()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "left"),
    [
        ("folder", "another folder"),
        ("environment", "another environment"),
        ("signals", "another signal handler"),
        ("output", "another stream or hook"),
        ("mask", "another file mode mask"),
        ("alarm", "another alarm"),
        ("limit", "another limit"),
        ("modules", "another path of modules"),
    ],
)
def test_what_a_plug_in_changed_for_its_whole_process_is_reported(
    worker: WorkerProcess, tmp_path: Path, name: str, left: str
) -> None:
    if name == "limit" and resource.getrlimit(resource.RLIMIT_CORE) == (0, 0):
        pytest.skip("the limit is what the job would make it")
    report = run(worker, tmp_path, name, plugin=True)
    assert (report.error, report.leftovers) == (None, (left,))


def test_a_plug_in_that_closes_its_output_or_raises_what_cannot_be_shown_just_ends(
    worker: WorkerProcess, tmp_path: Path
) -> None:
    assert run(worker, tmp_path / "a", "closes", plugin=True).error is None
    report = run(worker, tmp_path / "b", "hostile", plugin=True)
    assert (report.error_kind, (report.error or "").partition(":")[0]) == ("exception", "ValueError")


@pytest.mark.slow
def test_a_job_that_leaves_nothing_keeps_its_process(worker: WorkerProcess, tmp_path: Path) -> None:
    first, second = (run(worker, tmp_path, "nothing", plugin=True) for _ in range(2))
    assert first.result["pid"] == second.result["pid"]
    assert first.leftovers == second.leftovers == ()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["forks and exits", "nothing and exits"])
def test_a_job_that_ends_its_process_with_code_0_is_a_death(worker: WorkerProcess, tmp_path: Path, name: str) -> None:
    pid = begin(worker, tmp_path, name)
    with pytest.raises(WorkerDiedError, match=r"ended \(exit code 0\)"):
        until(lambda: worker.wait(0.2))
    worker.kill()
    assert not session_members(pid)
    if name.startswith("forks"):
        assert not alive(started(tmp_path))


@pytest.mark.slow
def test_a_child_that_has_gone_apart_ends_when_its_job_is_cut_short(worker: WorkerProcess, tmp_path: Path) -> None:
    begin(worker, tmp_path, "forks apart and waits")
    child = started(tmp_path)
    assert alive(child)
    worker.kill()
    until(lambda: not alive(child))


@pytest.mark.slow
def test_the_group_ends_with_a_worker_that_was_killed(worker: WorkerProcess, tmp_path: Path) -> None:
    pid = begin(worker, tmp_path, "hoards in a child")
    child = started(tmp_path)
    os.kill(pid, 9)  # nobody but the guard is there to see to it
    until(lambda: not alive(child) and not session_members(pid))
    worker.kill()


@pytest.mark.slow
def test_memory_of_a_child_counts(worker: WorkerProcess, tmp_path: Path) -> None:
    begin(worker, tmp_path, "hoards in a child")
    started(tmp_path)
    held_mb = worker.held_mb()
    assert held_mb is not None
    ending = AttemptWatch(0.0, 600.0, 400).ending(0.0, cancelled=False, held_mb=held_mb)
    assert ending is not None
    assert ending.error_kind == "out_of_memory"
    assert held_mb < 400 * 2**20 / 1e6 + 400  # what a child shares with its parent is counted once
    worker.kill()


@pytest.mark.slow
def test_what_is_printed_by_descriptor_is_in_the_log(worker: WorkerProcess, tmp_path: Path) -> None:
    report = run(worker, tmp_path, "says")
    lines = [line.partition(" INFO ")[2] for line in (tmp_path / "1" / LOG).read_text().splitlines()]
    assert sorted(lines) == ["by Python, without an end", "by descriptor", "in error"]
    assert report.leftovers == ()
    [described] = [file for file in report.artefacts if file["name"] == LOG]
    assert described["bytes"] == (tmp_path / "1" / LOG).stat().st_size


@pytest.mark.slow
def test_a_flood_is_cut(worker: WorkerProcess, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    report = run(worker, tmp_path, "floods", plugin=True)
    assert (report.error, report.leftovers) == (None, ())
    log = (tmp_path / "1" / LOG).read_text()
    assert len(log) < MAXIMUM_BYTES + 1000
    assert log.endswith(f"{FULL}\n")
    assert not capfd.readouterr().out


@pytest.mark.slow
def test_an_idle_worker_has_nobody_but_its_guard(worker: WorkerProcess, tmp_path: Path) -> None:
    run(worker, tmp_path, "nothing")
    assert worker.pid is not None
    [guard] = descendants(worker.pid)
    assert os.getsid(guard.pid) == worker.pid
