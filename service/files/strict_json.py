"""JSON as the standard has it: without NaN and infinities, in text that can be encoded."""

from __future__ import annotations

import json
import math
from typing import Any

from simcore.errors import NeedlebenchError


class NotJsonError(NeedlebenchError, ValueError):
    """A value that JSON has no form for, or that is too long in it; the message says which, without a subject."""


def without_nan(value: Any) -> Any:
    """The same JSON data with null for every number that is not finite."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: without_nan(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [without_nan(item) for item in value]
    return value


def plain_json(value: Any, *, most_mb: float) -> Any:
    """What a reader of the value's JSON gets: null for what is not finite, `?` for half a surrogate pair.

    most_mb: 10^6 bytes that the JSON may have. Raises NotJsonError.
    """
    try:
        text = json.dumps(without_nan(value), allow_nan=False, ensure_ascii=False).encode("utf-8", "replace")
    except (TypeError, ValueError, RecursionError) as error:
        raise NotJsonError(f"cannot be encoded: {type(error).__name__}: {error}") from error
    if len(text) > most_mb * 1e6:
        raise NotJsonError(f"is too long: {len(text) / 1e6:.1f} MB, at most {most_mb:g} are kept")
    return json.loads(text)
