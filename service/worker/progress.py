"""How a running job reports its progress: a small file that is replaced at most twice a second.

A file and not a pipe: a worker that is killed at any moment leaves the last whole one, and blocks nobody.
"""

from __future__ import annotations

import json
import time
from typing import TYPE_CHECKING, Any

from service.files.replace_text import replace_text
from service.files.strict_json import plain_json

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from simcore.rollout.records import Scene, StepRecord
    from simcore.rollout.result import Rollout

NAME = "progress.json"
INTERVAL_S = 0.5
MOST_BYTES = 65_536  # of the file; what a plug-in left there instead is not read


class ProgressFile:
    """Observer that keeps `progress.json` in `folder` current."""

    def __init__(self, folder: Path, *, clock: Callable[[], float] = time.monotonic) -> None:
        self._path = folder / NAME
        self._clock = clock
        self._steps = 0
        self._latest: StepRecord | None = None
        self._written_step = -1
        self._current_target_m: NDArray[np.float64] | None = None  # (3,) world, of the latest step
        self._next_target_m: NDArray[np.float64] | None = None  # (3,) world, of the step to come
        self._line_m: NDArray[np.float64] | None = None  # (p, 3) world; None: carried by the tissue, or no path
        self._started = self._written = clock()

    def begin(self, scene: Scene, first: StepRecord) -> None:
        """Write the first progress."""
        self._steps = scene.steps
        trajectory = scene.scenario.trajectory
        self._line_m = scene.path_m if trajectory.frame == "world" and trajectory.kind != "reach" else None
        self._started = self._clock()
        self._next_target_m = first.target_m.copy()
        self._take(first)
        self._write(first)

    def step(self, record: StepRecord) -> None:
        """Write it when half a second has passed, and at the last step."""
        self._take(record)
        if self._clock() - self._written >= INTERVAL_S or record.step == self._steps:
            self._write(record)

    def end(self, rollout: Rollout) -> None:  # noqa: ARG002  (an observer's signature)
        """The last step that there was, where it stopped early."""
        if self._latest is not None and self._latest.step != self._written_step:
            self._write(self._latest)

    def _take(self, record: StepRecord) -> None:
        self._latest, self._current_target_m = record, self._next_target_m
        self._next_target_m = record.target_m.copy()

    def _write(self, record: StepRecord) -> None:
        import numpy as np

        assert self._current_target_m is not None
        self._written, self._written_step = self._clock(), record.step
        left = self._steps - record.step
        pace = (self._written - self._started) / record.step if record.step else None
        progress = {
            "fraction": round(record.step / self._steps, 4),
            "step": record.step,
            "steps": self._steps,
            "depth_mm": round(float(record.depth_m) * 1e3, 3),
            "tip_error_mm": round(float(np.linalg.norm(record.tip_m - self._current_target_m)) * 1e3, 6),
            "cross_track_mm": self._cross_track_mm(record),
            "insertion_force_n": round(float(record.insertion_force_n), 4),
            "eta_s": None if pace is None else round(pace * left, 1),
        }
        replace_text(self._path, json.dumps(progress))

    def _cross_track_mm(self, record: StepRecord) -> float | None:
        from simcore.trajectory import polyline_distance_m

        return None if self._line_m is None else round(polyline_distance_m(record.tip_m, self._line_m) * 1e3, 6)


class ProgressReader:
    """The last progress in `folder`, which is read when the file is another one than before: it is asked for often."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._path = folder, folder / NAME
        self._seen: tuple[int, int, int] | None = None
        self._latest: dict[str, Any] | None = None

    def latest(self) -> dict[str, Any] | None:
        """As `read`."""
        try:
            found = self._path.stat()
        except OSError:
            return None
        seen = (found.st_ino, found.st_mtime_ns, found.st_size)
        if seen != self._seen:
            self._seen, self._latest = seen, read(self._folder)
        return self._latest


def read(folder: Path) -> dict[str, Any] | None:
    """The last progress in `folder`; None if there is none, or one that cannot be stored: too long, or with NaN."""
    try:
        with (folder / NAME).open("rb") as file:
            text = file.read(MOST_BYTES + 1)
        if len(text) > MOST_BYTES:
            return None
        progress = plain_json(json.loads(text, parse_constant=_refuse), most_mb=1)
    except (OSError, ValueError, RecursionError):
        return None
    return progress if isinstance(progress, dict) else None


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is no number of JSON")
