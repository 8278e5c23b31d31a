"""The path that the tip is asked to follow, and the moving target on it (simcore/README.md).

A path is `entry + u (end - entry) + A sin(2 pi n u) d`, u in [0, 1]; a line has A = 0. The target slides along it
by arc length at constant speed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from simcore.arrays import Floats

_PANELS = 512
_NARROWINGS = 40  # of the bracket around the nearest point: (2/3)^40 of a millimetre is below a nanometre
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(6)


@dataclass(frozen=True)
class Path:
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
        axis = self.chord / np.linalg.norm(self.chord)
        across = self.direction - (self.direction @ axis) * axis
        return across / np.linalg.norm(across)

    @property
    def chord(self) -> Floats:
        """(3,) m from the entry to the end."""
        return self.end_m - self.entry_m

    @property
    def is_straight(self) -> bool:
        """Whether it has no overlay."""
        return self.amplitude_m == 0.0

    def curve(self, u: Floats) -> Floats:
        """Points (n, 3) m at the parameters u (n,) in [0, 1]."""
        u = np.atleast_1d(np.asarray(u, dtype=float))
        wave = self.amplitude_m * np.sin(2 * np.pi * self.periods * u)
        return self.entry_m + u[:, None] * self.chord + wave[:, None] * self.overlay

    def derivative(self, u: Floats) -> Floats:
        """Derivatives d curve / du (n, 3) m at the parameters u (n,)."""
        u = np.atleast_1d(np.asarray(u, dtype=float))
        k = 2 * np.pi * self.periods
        slope = self.amplitude_m * k * np.cos(k * u)
        return self.chord + slope[:, None] * self.overlay

    @cached_property
    def _table(self) -> tuple[Floats, Floats]:
        """Panel ends u (p + 1,) and the arc length up to each, by Gauss-Legendre quadrature."""
        u = np.linspace(0.0, 1.0, _PANELS + 1)
        half = 0.5 / _PANELS
        middles = u[:-1] + half
        points = (middles[:, None] + half * _NODES).ravel()
        speeds = np.linalg.norm(self.derivative(points), axis=1).reshape(_PANELS, -1)
        return u, np.concatenate([[0.0], np.cumsum(half * speeds @ _WEIGHTS)])

    @cached_property
    def length_m(self) -> float:
        """Arc length of the whole path, m."""
        if self.is_straight:
            return float(np.linalg.norm(self.chord))
        return float(self._table[1][-1])

    def parameter(self, s_m: Floats) -> Floats:
        """Parameters u (n,) at the arc lengths s_m (n,), clipped to the path."""
        s_m = np.clip(np.atleast_1d(np.asarray(s_m, dtype=float)), 0.0, self.length_m)
        if self.is_straight:
            return s_m / self.length_m
        u, lengths = self._table
        panel = np.clip(np.searchsorted(lengths, s_m, side="right") - 1, 0, _PANELS - 1)
        guess = np.interp(s_m, lengths, u)
        for _ in range(3):
            half = 0.5 * (guess - u[panel])
            points = (u[panel] + half)[:, None] + half[:, None] * _NODES
            speeds = np.linalg.norm(self.derivative(points.ravel()), axis=1).reshape(points.shape)
            excess = lengths[panel] + half * (speeds @ _WEIGHTS) - s_m
            guess = np.clip(guess - excess / np.linalg.norm(self.derivative(guess), axis=1), 0.0, 1.0)
        return guess

    def point(self, s_m: Floats) -> Floats:
        """Points (n, 3) m at the arc lengths s_m (n,) m; beyond the end, the end."""
        return self.curve(self.parameter(s_m))

    def first_tangent(self) -> Floats:
        """(3,) unit tangent at the entry: the direction in which the needle waits."""
        tangent: Floats = self.derivative(np.zeros(1))[0]
        tangent /= np.linalg.norm(tangent)
        return tangent

    def distance_m(self, points: Floats) -> Floats:
        """Cross-track distance (n,) m of points (n, 3) from the path: the nearest of dense samples, then a ternary
        search between its neighbours, which holds beyond the centre of curvature too."""
        points = np.atleast_2d(points)
        u = np.linspace(0.0, 1.0, 4 * _PANELS + 1)
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


def polyline_distance_m(point: Floats, line: Floats) -> float:
    """Distance, m, of a point (3,) m from the polyline through line (k, 3) m, k at least 2."""
    start, along = line[:-1], np.diff(line, axis=0)
    length = np.maximum(np.sum(along**2, axis=1), np.finfo(float).tiny)
    share = np.clip(np.sum((point - start) * along, axis=1) / length, 0.0, 1.0)
    gaps = start + share[:, None] * along - point
    return float(np.sqrt(np.sum(gaps**2, axis=1).min()))


def step_count(path_length_m: float, speed_m_s: float, dt_s: float) -> int:
    """ceil(path length / (speed dt)); a quotient within 1e-9 of a whole number counts as whole."""
    steps = path_length_m / (speed_m_s * dt_s)
    return max(1, math.ceil(steps - 1e-9 * max(1.0, steps)))


def targets(path: Path, *, speed_m_s: float, dt_s: float, steps: int) -> Floats:
    """n_traj(t_i), (steps + 1, 3) m: row 0 the entry, row i at arc length speed * i * dt, clipped to the end."""
    return path.point(speed_m_s * dt_s * np.arange(steps + 1, dtype=np.float64))


def held_noise(rng: np.random.Generator, *, amplitude_m: float, hold_s: float, dt_s: float, steps: int) -> Floats:
    """Uniform noise (steps + 1, 3) m in +-amplitude per axis, redrawn every `hold_s` and held between.

    Redrawing by time and not by step makes the noise mean the same at every dt.
    """
    if amplitude_m == 0.0:
        return np.zeros((steps + 1, 3))
    window = np.floor(np.arange(steps + 1) * (dt_s / hold_s) + 1e-9).astype(int)
    draws = rng.uniform(-amplitude_m, amplitude_m, (int(window[-1]) + 1, 3))
    held: Floats = draws[window]
    return held
