"""Warnings of many insertions, each said once with how many have it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

NAMED = 3  # cases that are named with a warning
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


@dataclass(frozen=True)
class Caution:
    """A warning in the words of the first case that has it. cases: how many have it, whatever its numbers; first: ids
    of some of them."""

    text: str
    cases: int
    first: tuple[str, ...]


def cautions(warnings: Iterable[tuple[str, Sequence[str]]]) -> list[Caution]:
    """warnings: id of a case -> what it warns of. The most frequent first; texts that differ in numbers are one."""
    texts: dict[str, str] = {}
    members: dict[str, dict[str, None]] = {}
    for case_id, mine in warnings:
        for text in mine:
            kind = _NUMBER.sub("#", text)
            texts.setdefault(kind, text)
            members.setdefault(kind, {})[case_id] = None
    found = [Caution(texts[kind], len(ids), tuple(ids)[:NAMED]) for kind, ids in members.items()]
    return sorted(found, key=lambda one: -one.cases)
