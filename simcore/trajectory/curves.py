"""The curves that paths are: `entry + u (end - entry) + A sin(2 pi n u) d`, where a line has A = 0; an arc of a circle;
the natural cubic spline through points, over the length of their polygon, which of all curves through them bends least
(Holladay 1957)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from simcore.elementary import arc_tangent, sines_cosines
from simcore.linear_algebra.products import dot, norm
from simcore.trajectory.path import PANELS, Path

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

    from simcore.arrays import Floats


@dataclass(frozen=True)
class SinePath(Path):
    """A straight chord with an optional sine overlay.

    entry_m, end_m: (3,) m, rest space. direction: (3,), any length, made perpendicular to the chord.
    """

    entry_m: Floats
    end_m: Floats
    amplitude_m: float = 0.0
    periods: float = 1.0
    direction: Floats | None = None

    @cached_property
    def overlay(self) -> Floats:
        """(3,) unit vector of the overlay, perpendicular to the chord; zero for a straight path."""
        if self.amplitude_m == 0.0 or self.direction is None:
            return np.zeros(3)
        axis = self.chord / norm(self.chord)
        across = self.direction - dot(self.direction, axis) * axis
        return across / norm(across)

    @property
    def is_straight(self) -> bool:
        """Whether it has no overlay."""
        return self.amplitude_m == 0.0

    def curve(self, u: Floats) -> Floats:
        """Points (n, 3) m at the parameters u (n,) in [0, 1]."""
        u = np.atleast_1d(np.asarray(u, dtype=float))
        wave = self.amplitude_m * sines_cosines(2 * np.pi * self.periods * u)[0]
        return self.entry_m + u[:, None] * self.chord + wave[:, None] * self.overlay

    def derivative(self, u: Floats) -> Floats:
        """Derivatives d curve / du (n, 3) m at the parameters u (n,)."""
        u = np.atleast_1d(np.asarray(u, dtype=float))
        k = 2 * np.pi * self.periods
        slope = self.amplitude_m * k * sines_cosines(k * u)[1]
        return self.chord + slope[:, None] * self.overlay

    def second_derivative(self, u: Floats) -> Floats:
        """Derivatives d2 curve / du2 (n, 3) m at the parameters u (n,)."""
        k = 2 * np.pi * self.periods
        bend = -self.amplitude_m * k**2 * sines_cosines(k * np.atleast_1d(np.asarray(u, dtype=float)))[0]
        return bend[:, None] * self.overlay


@dataclass(frozen=True)
class ArcPath(Path):
    """The smaller arc of a circle from entry to end.

    entry_m, end_m: (3,) m, rest space. radius_m: at least half of the chord. direction: (3,), any length, the side to
    which the arc bulges, made perpendicular to the chord.
    """

    entry_m: Floats
    end_m: Floats
    radius_m: float
    direction: Floats

    @cached_property
    def _frame(self) -> tuple[Floats, Floats, Floats, float]:
        """Centre (3,) m, unit vectors along the chord and to the side, half of the angle."""
        length = norm(self.chord)
        along = self.chord / length
        side = self.direction - dot(self.direction, along) * along
        side = side / norm(side)
        sagging = math.sqrt(max(self.radius_m**2 - 0.25 * length**2, 0.0))
        centre = 0.5 * (self.entry_m + self.end_m) - sagging * side
        return centre, along, side, arc_tangent(0.5 * length, sagging)

    def _turning(self, u: Floats, order: int) -> Floats:
        """(n, 3) m: the derivative of this order, from the centre."""
        _, along, side, half = self._frame
        angle = (2.0 * np.atleast_1d(np.asarray(u, dtype=float)) - 1.0) * half + 0.5 * np.pi * order
        size = self.radius_m * (2.0 * half) ** order
        sines, cosines = sines_cosines(angle)
        return size * (cosines[:, None] * side + sines[:, None] * along)

    def curve(self, u: Floats) -> Floats:
        """Points (n, 3) m at the parameters u (n,) in [0, 1]."""
        return self._frame[0] + self._turning(u, 0)

    def derivative(self, u: Floats) -> Floats:
        """Derivatives d curve / du (n, 3) m at the parameters u (n,)."""
        return self._turning(u, 1)

    def second_derivative(self, u: Floats) -> Floats:
        """Derivatives d2 curve / du2 (n, 3) m at the parameters u (n,)."""
        return self._turning(u, 2)


@dataclass(frozen=True)
class SplinePath(Path):
    """The natural cubic spline through points, all (3,) m, rest space, neighbours apart: straight without any between.

    between_m: (k, 3) m, from entry to end.
    """

    entry_m: Floats
    end_m: Floats
    between_m: Floats

    @classmethod
    def through(cls, points_m: Floats) -> SplinePath:
        """From the first to the last of points_m (k, 3) m, k at least 2."""
        return cls(points_m[0], points_m[-1], points_m[1:-1])

    @cached_property
    def points_m(self) -> Floats:
        """(k + 2, 3) m: all of them."""
        return np.vstack([self.entry_m, self.between_m, self.end_m])

    @property
    def is_straight(self) -> bool:
        """Whether there are two points only."""
        return len(self.points_m) == 2

    @property
    def panels(self) -> int:
        """Several between two points, where the third derivative jumps."""
        return max(PANELS, 16 * len(self.points_m))

    @cached_property
    def _spline(self) -> CubicSpline:
        lengths = np.linalg.norm(np.diff(self.points_m, axis=0), axis=1)
        knots = np.concatenate([[0.0], np.cumsum(lengths)]) / lengths.sum()
        knots[-1] = 1.0
        from scipy.interpolate import CubicSpline  # slow to import, and most paths need none

        return CubicSpline(knots, self.points_m, bc_type="natural")

    def _at(self, u: Floats, order: int) -> Floats:
        found: Floats = self._spline(np.atleast_1d(np.asarray(u, dtype=float)), order)
        return found

    def curve(self, u: Floats) -> Floats:
        """Points (n, 3) m at the parameters u (n,) in [0, 1]."""
        return self._at(u, 0)

    def derivative(self, u: Floats) -> Floats:
        """Derivatives d curve / du (n, 3) m at the parameters u (n,)."""
        return self._at(u, 1)

    def second_derivative(self, u: Floats) -> Floats:
        """Derivatives d2 curve / du2 (n, 3) m at the parameters u (n,)."""
        return self._at(u, 2)
