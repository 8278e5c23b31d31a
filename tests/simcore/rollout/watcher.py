"""What looks at a run for the tests, and what of a run is state."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simcore.rollout.authority import AUTHORITY
from simcore.rollout.result import FRAMES, TIMES, Rollout

if TYPE_CHECKING:
    import numpy as np

    from simcore.rollout.records import Scene, StepRecord

MAY_BE_NAN = {*AUTHORITY, "contact_points_m", "contact_forces_n"}  # what is not linearised; rows beyond the contacts


class Watcher:
    """Keeps what it is shown, in order."""

    def __init__(self, *, stop_at: int | None = None, error: BaseException | None = None) -> None:
        self.calls: list[str] = []
        self.records: list[StepRecord] = []
        self.stop_at, self.error = stop_at, error
        self.scene: Scene | None = None
        self.rollout: Rollout | None = None

    def begin(self, scene: Scene, first: StepRecord) -> None:
        self.scene = scene
        self.records.append(first)
        self.calls.append("begin")

    def step(self, record: StepRecord) -> None:
        self.records.append(record)
        self.calls.append("step")
        if record.step == self.stop_at and self.error:
            raise self.error

    def end(self, rollout: Rollout) -> None:
        self.rollout = rollout
        self.calls.append("end")


def state_of(rollout: Rollout) -> dict[str, np.ndarray]:
    return {name: array for name, array in rollout.series.items() if name not in (*TIMES, *FRAMES)}
