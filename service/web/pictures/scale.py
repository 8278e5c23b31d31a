"""From a value to one of a few shades, the same in every picture of the pages."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from service.campaigns.cases import MEASURES

if TYPE_CHECKING:
    from collections.abc import Iterable

    from service.campaigns.cases import CaseResult

SHADES = 7  # heat-0 to heat-6 of the style sheet
WIDE = 30.0  # ratio of the largest to the smallest value from which a scale is logarithmic


@dataclass(frozen=True)
class Scale:
    """low, high: of the known values. log: shades are even steps of the logarithm."""

    low: float
    high: float
    log: bool

    @classmethod
    def of(cls, values: Iterable[float]) -> Scale | None:
        """Around these values; None without any that is finite."""
        known = [value for value in values if math.isfinite(value)]
        if not known:
            return None
        low, high = min(known), max(known)
        return cls(low, high, low > 0.0 and high >= WIDE * low)

    def shade(self, value: float) -> int:
        """0 for the lowest values to SHADES - 1 for the highest."""
        low, high, at = (math.log(v) if self.log else v for v in (self.low, self.high, value))
        if high <= low:
            return 0
        return min(SHADES - 1, max(0, int(SHADES * (at - low) / (high - low))))

    @property
    def edges(self) -> list[float]:
        """SHADES + 1 values between which the shades lie."""
        shares = [i / SHADES for i in range(SHADES + 1)]
        if self.log:
            return [self.low * (self.high / self.low) ** share for share in shares]
        return [self.low + (self.high - self.low) * share for share in shares]


def measured(case: CaseResult, name: str) -> float | None:
    """A measure of a case by its name in `MEASURES`; None where it has none."""
    value = case.value(MEASURES[name].field)
    return float(value) if isinstance(value, int | float) and math.isfinite(value) else None
