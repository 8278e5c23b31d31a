"""What somebody may have meant: a name close to theirs, a number in another unit, a list as JSON."""

from __future__ import annotations

import difflib
import json
import re
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

# unit of a field by the end of its name -> other units that people use, as multiples of it
UNITS: dict[str, tuple[str, dict[str, float]]] = {
    "_n_per_mm": ("N/mm", {"N/m": 1e-3, "mN/mm": 1e-3}),
    "_kg_m3": ("kg/m3", {"g/cm3": 1e3}),
    "_mm_s": ("mm/s", {"m/s": 1e3, "cm/s": 10.0}),
    "_deg_s": ("deg/s", {"rad/s": 57.29577951308232}),
    "_per_s": ("1/s", {}),
    "_mm": ("mm", {"m": 1e3, "cm": 10.0, "um": 1e-3}),
    "_kpa": ("kPa", {"Pa": 1e-3, "MPa": 1e3, "GPa": 1e6}),
    "_gpa": ("GPa", {"MPa": 1e-3, "kPa": 1e-6, "Pa": 1e-9}),
    "_n": ("N", {"mN": 1e-3}),
    "_s": ("s", {"ms": 1e-3}),
}
_NUMBER = re.compile(r"[-+]?[0-9.]+([eE][-+]?[0-9]+)?")
_WORD = re.compile(r"\w+")


def nearest(name: object, known: Iterable[str]) -> str | None:
    """The known name that `name` is probably meant to be."""
    small = {one.casefold(): one for one in known}
    found = difflib.get_close_matches(str(name)[:100].casefold(), small, n=1, cutoff=0.6)
    return small[found[0]] if found else None


def did_you_mean(name: object, known: Iterable[str]) -> str:
    """`; did you mean NAME?`, or nothing."""
    found = nearest(name, known)
    return f"; did you mean {found}?" if found else ""


def unit_of(field: str) -> str:
    """The unit that the end of a field's name says; nothing for a number without."""
    return next((unit for end, (unit, _) in UNITS.items() if field.endswith(end)), "")


def in_another_unit(field: str, value: Any, low: float | None, high: float | None) -> str:
    """`; is it 6300 Pa? that is 6.3 kPa`, where a number out of its range fits one in another unit; or nothing."""
    if isinstance(value, bool) or not isinstance(value, int | float) or low is None or high is None:
        return ""
    unit, others = next((known for end, known in UNITS.items() if field.endswith(end)), ("", {}))
    for other, scale in others.items():
        if low <= value * scale <= high:
            return f"; is it {value:g} {other}? that is {value * scale:g} {unit}"
    return ""


def point_in_another_unit(point_mm: Sequence[float], fits: Callable[[tuple[float, float, float]], bool]) -> str:
    """`; is it [0.018, 0.031, 0.08] m? that is [18, 31, 80] mm`, where a point that does not fit does in another unit
    of length; or nothing."""
    for unit, scale in UNITS["_mm"][1].items():
        x, y, z = (scale * value for value in point_mm)
        if fits((x, y, z)):
            return f"; is it {_point(point_mm)} {unit}? that is {_point((x, y, z))} mm"
    return ""


def _point(values: Sequence[float]) -> str:
    return f"[{', '.join(f'{value:g}' for value in values)}]"


def as_list(value: Any) -> str:
    """`; write [18,31,80]` for a list that was given as text; or nothing."""
    if not isinstance(value, str) or len(value) > 200:
        return ""
    numbers = re.split(r"[,;\s]+", value.strip())
    if len(numbers) > 1 and all(map(_NUMBER.fullmatch, numbers)):
        return f"; write [{','.join(numbers)}]"
    words = [word.strip() for word in value.split(",")]
    return f"; write {json.dumps(words)}" if all(map(_WORD.fullmatch, words)) else ""
