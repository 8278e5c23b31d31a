"""What the tip is asked to follow, field by field; tags of the defaults as in `blocks`."""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field

from simcore.arrays import Floats
from simcore.scenario.blocks import Block, Component, Number, Triple, at_most, bounded
from simcore.trajectory import ArcPath, Path, SinePath, SplinePath, step_count, targets

KINDS = "line, sine, arc, waypoints or reach"
MAXIMUM_POINTS = 500

ENTRY = Field(
    default=(18.0, 31.0, 0.0), description="on the face z = 0, inside its edges; on the surface of mesh_file [ours]"
)
SNAP = bounded(
    0.0, 0.0, 50.0, "how far entry_mm may be moved to the nearest point of the surface of mesh_file; 0 = not [ours]"
)
TARGET = Field(
    default=(18.0, 31.0, 122.0), description="inside the block, at least 0.1 mm below the face z = 0 [paper: z = 122]"
)
SPEED = bounded(10.0, 0.1, 1000.0, "speed of the target along the path [paper]")
FRAME: Any = Field(
    default="world",
    description="world = path fixed in space, tissue = path carried by the deforming tissue [ours]",
)
DIRECTION = tuple[Component, Component, Component]
DIRECTION_TEXT = "world vector of any length, made perpendicular to the path; each -1000 to 1000"


class Guide(Block):
    """What all kinds have in common: where the needle enters, and in which frame it is guided."""

    if TYPE_CHECKING:  # fields of every kind, which each declares in its own order
        kind: str
        entry_mm: Triple
        entry_snap_mm: float
        frame: Literal["world", "tissue"]

    @abstractmethod
    def path(self) -> Path:
        """The path in rest space, metres; the straight way where there is none."""

    @property
    @abstractmethod
    def end_mm(self) -> tuple[float, float, float]:
        """Where the tip should be in the end."""

    @property
    @abstractmethod
    def end_field(self) -> str:
        """The field that says so."""

    @abstractmethod
    def steps(self, dt_s: float) -> int:
        """How many there are."""

    @abstractmethod
    def targets_m(self, dt_s: float, steps: int) -> Floats:
        """(steps + 1, 3) m, rest space: the target of each step."""

    @abstractmethod
    def share_per_step(self, dt_s: float) -> float:
        """Of the whole way, at an even pace."""


class Timed(Guide):
    """A target that slides along a path."""

    if TYPE_CHECKING:
        speed_mm_s: float

    def steps(self, dt_s: float) -> int:
        """ceil(path length / (speed dt))."""
        return step_count(self.path().length_m, self.speed_mm_s * 1e-3, dt_s)

    def targets_m(self, dt_s: float, steps: int) -> Floats:
        """(steps + 1, 3) m, rest space: at arc length speed * t, clipped to the end."""
        return targets(self.path(), speed_m_s=self.speed_mm_s * 1e-3, dt_s=dt_s, steps=steps)

    def share_per_step(self, dt_s: float) -> float:
        """Of the path's length."""
        return self.speed_mm_s * 1e-3 * dt_s / self.path().length_m


class StraightTrajectory(Timed):
    """A target that slides along a straight line."""

    kind: Literal["line"] = Field(default="line", description=KINDS)
    entry_mm: Triple = ENTRY
    entry_snap_mm: Number = SNAP
    target_mm: Triple = TARGET
    speed_mm_s: Number = SPEED
    frame: Literal["world", "tissue"] = FRAME

    @property
    def end_mm(self) -> tuple[float, float, float]:
        """The target."""
        return self.target_mm

    @property
    def end_field(self) -> str:
        """The field that says where the path ends."""
        return "trajectory.target_mm"

    def path(self) -> Path:
        """The path in rest space, metres."""
        return SinePath(np.array(self.entry_mm) * 1e-3, np.array(self.target_mm) * 1e-3)


class SineTrajectory(StraightTrajectory):
    """The straight line with a sine overlay across it."""

    kind: Literal["sine"] = Field(default="sine", description=KINDS)  # type: ignore[assignment]
    amplitude_mm: Number = bounded(1.0, 0.0, 20.0, "amplitude of the overlay [ours]")
    periods: Number = bounded(1.0, 0.1, 10.0, "periods over the whole path [paper: one]")
    direction: DIRECTION = Field(default=(1.0, 0.0, 0.0), description=f"{DIRECTION_TEXT} [paper: +-x, +-y]")

    def path(self) -> Path:
        """The path in rest space, metres."""
        return SinePath(
            np.array(self.entry_mm) * 1e-3,
            np.array(self.target_mm) * 1e-3,
            self.amplitude_mm * 1e-3,
            self.periods,
            np.array(self.direction),
        )


class ArcTrajectory(StraightTrajectory):
    """The smaller arc of a circle from entry to target."""

    kind: Literal["arc"] = Field(default="arc", description=KINDS)  # type: ignore[assignment]
    radius_mm: Number = bounded(
        300.0, 1.0, 1e5, "of the circle, at least half of the distance from entry to target [ours]"
    )
    direction: DIRECTION = Field(
        default=(1.0, 0.0, 0.0), description=f"side to which the arc bulges: {DIRECTION_TEXT} [ours]"
    )

    def path(self) -> Path:
        """The path in rest space, metres."""
        ends = np.array(self.entry_mm) * 1e-3, np.array(self.target_mm) * 1e-3
        return ArcPath(*ends, self.radius_mm * 1e-3, np.array(self.direction))


class WaypointTrajectory(Timed):
    """A target that slides along the smooth curve from the entry through points, a natural cubic spline."""

    kind: Literal["waypoints"] = Field(default="waypoints", description=KINDS)
    entry_mm: Triple = ENTRY
    entry_snap_mm: Number = SNAP
    points_mm: Annotated[tuple[Triple, ...], at_most(MAXIMUM_POINTS)] = Field(
        default=((20.0, 32.0, 60.0), (18.0, 34.0, 122.0)),
        min_length=1,
        max_length=MAXIMUM_POINTS,
        description="1 to 500 points after the entry, in order, inside the tissue and at least 0.1 mm apart; the last "
        "one is the end [ours]",
    )
    speed_mm_s: Number = SPEED
    frame: Literal["world", "tissue"] = FRAME

    @property
    def end_mm(self) -> tuple[float, float, float]:
        """The last point."""
        return self.points_mm[-1]

    @property
    def end_field(self) -> str:
        """The field that says where the path ends."""
        return f"trajectory.points_mm[{len(self.points_mm) - 1}]"

    def path(self) -> Path:
        """The path in rest space, metres."""
        return SplinePath.through(np.array([self.entry_mm, *self.points_mm]) * 1e-3)


class ReachTrajectory(Guide):
    """A target without a path: the controller decides the way, within a time."""

    kind: Literal["reach"] = Field(default="reach", description=KINDS)
    entry_mm: Triple = ENTRY
    entry_snap_mm: Number = SNAP
    target_mm: Triple = TARGET
    time_s: Number = bounded(15.0, 0.1, 1000.0, "after which the tip should be at the target [ours]")
    frame: Literal["world", "tissue"] = FRAME

    @property
    def end_mm(self) -> tuple[float, float, float]:
        """The target."""
        return self.target_mm

    @property
    def end_field(self) -> str:
        """The field that says where the needle should end."""
        return "trajectory.target_mm"

    def path(self) -> Path:
        """The straight way, metres: the needle waits along it."""
        return SinePath(np.array(self.entry_mm) * 1e-3, np.array(self.target_mm) * 1e-3)

    def steps(self, dt_s: float) -> int:
        """ceil(time / dt)."""
        return step_count(self.time_s, 1.0, dt_s)

    def targets_m(self, dt_s: float, steps: int) -> Floats:  # noqa: ARG002  (the same at all times)
        """(steps + 1, 3) m, rest space: the target."""
        return np.tile(np.array(self.target_mm) * 1e-3, (steps + 1, 1))

    def share_per_step(self, dt_s: float) -> float:
        """Of the straight way."""
        return dt_s / self.time_s


Trajectory = Annotated[
    StraightTrajectory | SineTrajectory | ArcTrajectory | WaypointTrajectory | ReachTrajectory,
    Field(discriminator="kind"),
]
