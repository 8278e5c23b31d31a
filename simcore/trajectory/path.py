"""A path by arc length: points at constant speed, distances from it, curvature."""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from simcore.linear_algebra.products import norm, times

if TYPE_CHECKING:
    from simcore.arrays import Floats

PANELS = 512
_NARROWINGS = 40  # of the bracket around the nearest point: (2/3)^40 of a millimetre is below a nanometre
# Gauss-Legendre, exact to degree 11 (Abramowitz and Stegun, 1964, table 25.4)
_HALF = np.array([0.2386191860831969086305, 0.6612093864662645136614, 0.9324695142031520278123])
_HALF_WEIGHTS = np.array([0.4679139345726910473899, 0.3607615730481386075698, 0.1713244923791703450403])
_NODES, _WEIGHTS = np.concatenate([-_HALF[::-1], _HALF]), np.concatenate([_HALF_WEIGHTS[::-1], _HALF_WEIGHTS])


class Path(ABC):
    """A curve in rest space, and what follows from it by arc length. entry_m, end_m: (3,) m."""

    entry_m: Floats
    end_m: Floats

    @abstractmethod
    def curve(self, u: Floats) -> Floats:
        """Points (n, 3) m at the parameters u (n,) in [0, 1]."""

    @abstractmethod
    def derivative(self, u: Floats) -> Floats:
        """Derivatives d curve / du (n, 3) m at the parameters u (n,)."""

    @abstractmethod
    def second_derivative(self, u: Floats) -> Floats:
        """Derivatives d2 curve / du2 (n, 3) m at the parameters u (n,)."""

    @property
    def chord(self) -> Floats:
        """(3,) m from the entry to the end."""
        return self.end_m - self.entry_m

    @property
    def is_straight(self) -> bool:
        """Whether it is its chord."""
        return False

    @property
    def panels(self) -> int:
        """Of the quadrature of its length."""
        return PANELS

    def curvature_per_m(self, u: Floats) -> Floats:
        """|r' x r\"| / |r'|^3 (n,) 1/m at the parameters u (n,)."""
        slope = self.derivative(u)
        bend = np.linalg.norm(np.cross(slope, self.second_derivative(u)), axis=1)
        found: Floats = bend / np.linalg.norm(slope, axis=1) ** 3
        return found

    @cached_property
    def _table(self) -> tuple[Floats, Floats]:
        """Panel ends u (p + 1,) and the arc length up to each, by Gauss-Legendre quadrature."""
        u = np.linspace(0.0, 1.0, self.panels + 1)
        half = 0.5 / self.panels
        middles = u[:-1] + half
        points = (middles[:, None] + half * _NODES).ravel()
        speeds = np.linalg.norm(self.derivative(points), axis=1).reshape(self.panels, -1)
        return u, np.concatenate([[0.0], np.cumsum(half * times(speeds, _WEIGHTS))])

    @cached_property
    def length_m(self) -> float:
        """Arc length of the whole path, m."""
        if self.is_straight:
            return norm(self.chord)
        return float(self._table[1][-1])

    def parameter(self, s_m: Floats) -> Floats:
        """Parameters u (n,) at the arc lengths s_m (n,), clipped to the path."""
        s_m = np.clip(np.atleast_1d(np.asarray(s_m, dtype=float)), 0.0, self.length_m)
        if self.is_straight:
            return s_m / self.length_m
        u, lengths = self._table
        panel = np.clip(np.searchsorted(lengths, s_m, side="right") - 1, 0, self.panels - 1)
        guess = np.interp(s_m, lengths, u)
        for _ in range(3):
            half = 0.5 * (guess - u[panel])
            points = (u[panel] + half)[:, None] + half[:, None] * _NODES
            speeds = np.linalg.norm(self.derivative(points.ravel()), axis=1).reshape(points.shape)
            excess = lengths[panel] + half * times(speeds, _WEIGHTS) - s_m
            guess = np.clip(guess - excess / np.linalg.norm(self.derivative(guess), axis=1), 0.0, 1.0)
        return guess

    def point(self, s_m: Floats) -> Floats:
        """Points (n, 3) m at the arc lengths s_m (n,) m; beyond the end, the end."""
        return self.curve(self.parameter(s_m))

    def first_tangent(self) -> Floats:
        """(3,) unit tangent at the entry: the direction in which the needle waits."""
        tangent: Floats = self.derivative(np.zeros(1))[0]
        tangent /= norm(tangent)
        return tangent

    def distance_m(self, points: Floats) -> Floats:
        """Cross-track distance (n,) m of points (n, 3) from the path: the nearest of dense samples, then a ternary
        search between its neighbours, which holds beyond the centre of curvature too."""
        points = np.atleast_2d(points)
        u = np.linspace(0.0, 1.0, 4 * self.panels + 1)
        samples = self.curve(u)
        nearest = np.array([np.argmin(np.sum((samples - point) ** 2, axis=1)) for point in points])
        low, high = u[np.maximum(nearest - 1, 0)], u[np.minimum(nearest + 1, len(u) - 1)]
        for _ in range(_NARROWINGS):
            third = (high - low) / 3
            nearer = self._gaps(low + third, points) < self._gaps(high - third, points)
            low, high = np.where(nearer, low, low + third), np.where(nearer, high - third, high)
        return self._gaps(0.5 * (low + high), points)

    def _gaps(self, u: Floats, points: Floats) -> Floats:
        """Distances (n,) m between the path at u (n,) and points (n, 3)."""
        gaps: Floats = np.linalg.norm(self.curve(u) - points, axis=1)
        return gaps
