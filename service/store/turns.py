"""Whose turn it is within a priority: keys take turns, and within a key its campaigns and its single jobs do.

A lane is one of these: `owner/campaign`, either part empty. Who was served longest ago comes first, then the
oldest job.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

_MOST = 10_000  # keys and lanes that are remembered


def lane_of(owner: str | None, campaign_id: str | None = None) -> str:
    """The lane of a job."""
    return f"{owner or ''}/{campaign_id or ''}"


class Turns:
    """Who was served when, by a count; kept in memory, so that a new start begins with the oldest job."""

    def __init__(self) -> None:
        self._served: OrderedDict[str, int] = OrderedDict()
        self._count = 0

    def choose(self, oldest: Mapping[str, int]) -> str:
        """The lane whose turn it is. oldest: lane -> number of its oldest queued job, at least one lane."""
        firsts: dict[str, int] = {}
        for lane, number in oldest.items():
            owner = _owner(lane)
            firsts[owner] = min(number, firsts.get(owner, number))
        owner = min(firsts, key=lambda one: (self._served.get(one, 0), firsts[one]))
        own = [lane for lane in oldest if _owner(lane) == owner]
        return min(own, key=lambda lane: (self._served.get(lane, 0), oldest[lane]))

    def serve(self, lane: str) -> None:
        """It has had its turn."""
        self._count += 1
        for name in (_owner(lane), lane):
            self._served[name] = self._count
            self._served.move_to_end(name)
        while len(self._served) > _MOST:
            self._served.popitem(last=False)


def ahead_of(lane: str, earlier: int, waiting: Mapping[str, int]) -> int:
    """At most so many jobs of the same priority begin before one that has `earlier` jobs before it in its own lane.

    waiting: lane -> number of its queued jobs.
    """
    owner = _owner(lane)
    others = {name: count for name, count in waiting.items() if name != lane}
    mine = earlier + sum(min(count, earlier + 1) for name, count in others.items() if _owner(name) == owner)
    by_owner: dict[str, int] = {}
    for name, count in others.items():
        if (other := _owner(name)) != owner:
            by_owner[other] = by_owner.get(other, 0) + count
    return mine + sum(min(count, mine + 1) for count in by_owner.values())


def _owner(lane: str) -> str:
    return lane.partition("/")[0]  # without the stroke: no lane is called so
