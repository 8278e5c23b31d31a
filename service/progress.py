"""How a running job tells where it is: a small file that is replaced at most twice a second.

A file and not a pipe: a worker that is killed at any moment leaves the last whole one, and blocks nobody.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from simcore.records import Scene, StepRecord
    from simcore.rollout import Rollout

NAME = "progress.json"
INTERVAL_S = 0.5


class ProgressFile:
    """Observer that keeps `progress.json` in `folder` current."""

    def __init__(self, folder: Path, *, clock: Callable[[], float] = time.monotonic) -> None:
        self._path = folder / NAME
        self._clock = clock
        self._steps = 0
        self._aim_m: NDArray[np.float64] | None = None  # (3,) world, what the command of the next step is made for
        self._line_m: NDArray[np.float64] | None = None  # (p, 3) world; where the tissue carries the path, None
        self._started = self._written = clock()

    def begin(self, scene: Scene, first: StepRecord) -> None:
        self._steps = scene.steps
        self._line_m = scene.path_m if scene.scenario.trajectory.frame == "world" else None
        self._started = self._clock()
        self._write(first)
        self._aim_m = first.target_m.copy()

    def step(self, record: StepRecord) -> None:
        if self._clock() - self._written >= INTERVAL_S or record.step == self._steps:
            self._write(record)
        self._aim_m = record.target_m.copy()

    def end(self, rollout: Rollout) -> None:
        pass

    def _write(self, record: StepRecord) -> None:
        import numpy as np

        self._written = self._clock()
        aim_m = record.target_m if self._aim_m is None else self._aim_m  # as rmse_mm has it
        left = self._steps - record.step
        pace = (self._written - self._started) / record.step if record.step else None
        progress = {
            "fraction": round(record.step / self._steps, 4),
            "step": record.step,
            "steps": self._steps,
            "depth_mm": round(float(record.depth_m) * 1e3, 3),
            "tip_error_mm": round(float(np.linalg.norm(record.tip_m - aim_m)) * 1e3, 6),
            "cross_track_mm": self._cross_track_mm(record),
            "insertion_force_n": round(float(record.insertion_force_n), 4),
            "eta_s": None if pace is None else round(pace * left, 1),
        }
        replace_text(self._path, json.dumps(progress))

    def _cross_track_mm(self, record: StepRecord) -> float | None:
        from simcore.trajectory import polyline_distance_m

        return None if self._line_m is None else round(polyline_distance_m(record.tip_m, self._line_m) * 1e3, 6)


def replace_text(path: Path, text: str) -> None:
    """Replace a file as a whole; a reader sees the old text or the new one."""
    draft = path.with_name(f"{path.name}.tmp")
    draft.write_text(text, encoding="utf-8")
    with suppress(PermissionError):  # Windows: the reader has it open just now; the next one will do
        os.replace(draft, path)


def read(folder: Path) -> dict[str, Any] | None:
    """The last progress in `folder`, or None."""
    try:
        progress: dict[str, Any] = json.loads((folder / NAME).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return progress
