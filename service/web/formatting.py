"""Values as people read them, for the templates."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any
from zoneinfo import ZoneInfo

from benchmarks.paper.table import arm_name

ABSENT = "–"
STATES = {
    "queued": "waiting",
    "running": "running",
    "finished": "finished",
    "success": "success",
    "missed": "missed its target",
    "failed": "failed",
    "cancelled": "cancelled",
    "timed_out": "timed out",
    "done": "done",
}


def state(name: str | None) -> str:
    """A state or an outcome in words."""
    return STATES.get(name or "", (name or "deleted").replace("_", " "))


def number(value: Any, digits: int = 3, unit: str = "") -> str:
    """With so many decimals, and at least two significant digits; a dash for None."""
    if value is None or isinstance(value, bool) or not isinstance(value, int | float):
        return ABSENT
    if abs(value) > 1e300:
        return ABSENT
    small = 0.0 < abs(value) < 10.0 ** (1 - digits) and digits > 1
    return f"{value:.2g} {unit}".rstrip() if small else f"{value:.{digits}f} {unit}".rstrip()


def span(seconds: float | None) -> str:
    """A duration: 48 s, 3 min 20 s, 2 h 5 min, 3 d 4 h."""
    if seconds is None:
        return ABSENT
    if seconds < 60:
        return f"{seconds:.1f} s" if seconds < 10 else f"{seconds:.0f} s"
    whole = round(seconds)
    for unit, below, size in (("d", "h", 86400), ("h", "min", 3600), ("min", "s", 60)):
        if whole >= size:
            rest = (whole % size) * {"h": 24, "min": 60, "s": 60}[below] // size
            return f"{whole // size} {unit} {rest} {below}" if rest else f"{whole // size} {unit}"
    raise AssertionError("unreachable")


def when(moment: datetime | float | None) -> str:
    """2026-11-22 06:20:03, UTC."""
    if moment is None:
        return ABSENT
    time = datetime.fromtimestamp(moment, UTC) if isinstance(moment, int | float) else moment.astimezone(UTC)
    return f"{time:%Y-%m-%d %H:%M:%S}"


def local_time(moment: datetime, zone: str) -> str:
    """The time of day in a time zone, as in 06:20."""
    return f"{moment.astimezone(ZoneInfo(zone)):%H:%M}"


def sentence(one: dict[str, Any]) -> str:
    """A comparison (as `benchmarks.paper.comparison.as_json` writes it) in words: what was tested, over how many of
    which unit, and why there are not more."""
    why = "".join(f" Note: {note}." for note in one["notes"])
    return f"{_finding(one)}{why}"


def _finding(one: dict[str, Any]) -> str:
    first, second, difference = arm_name(one["first"]), arm_name(one["second"]), one["difference_mm"]
    basis = _count(one["clusters"], one["unit"])
    if one["pairs"] != one["clusters"]:
        basis += f" of {_count(one['pairs'], 'pair')}"
    if difference is None:
        return f"{first} and {second}: no difference, as one of them failed in the median; {basis}."
    p = one["p_primary"] if one["p_holm"] is None else one["p_holm"]
    if p is None:
        better, worse = (first, second) if difference <= 0.0 else (second, first)
        return f"{better} has an RMSE {abs(difference):.4f} mm below that of {worse}; {basis}: nothing is tested."
    low, high = one["difference_interval_mm"]
    interval = f"95 % interval {_bound(low)} to {_bound(high)} mm"
    proof = f"sign test over {basis}: {_probability(p)}, adjusted by Holm"
    if difference == 0.0:
        return f"{first} and {second} have the same RMSE in the median ({proof})."
    better, worse = (first, second) if difference < 0.0 else (second, first)
    lead = f"{better} has a smaller RMSE than {worse}, by {abs(difference):.4f} mm in the median ({interval}; {proof})"
    if p < 0.05:
        return f"{lead}: this is unlikely to be chance."
    if one["equivalent"]:
        return f"{lead}: the two are shown to be equivalent."
    if one["clusters"] < one["fewest"]:
        return f"{lead}: {_count(one['clusters'], one['unit'])} are too few to tell this from chance."
    return f"{lead}: this is within what chance would give."


def interval(ends: list[float | None], digits: int) -> str:
    """An interval behind its value; nothing where there is none."""
    low, high = ends
    return "" if low is None and high is None else f" [{number(low, digits)}, {number(high, digits)}]"


def _bound(value: float | None) -> str:
    return "unbounded" if value is None else f"{value:+.4f}"


def _count(number: int, thing: str) -> str:
    return f"{number} {thing}" if number == 1 else f"{number} {thing}s"


def _probability(p: float | None) -> str:
    if p is None:
        return "p unknown"
    return "p < 0.001" if p < 1e-3 else f"p = {p:.2g}"
