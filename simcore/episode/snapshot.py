"""An episode at one moment: everything that the steps after it depend on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from simcore.errors import NeedlebenchError

if TYPE_CHECKING:
    from simcore.arrays import Floats
    from simcore.episode.sensing import Image
    from simcore.errors import Status
    from simcore.insertion.insertion import InsertionState
    from simcore.insertion.state import Kept, Pose
    from simcore.scenario.scenario import Scenario

FREE = ("name", "seed", "recording")  # fields in which a snapshot's scenario may differ


class SnapshotError(NeedlebenchError, ValueError):
    """A snapshot of another insertion; the message names the field."""


@dataclass(frozen=True)
class Snapshot:
    """From `Episode.snapshot`, for `Episode.restore`; it can be pickled, copied and restored any number of times, and
    holds some megabytes. Nothing in it is written again.

    scenario: with the seed of the episode. step: number of the next step.
    """

    scenario: Scenario
    step: int
    status: Status
    message: str
    before: InsertionState
    state: InsertionState
    kept: Kept
    waiting: tuple[Pose, ...]
    seen: Image
    coming: tuple[Image, ...]
    authority: tuple[Floats, ...]


def check_same_insertion(snapshot: Snapshot, scenario: Scenario) -> None:
    """Raises SnapshotError where a snapshot's scenario is another one; name, seed and recording may differ."""
    if snapshot.scenario is scenario:
        return
    theirs, ours = snapshot.scenario.resolved(), scenario.resolved()
    for field in ours:
        if field not in FREE and (found := _difference(field, theirs.get(field), ours[field])) is not None:
            name, their, our = found
            raise SnapshotError(f"the snapshot is of another insertion: {name} = {their!r} there, {our!r} here")


def _difference(name: str, theirs: Any, ours: Any) -> tuple[str, Any, Any] | None:
    if theirs == ours:
        return None
    if isinstance(theirs, dict) and isinstance(ours, dict):
        for key in sorted({*theirs, *ours}):
            if (found := _difference(f"{name}.{key}", theirs.get(key), ours.get(key))) is not None:
                return found
    return name, theirs, ours
