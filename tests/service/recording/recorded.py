"""A short run without physics, what it emitted, and what a recording of it holds."""

from __future__ import annotations

import copy
import warnings
from typing import TYPE_CHECKING, Any

import numpy as np
from rerun.chunk import RrdReader
from rerun.error_utils import RerunWarning

from simcore.scenario.scenario import Scenario

if TYPE_CHECKING:
    from pathlib import Path

    from simcore.rollout.records import Scene, StepRecord

STEPS = 230  # two full blocks and a part


def short(**changes: Any) -> Scenario:
    """A coarse scenario of STEPS steps."""
    data: dict[str, Any] = {
        "name": "short",
        "seed": 7,
        "tissue": {"element_size_mm": 20.0},
        "interaction": {"spacing_mm": 20.0},
        "trajectory": {"kind": "sine", "amplitude_mm": 3.0, "periods": 0.5, "target_mm": [18, 31, 40]},
    }
    scenario = Scenario.load({**data, **changes})
    speed = scenario.path().length_m * 1e3 / (STEPS * scenario.dt_s)
    data["trajectory"]["speed_mm_s"] = speed
    return Scenario.load({**data, **changes})


class Keeper:
    """Keeps a deep copy of every record at the time it is emitted."""

    def __init__(self) -> None:
        self.records: list[StepRecord] = []

    def begin(self, scene: Scene, first: StepRecord) -> None:
        self.scene = scene
        self.step(first)

    def step(self, record: StepRecord) -> None:
        self.records.append(copy.deepcopy(record))

    def end(self, rollout: Any) -> None:
        self.rollout = rollout


def reader(path: Path) -> RrdReader:
    """Of a complete recording, or of one that was cut short and lacks its footer."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "RRD file has no footer", RerunWarning)
        return RrdReader(path)


def recorded(path: Path, entity: str, component: str, timeline: str = "step") -> dict[int, np.ndarray]:
    """Time -> the values of a component at that time, in the order of the file."""
    rows: dict[int, np.ndarray] = {}
    for chunk in reader(path).stream():
        if chunk.entity_path != f"/{entity}" or chunk.is_static:
            continue
        batch = chunk.to_record_batch()
        if component in batch.schema.names:
            times = batch.column(timeline).cast("int64").to_pylist()
            for time, values in zip(times, batch.column(component).to_pylist(), strict=True):
                assert time not in rows
                rows[time] = np.array(values)
    return rows


def static(path: Path, entity: str) -> dict[str, Any]:
    """The values sent once to an entity, the last of each."""
    found: dict[str, Any] = {}
    for chunk in reader(path).stream():
        if chunk.entity_path == f"/{entity}" and chunk.is_static:
            batch = chunk.to_record_batch()
            found |= {name: batch.column(name).to_pylist()[-1] for name in batch.schema.names}
    return found
