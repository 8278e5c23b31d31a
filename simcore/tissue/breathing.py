"""Prescribed motion of the held nodes: breathing.

One harmonic that starts at rest in the reference position (the respiratory curve of Lujan et al. 1999 with n = 1):

    u(t) = A (1 - cos(2 pi t / T)) d = 2 A sin^2(pi t / T) d,        u(0) = u'(0) = 0,      u(T / 2) = 2 A d

A is half of the peak-to-peak excursion, T the period, d a unit vector. The held nodes go from their place in the
reference shape to 2 A along d and back; the acceleration alone jumps, at t = 0, from nothing to A (2 pi / T)^2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from simcore.elementary_kernels import sine_cosine

if TYPE_CHECKING:
    from simcore.arrays import Floats


@dataclass(frozen=True)
class BreathingMotion:
    """Constants of the motion: amplitude_m = half of peak to peak, period_s, direction (3,) unit, world."""

    amplitude_m: float
    period_s: float
    direction: Floats

    def shift_m(self, t_s: float) -> Floats:
        """(3,) m, world: displacement of every held node from the reference shape at time t."""
        share = sine_cosine(np.pi * ((t_s / self.period_s) % 1.0))[0] ** 2
        shift: Floats = 2.0 * self.amplitude_m * share * self.direction
        return shift
