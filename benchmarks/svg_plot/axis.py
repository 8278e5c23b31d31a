"""Axes: from values to pixels, round ticks, ranges with some air."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Axis:
    """Maps values to pixels; `start` may be larger than `end`, as on a vertical axis."""

    low: float
    high: float
    start: float
    end: float
    log: bool

    def usable(self, value: float) -> bool:
        """Whether the value has a place on this axis."""
        return math.isfinite(value) and (value > 0.0 or not self.log)

    def at(self, value: float) -> float:
        """Pixel of a value."""
        low, high, value = (math.log10(v) if self.log else v for v in (self.low, self.high, value))
        return self.start + (value - low) / (high - low) * (self.end - self.start)

    def ticks(self) -> list[float]:
        """Round values within the range."""
        return log_ticks(self.low, self.high) if self.log else linear_ticks(self.low, self.high)


def linear_ticks(low: float, high: float, wanted: int = 6) -> list[float]:
    """Multiples of 1, 2 or 5 times a power of ten, about `wanted` of them."""
    raw = (high - low) / wanted
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(m * power for m in (1.0, 2.0, 5.0, 10.0) if m * power >= raw * 0.999)
    first = math.ceil(low / step - 1e-9)
    last = math.floor(high / step + 1e-9)
    return [round(i * step, 12) for i in range(first, last + 1)]


def log_ticks(low: float, high: float) -> list[float]:
    """Powers of ten; with 2 and 5 times them, or more, where less than three would fit; else multiples of one step."""
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    every = -(-len(decades) // 8)
    for steps in ((1.0,), (1.0, 2.0, 5.0), (1.0, 1.5, 2.0, 3.0, 5.0, 7.0), tuple(range(1, 10))):
        values = [m * 10.0**d for d in decades if d % every == 0 for m in steps]
        kept = [v for v in values if low * 0.999 <= v <= high * 1.001]
        if len(kept) >= 3:
            return kept
    return linear_ticks(low, high, 4)


def fitted_axis(values: Sequence[float], start: float, end: float, *, log: bool, tight: bool = False) -> Axis:
    """An axis around the usable values, with some air; from zero where the values nearly reach it."""
    usable = [v for v in values if math.isfinite(v) and (v > 0.0 or not log)]
    low, high = (min(usable), max(usable)) if usable else (1.0, 10.0)
    if log:
        air = 1.0 if tight else max((high / low) ** 0.06, 1.06)
        low, high = (low / air, high * air) if high > low else (low / 2, high * 2)
        return Axis(low, high, start, end, True)
    if 0.0 < low < 0.4 * high:
        low = 0.0
    air = 0.0 if tight else 0.06 * (high - low)
    if high - low <= 1e-12 * max(abs(low), abs(high), 1e-30):
        air = 0.5 * abs(high) or 1.0
    beyond = high if high == 0.0 > low else high + air
    return Axis(low if low == 0.0 else low - air, beyond, start, end, False)
