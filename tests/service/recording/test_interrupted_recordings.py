"""A recording stays readable, and the run goes on, whatever happens to the process or the disk."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from service.recording import observer as recording
from service.recording.blocks import BLOCK_STEPS
from service.recording.observer import RerunObserver, optimize
from service.worker.attempt import ObserverGroup
from tests.service.fake_run import FakeRollout, FakeRun
from tests.service.recording.recorded import STEPS, Keeper, recorded, short

if TYPE_CHECKING:
    from simcore.rollout.records import StepRecord


@pytest.mark.slow
def test_a_run_that_raises_leaves_a_readable_recording(tmp_path: Path) -> None:
    path = tmp_path / "recording.rrd"
    with pytest.raises(RuntimeError, match="stop here"), RerunObserver(path, recording_id="r") as recorder:
        FakeRun(short(), stop_at=77, error=RuntimeError("stop here")).run(recorder)
    assert recorder.warning is None
    assert list(recorded(path, "world/tip", "Points3D:positions")) == list(range(78))


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="counts native threads by /proc")
def test_recordings_leave_no_threads_however_they_end(tmp_path: Path) -> None:
    def ends(name: str, run: FakeRun) -> None:
        with RerunObserver(tmp_path / f"{name}.rrd", recording_id=name) as recorder:
            run.run(recorder)

    class Broken(FakeRun):
        def record(self, step: int) -> StepRecord:
            record = super().record(step)
            return replace(record, shaft_m=np.zeros((step, 2))) if step > 60 else record

    def native() -> int:
        return len(list(Path("/proc/self/task").iterdir()))

    ends("first", FakeRun(short()))  # what Rerun starts once for a process
    before = native()
    ends("whole", FakeRun(short()))
    with pytest.raises(RuntimeError, match="stop here"):
        ends("raised", FakeRun(short(), stop_at=77, error=RuntimeError("stop here")))
    ends("broken", Broken(short()))
    deadline = time.monotonic() + 30
    while native() > before and time.monotonic() < deadline:  # they were told to end
        time.sleep(0.01)
    assert native() <= before


CHILD = """
import os, signal, sys
from pathlib import Path
from service.recording.observer import RerunObserver
from tests.service.fake_run import FakeRun
from tests.service.recording.recorded import short

signal.signal(signal.SIGTERM, signal.SIG_DFL)  # coverage has a handler of its own where it measures

class Killer:
    def begin(self, scene, first): pass
    def end(self, rollout): pass
    def step(self, record):
        if record.step == 220:
            os.kill(os.getpid(), getattr(signal, sys.argv[2]))

from service.worker.attempt import ObserverGroup
with RerunObserver(Path(sys.argv[1]), recording_id="killed", clock=lambda: 0.0) as recorder:
    FakeRun(short()).run(ObserverGroup((recorder, Killer())))
"""


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
@pytest.mark.parametrize(
    ("sent", "code", "steps"),
    [("SIGTERM", 128 + signal.SIGTERM, range(221)), ("SIGKILL", -9, range(2 * BLOCK_STEPS))],
)
def test_a_killed_run_leaves_a_readable_recording(tmp_path: Path, sent: str, code: int, steps: range) -> None:
    path = tmp_path / "recording.rrd"
    root = Path(recording.__file__).parents[2]
    done = subprocess.run([sys.executable, "-c", CHILD, str(path), sent], cwd=root, check=False)
    assert done.returncode == code
    assert list(recorded(path, "world/tip", "Points3D:positions")) == list(steps)
    optimize(path)  # which also repairs it
    assert list(recorded(path, "world/tip", "Points3D:positions")) == list(steps)


@pytest.mark.slow
def test_the_file_grows_while_the_run_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "recording.rrd"
    seen: list[int] = []

    class Watcher(Keeper):
        def step(self, record: StepRecord) -> None:
            if record.step == 2 * BLOCK_STEPS:
                recorder._recorder.stream.flush()  # type: ignore[union-attr]
                copied = tmp_path / "copy.rrd"
                copied.write_bytes(path.read_bytes())
                seen.extend(recorded(copied, "world/tip", "Points3D:positions"))

    with RerunObserver(path, recording_id="grows", clock=lambda: 0.0) as recorder:
        FakeRun(short()).run(ObserverGroup((recorder, Watcher())))
    assert seen == list(range(2 * BLOCK_STEPS))


@pytest.mark.slow
def test_a_place_that_cannot_be_written_is_a_warning(tmp_path: Path) -> None:
    keeper = Keeper()
    with RerunObserver(tmp_path / "missing" / "recording.rrd", recording_id="w") as recorder:
        FakeRun(short()).run(ObserverGroup((recorder, keeper)))
    assert recorder.warning is not None
    assert "FileNotFoundError" in recorder.warning
    assert len(keeper.records) == STEPS + 1


@pytest.mark.slow
def test_a_record_that_cannot_be_drawn_is_a_warning(tmp_path: Path) -> None:
    class Broken(FakeRun):
        def record(self, step: int) -> StepRecord:
            record = super().record(step)
            return replace(record, shaft_m=np.zeros((step, 2))) if step > 60 else record

    path = tmp_path / "recording.rrd"
    with RerunObserver(path, recording_id="b") as recorder:
        rollout = Broken(short()).run(recorder)
    assert isinstance(rollout, FakeRollout)
    assert recorder.warning is not None
    assert recorder.warning.startswith("recording stopped: ")
    assert list(recorded(path, "metrics/error", "Scalars:scalars")) == list(range(61))


FULL_DISK = """
import resource, sys
from pathlib import Path
from service.recording import observer
from tests.service.fake_run import FakeRun
from tests.service.recording.recorded import short

limit, unforeseen = int(sys.argv[2]), sys.argv[3] == "unforeseen"
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
if unforeseen:
    observer.check_room, observer._FLUSH_S = lambda path: None, 2.0
with observer.RerunObserver(Path(sys.argv[1]), recording_id="full") as recorder:
    FakeRun(short()).run(recorder)
print(recorder.warning)
"""


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="POSIX limits")
@pytest.mark.parametrize(
    ("limit", "seen", "told"),
    [
        (150_000, "before", "OSError: [Errno 28] 0.1 MB are left for it, and 8 must be free"),
        (8_100_000, "on the way", "OSError: [Errno 28] "),
        pytest.param(150_000, "unforeseen", "RuntimeError: ", marks=pytest.mark.long),  # by a race of Rerun's
    ],
)
def test_a_full_disk_is_a_warning_and_the_process_ends(tmp_path: Path, limit: int, seen: str, told: str) -> None:
    """Rerun's writer ends at a full disk, and what waits for it then may never return."""
    root = Path(recording.__file__).parents[2]
    command = [sys.executable, "-c", FULL_DISK, str(tmp_path / "recording.rrd"), str(limit), seen]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, check=True, timeout=120)
    assert done.stdout.startswith(f"recording stopped: {told}")


def test_compacting_that_fails_leaves_the_original(tmp_path: Path) -> None:
    path = tmp_path / "recording.rrd"
    path.write_bytes(b"no recording at all")
    with pytest.raises(RuntimeError, match="compacting"):
        optimize(path)
    assert path.read_bytes() == b"no recording at all"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.slow
@pytest.mark.parametrize(("long_steps", "compacted"), [(STEPS, 1), (STEPS + 1, 0)])
def test_only_long_recordings_are_compacted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, long_steps: int, compacted: int
) -> None:
    calls: list[Path] = []
    monkeypatch.setattr(recording, "LONG_STEPS", long_steps)
    monkeypatch.setattr(recording, "optimize", calls.append)
    path = tmp_path / "a.rrd"
    with RerunObserver(path, recording_id="a") as observer:
        FakeRun(short()).run(observer)
    assert calls == [path] * compacted
