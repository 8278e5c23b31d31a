"""What the cases of a campaign have measured, kept in memory until one of its jobs changes: a large one is looked at
again and again, and most of it has ended long ago."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import TYPE_CHECKING

from benchmarks.cautions import Caution, cautions
from benchmarks.paper.table import arms, main_rows, rows
from service.campaigns.cases import CaseResult, Score, scores
from service.campaigns.results import outcomes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from service.store.campaign import CampaignCase
    from service.store.campaigns import CampaignStore

_MOST = 10_000  # cases in memory, about 2 kB each


@dataclass(frozen=True, kw_only=True)
class Measured:
    """results: of every case, in the order of the suite. scores: of each group and arm. arms: that have a main row.
    ended: how many cases have. cautions: what the results warn of."""

    results: list[CaseResult]
    scores: list[Score]
    arms: list[str]
    ended: int
    cautions: list[Caution]

    @classmethod
    def of(cls, cases: Sequence[CampaignCase]) -> Measured:
        """Of cases as they were read."""
        table = rows(outcomes(cases))
        return cls(
            results=[CaseResult.of(case) for case in cases],
            scores=scores(table),
            arms=arms(main_rows(table)),
            ended=len(table),
            cautions=cautions((row.id, row.warnings) for row in table),
        )


class MeasuredCampaigns:
    """Of the campaigns requested last."""

    def __init__(self, campaigns: CampaignStore, *, most: int = _MOST) -> None:
        self._campaigns = campaigns
        self._most = most
        self._lock = threading.Lock()
        self._known: dict[str, tuple[tuple[int, int], Measured]] = {}  # least recently requested first

    def of(self, campaign_id: str) -> Measured:
        """What was measured so far. Raises UnknownCampaignError."""
        version = self._campaigns.version_of_jobs(
            campaign_id
        )  # before the cases: what changes in between is read again
        with self._lock:
            known = self._known.pop(campaign_id, None)
            if known is not None and known[0] == version:
                self._known[campaign_id] = known
                return known[1]
        found = Measured.of(self._campaigns.cases(campaign_id, whole=False))
        with self._lock:
            self._known[campaign_id] = version, found
            while sum(len(one.results) for _, one in self._known.values()) > self._most:
                del self._known[next(iter(self._known))]
        return found
