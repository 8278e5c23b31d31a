"""One run in this process, written to a folder as a whole or not at all."""

from __future__ import annotations

import contextlib
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from service.worker.attempt import KINDS, ObserverGroup
from simcore.errors import Problem, ScenarioError
from simcore.rollout.records import Observer, Scene, StepRecord
from simcore.scenario.scenario import Scenario

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

    from simcore.rollout.result import Rollout

RESULT = "result.json"


@contextlib.contextmanager
def output_folder(folder: Path, *, replace: bool) -> Iterator[Path]:
    """An empty folder to write into; on success its files move to `folder`, the result last, else they vanish.

    Raises ScenarioError, before anything is made, for a folder that holds a result (unless `replace`) or cannot be.
    """
    present = [name for name in KINDS if (folder / name).exists()]
    if present and not replace:
        raise ScenarioError([Problem("--out", str(folder), f"holds {', '.join(present)}; use --force to replace")])
    made = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        partial = Path(tempfile.mkdtemp(prefix=".partial-", dir=folder))
    except OSError as error:
        raise ScenarioError([Problem("--out", str(folder), f"cannot be written: {error.strerror}")]) from None
    try:
        yield partial
        for name in [name for name in KINDS if not (partial / name).exists()]:
            (folder / name).unlink(missing_ok=True)
        for written in sorted(partial.iterdir(), key=lambda path: path.name == RESULT):
            written.replace(folder / written.name)
    finally:
        shutil.rmtree(partial, ignore_errors=True)
        if made and not any(folder.iterdir()):
            folder.rmdir()


def run_into(folder: Path, scenario: Scenario, *, recording_id: str) -> tuple[dict[str, Any], str | None]:
    """Run a scenario and write its files; the result and why the recording is missing or incomplete, if it is."""
    from simcore.rollout import artefacts, rollout

    recorder = None
    observers: list[Observer] = []
    with ExitStack() as stack:
        if sys.stderr.isatty():
            observers.append(stack.enter_context(ProgressBar()))
        if scenario.recording.enabled:
            from service.recording.observer import RerunObserver

            recorder = stack.enter_context(RerunObserver(folder / "recording.rrd", recording_id=recording_id))
            observers.append(recorder)
        done = rollout.run(scenario, ObserverGroup(tuple(observers)))
    artefacts.write(done, folder)
    return done.result(), recorder.warning if recorder else None


class ProgressBar:
    """Shows on a terminal how deep the tip is, how far off, and when it will be done."""

    _UPDATE_STEPS = 5

    def __init__(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

        self._progress: Progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.percentage:3.0f} %  {task.fields[depth]:5.1f} mm deep, {task.fields[error]:4.2f} mm off"),
            TimeRemainingColumn(),
            console=Console(stderr=True),
            transient=True,
        )
        self._task: TaskID | None = None

    def __enter__(self) -> ProgressBar:
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def begin(self, scene: Scene, first: StepRecord) -> None:
        """Start the bar."""
        name = scene.scenario.name
        self._task = self._progress.add_task(name, total=scene.steps, depth=0.0, error=0.0)

    def step(self, record: StepRecord) -> None:
        """Move the bar, every few steps."""
        if self._task is not None and record.step % self._UPDATE_STEPS == 0:
            x, y, z = record.tip_m - record.target_m
            error = 1e3 * float(x * x + y * y + z * z) ** 0.5
            self._progress.update(self._task, completed=record.step, depth=1e3 * record.depth_m, error=error)

    def end(self, rollout: Rollout) -> None:
        """Nothing more to show."""
