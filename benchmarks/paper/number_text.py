"""Numbers in the words of claims and tables, with a true minus."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from benchmarks.paper.statistics import Interval


def share_text(value: float, interval: Interval) -> str:
    """A share and its interval, in per cent."""
    text = f"{100 * value:.1f} % [{100 * interval.low:.1f}, {100 * interval.high:.1f}]"
    return text.replace("-", "−")


def millimetres(value: float) -> str:
    """An error to the micrometre; infinite for a failure."""
    return "-" if math.isnan(value) else "failure" if math.isinf(value) else f"{value:.3f} mm"


def error_text(value: float | None) -> str:
    """An error in mm for a column, one more digit below ten micrometres; None, which JSON has for it, is a failure."""
    return "failed" if value is None else f"{value:.4f}" if abs(value) < 0.01 else f"{value:.3f}"


def signed_text(value: float) -> str:
    """A difference in mm, one more digit below a micrometre; infinite between a failure and another insertion."""
    if math.isinf(value):
        return "+∞" if value > 0.0 else "−∞"
    text = f"{value:+.4f}" if abs(value) < 1e-3 else f"{value:+.3f}"
    return text.replace("-", "−") if float(text) else "0.000"


def effect_text(value: float) -> str:
    """An effect size between -1 and 1."""
    return f"{value:+.2f}".replace("-", "−")


def p_value(value: float) -> str:
    """Two digits; nan of what was not tested."""
    if math.isnan(value):
        return "unknown (not tested)"
    return f"{value:.2g}" if value >= 1e-3 else f"{value:.0e}"
