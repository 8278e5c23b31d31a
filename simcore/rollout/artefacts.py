"""result.json and series.npz on disk: complete or not there at all."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

if TYPE_CHECKING:
    from simcore.rollout.result import Rollout

RESULT, SERIES = "result.json", "series.npz"


def write(rollout: Rollout, folder: Path) -> list[Path]:
    """Write series.npz, then result.json: who sees a result finds its own series. Returns the two paths."""
    text = json.dumps(rollout.result(), indent=2, allow_nan=False) + "\n"
    folder.mkdir(parents=True, exist_ok=True)
    series, result = folder / SERIES, folder / RESULT
    result.unlink(missing_ok=True)
    replace_atomically(series, lambda file: np.savez_compressed(file, allow_pickle=False, **rollout.series))
    replace_atomically(result, lambda file: file.write(text.encode()))
    return [result, series]


def replace_atomically(path: Path, fill: Callable[[BinaryIO], Any]) -> None:
    """Write beside `path`, flush to the disk, rename: a kill at any moment leaves the old file or the new one."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with temporary.open("wb") as file:
            fill(file)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
