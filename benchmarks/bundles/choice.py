"""Which cases are looked at more closely: chosen by a seed, the same on every machine."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence


def chosen_cases(ids: Sequence[str], count: int, seed: int) -> list[str]:
    """`count` of the ids, or all if there are fewer: those whose SHA-256 with the seed is smallest, in that order. A
    case that joins or leaves changes nothing for the others."""
    return sorted(ids, key=lambda one: hashlib.sha256(f"{seed}\0{one}".encode()).hexdigest())[:count]
