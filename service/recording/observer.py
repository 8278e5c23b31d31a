"""Streams a run into a Rerun recording while it is simulated.

A recording is a view of the run; the arrays and metrics beside it are the record. The stream goes to a file only,
in blocks of so many steps, or fewer once the oldest has waited for BLOCK_S: the growing file can be tailed, and a
killed run loses its last block at most. How the rows are cut into blocks changes no row.

Blocks are built on the thread that simulates. A thread of their own would save nothing: building columns and the
simulation's kernels both hold the interpreter's lock. What releases it, encoding and writing, is on Rerun's thread.

A failure to record never changes or stops a run: the observer gives up, closes what it has and says so in `warning`.
A full disk is no exception: the results that matter are written after the run, and fail there with their own error.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Self

import rerun as rr

from service.display import job_text, plain_values
from service.recording import viewer
from service.recording.blocks import Block
from service.recording.entities import Drawing, log_static
from service.recording.layout import blueprint
from service.recording.rerun_overrides import end, end_threads, write_to_file
from service.recording.room import check_room

if TYPE_CHECKING:
    from pathlib import Path
    from types import FrameType, TracebackType

    from simcore.rollout.records import Scene, StepRecord
    from simcore.rollout.result import Rollout

APPLICATION = "needlebench"
BLOCK_S = 1.0  # of wall time that a step may wait before it is sent
LONG_STEPS = 5_000  # from which on a recording is compacted; 1,200 steps are read in 17 ms as they are, in 10 compacted
_OPTIMIZE_TIMEOUT_S = 300.0
_FLUSH_S = 120.0  # a writer that takes longer to write what it was sent is taken for dead

Clock = Callable[[], float]


class RerunObserver:
    """Records a run to `path`; a context manager, so that the file is closed whatever happens to the run.

    recording_id: names the recording in a viewer, unique among those opened together.
    provenance: JSON values stored with the recording from its start, such as job id and commit.
    Within the context, SIGTERM ends the process by SystemExit instead of at once, unless someone else handles it.
    clock: seconds; bounds how long a step is held back.
    """

    def __init__(
        self,
        path: Path,
        *,
        recording_id: str,
        provenance: dict[str, Any] | None = None,
        clock: Clock = time.perf_counter,
    ) -> None:
        self.path = path
        self.recording_id = recording_id
        self.provenance = provenance or {}
        self.clock = clock
        self.warning: str | None = None  # why the recording is missing or incomplete
        self._recorder: _Recorder | None = None
        self._old_handler: Any = None

    def __enter__(self) -> Self:
        on_main_thread = threading.current_thread() is threading.main_thread()
        if on_main_thread and signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
            self._old_handler = signal.signal(signal.SIGTERM, _exit)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
        if self._old_handler is not None:
            signal.signal(signal.SIGTERM, self._old_handler)

    def begin(self, scene: Scene, first: StepRecord) -> None:
        """Open the file and send what never changes; nothing at all if the scenario asks for no recording."""
        if scene.scenario.recording.enabled:
            self._attempt(lambda: self._open(scene, first))

    def step(self, record: StepRecord) -> None:
        """Buffer a copy of the record; send the buffered ones if they are many or old."""
        if self._recorder is not None:
            recorder = self._recorder
            self._attempt(lambda: recorder.add(record))

    def end(self, rollout: Rollout) -> None:
        """Send the rest and the result and close the file; a long one is compacted."""
        if self._recorder is not None:
            recorder = self._recorder
            self._attempt(lambda: recorder.send_result(rollout.result()))
            self.close()
            if self.warning is None and rollout.scenario.steps >= LONG_STEPS:
                self._attempt(lambda: optimize(self.path))

    def close(self) -> None:
        """Send what is buffered and close the file; it stays readable if the run did not end. Harmless twice."""
        recorder, self._recorder = self._recorder, None
        if recorder is not None:
            self._attempt(recorder.close)

    def _open(self, scene: Scene, first: StepRecord) -> None:
        self._recorder = _Recorder(self.path, self.recording_id, scene, self.provenance, self.clock)
        self._recorder.add(first)

    def _attempt(self, action: Callable[[], None]) -> None:
        """Do it, or end the recording with the rows so far: a run must not depend on being recorded."""
        try:
            action()
        except Exception as error:  # noqa: BLE001  (a run never fails because of its recording)
            if self.warning is None:
                self.warning = f"recording stopped: {type(error).__name__}: {error}"
        else:
            return
        recorder, self._recorder = self._recorder, None  # here, where no frame of the error holds the stream any more
        if recorder is not None:
            with contextlib.suppress(Exception):
                recorder.close()


class _Recorder:
    """An open recording; every method may raise."""

    def __init__(self, path: Path, recording_id: str, scene: Scene, provenance: dict[str, Any], clock: Clock) -> None:
        rr.set_strict_mode(True)
        self.scene, self.clock = scene, clock
        self.path = path
        with path.open("wb"):  # a path that cannot be written is an error here, not on Rerun's thread
            pass
        check_room(path)
        self.stream = rr.RecordingStream(APPLICATION, recording_id=recording_id)
        self.stream.set_log_time_enabled(False)
        self.stream.set_log_tick_enabled(False)
        write_to_file(self.stream, path, blueprint(scene), APPLICATION)
        self.drawing = Drawing.of(scene)
        self.block = Block(self.drawing)
        self.sent_s = clock()
        log_static(self.stream, scene, self.drawing)
        self._send_scenario(provenance)
        self.stream.flush(timeout_sec=0)  # for readers that follow the file; the run need not wait

    def _send_scenario(self, provenance: dict[str, Any]) -> None:
        scenario = self.scene.scenario
        self.stream.send_recording_name(scenario.name)
        self.stream.send_property("scenario", _values(scenario.resolved()))
        if provenance:
            self.stream.send_property("provenance", _values(provenance))
        self._send_job(None)

    def _send_job(self, result: dict[str, Any] | None) -> None:
        text = rr.TextDocument(job_text(self.scene.scenario, result), media_type=rr.MediaType.MARKDOWN)
        self.stream.log("job", text, static=True)

    def add(self, record: StepRecord) -> None:
        self.block.add(record)
        if self.block.full or self.clock() - self.sent_s >= BLOCK_S:
            self._send()

    def _send(self) -> None:
        block = self.block
        if block.rows:
            check_room(self.path)
            self.block, self.sent_s = block.next(), self.clock()
            block.send(self.stream)

    def send_result(self, result: dict[str, Any]) -> None:
        self._send()
        self.stream.send_property("result", _values(result, leave_out=("scenario",)))
        self._send_job(result)

    def close(self) -> None:
        try:
            self._send()
        finally:
            stream = self.stream
            del self.stream
            end(stream, within_s=_FLUSH_S)
            del stream
            end_threads()


def _values(data: dict[str, Any], leave_out: tuple[str, ...] = ()) -> rr.AnyValues:
    """JSON data as a property, without empty texts; a value as a list of one: for a bare one Arrow looks for pandas."""
    values: dict[str, Any] = {name: [v] for name, v in plain_values(data, leave_out).items() if v != ""}
    return rr.AnyValues(**values)


def optimize(path: Path) -> None:
    """Compact a closed recording in place, for quick loading. The original stays if anything goes wrong.

    Raises RuntimeError if the recording cannot be read or rewritten.
    """
    compacted = path.with_name(f".{path.stem}.{os.getpid()}.rrd")
    command = [viewer.program(), "rrd", "optimize", "--profile", "live", str(path), "-o", str(compacted)]
    try:
        done = subprocess.run(
            command,
            env=viewer.environment(),
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=_OPTIMIZE_TIMEOUT_S,
            check=False,
        )
        if done.returncode != 0 or not compacted.is_file():
            raise RuntimeError(f"compacting {path.name} failed: {done.stderr.strip() or done.returncode}")
        compacted.replace(path)
    finally:
        compacted.unlink(missing_ok=True)


def _exit(number: int, _frame: FrameType | None) -> None:
    raise SystemExit(128 + number)
