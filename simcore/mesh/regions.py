"""Parts of space that hold what lies in them: a box, a slab about a plane, a ball. Lengths in metres, rest space."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from simcore.linear_algebra.products import norm, times

if TYPE_CHECKING:
    from simcore.arrays import Flags, Floats

ROUNDING_M = 1e-9  # a node on the border of a region is in it, however its coordinates were rounded


class Region(Protocol):
    """A part of space."""

    def contains(self, points_m: Floats) -> Flags:
        """Whether each of the points (n, 3) m lies in it, border included."""


@dataclass(frozen=True)
class BoxRegion:
    """Between two corners, edges along the axes: (3,) m each."""

    low_m: Floats
    high_m: Floats

    def contains(self, points_m: Floats) -> Flags:
        """As in `Region`."""
        above, below = points_m >= self.low_m - ROUNDING_M, points_m <= self.high_m + ROUNDING_M
        return np.asarray((above & below).all(axis=1))


@dataclass(frozen=True)
class PlaneRegion:
    """Within a distance of the plane through point_m (3,) m that is normal to `normal` (3,), of any length."""

    point_m: Floats
    normal: Floats
    within_m: float

    def contains(self, points_m: Floats) -> Flags:
        """As in `Region`."""
        inside: Flags = (
            np.abs(times(points_m - self.point_m, self.normal / norm(self.normal))) <= self.within_m + ROUNDING_M
        )
        return inside


@dataclass(frozen=True)
class BallRegion:
    """Within a radius of centre_m (3,) m."""

    centre_m: Floats
    radius_m: float

    def contains(self, points_m: Floats) -> Flags:
        """As in `Region`."""
        inside: Flags = np.linalg.norm(points_m - self.centre_m, axis=1) <= self.radius_m + ROUNDING_M
        return inside
