"""Where a history of numbers changes its level: a piecewise constant fit, as asv has it for timings.

The history is cut in two where the absolute deviations from the medians of both parts are smallest, as long as the
medians differ by more than the noise, and each part again.
"""

from __future__ import annotations

import itertools
import statistics
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

LEAST = 2  # points on each side of a step: one alone may be an outlier
SPREADS = 4.0  # [ours] robust standard deviations by which levels must differ
SHARE = 0.01  # [ours] and at least this share of the level before
_NORMAL = 1.4826 / 2**0.5  # median absolute difference of neighbours -> standard deviation, for a normal distribution


@dataclass(frozen=True)
class LevelStep:
    """The level changes at point `at`, from `before` to `after`, medians of the stretches on both sides."""

    at: int
    before: float
    after: float


def level_steps(values: Sequence[float]) -> list[LevelStep]:
    """The steps of a history, oldest first; none of one too short to have any."""
    if len(values) < 2 * LEAST:
        return []
    noise = _NORMAL * statistics.median(abs(b - a) for a, b in itertools.pairwise(values))
    cuts = sorted(_cuts(values, 0, len(values), noise))
    edges = [0, *cuts, len(values)]
    levels = [statistics.median(values[a:b]) for a, b in itertools.pairwise(edges)]
    return [LevelStep(at, before, after) for at, before, after in zip(cuts, levels, levels[1:], strict=False)]


def _cuts(values: Sequence[float], start: int, end: int, noise: float) -> list[int]:
    """Where the stretch from `start` to `end` is cut."""
    places = range(start + LEAST, end - LEAST + 1)
    if not places:
        return []
    cut = min(places, key=lambda at: _misfit(values[start:at]) + _misfit(values[at:end]))
    before, after = statistics.median(values[start:cut]), statistics.median(values[cut:end])
    if abs(after - before) <= max(SPREADS * noise, SHARE * abs(before)):
        return []
    return [*_cuts(values, start, cut, noise), cut, *_cuts(values, cut, end, noise)]


def _misfit(values: Sequence[float]) -> float:
    middle = statistics.median(values)
    return sum(abs(value - middle) for value in values)
