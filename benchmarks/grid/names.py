"""What people call the cases of a grid: the arm, then whatever else differs, as in "elm, E 5.5, seed 3"."""

from __future__ import annotations

import json
import re
from collections import Counter
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from benchmarks.cases import Label

LONGEST = 90  # characters of a case's name, which its scenario is given too
_SYMBOLS = {"tissue.young_kpa": "E", "tissue.poisson": "nu", "tissue.element_size_mm": "h", "dt_s": "dt"}
_UNITS = ("mm", "kpa", "mpa", "s", "n", "hz", "deg")
_OUTSIDE = re.compile(r"[^\w .,+()-]")  # what neither a file name nor a scenario's name should hold


def label(value: Any) -> Label:
    """A value of an axis as the label of its cases."""
    return value if isinstance(value, str | int | float) and not isinstance(value, bool) else json.dumps(value)


def field_name(path: str) -> str:
    """A field in a word or two: a symbol, else the last part of its path without the unit."""
    if path in _SYMBOLS:
        return _SYMBOLS[path]
    words = path.rpartition(".")[2].split("_")
    return " ".join(words[:-1] if len(words) > 1 and words[-1] in _UNITS else words)


def value_names(path: str, values: Sequence[Any]) -> list[str]:
    """A short text for each value of an axis, no two the same: paths by kind and target, other blocks by kind."""
    texts = [_value_name(path, value) for value in values]
    counts, seen = Counter(texts), Counter[str]()
    names = []
    for text in texts:
        seen[text] += 1
        names.append(text if counts[text] == 1 else f"{text} no. {seen[text]}")
    return names


def _value_name(path: str, value: Any) -> str:
    if isinstance(value, dict):
        kind = str(value.get("kind", path))
        target = value.get("target_mm")
        return f"{kind} to {_numbers(target)}" if isinstance(target, list) else kind
    if isinstance(value, list):
        return f"{field_name(path)} {_numbers(value)}"
    if path.endswith("kind"):
        return str(value)
    return f"{field_name(path)} {value if isinstance(value, str) else json.dumps(value)}"


def _numbers(values: Sequence[Any]) -> str:
    text = " ".join(f"{value:g}" if isinstance(value, int | float) else str(value) for value in values)
    return text if len(text) <= LONGEST // 3 else f"{text[: LONGEST // 3 - 3]}..."


def case_names(arms: Sequence[str], places: Sequence[Mapping[str, str]]) -> list[str]:
    """The name of each case: its arm, and the texts of `value_names` by axis; good as a file name, no two the same."""
    texts = [_OUTSIDE.sub(" ", ", ".join([arm, *place.values()])) for arm, place in zip(arms, places, strict=True)]
    counts = Counter(texts)
    return [
        text if counts[text] == 1 and len(text) <= LONGEST else f"{text[: LONGEST - 12]} no. {number + 1}"
        for number, text in enumerate(texts)
    ]
