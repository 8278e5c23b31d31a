"""How campaigns are going: one of them, or a page of the list."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from service.store.paging import Page, read_page

if TYPE_CHECKING:
    from collections.abc import Sequence

    from service.store.campaign import Campaign, Tally
    from service.store.campaigns import CampaignStore


@dataclass(frozen=True, kw_only=True)
class CampaignOverview:
    """A campaign and how far it is. now: UTC seconds since 1970."""

    campaign: Campaign
    tally: Tally
    now: float

    @property
    def fraction(self) -> float:
        """Share of its steps that are done, 0 to 1."""
        return 1.0 if self.campaign.terminal else self.tally.steps_done / max(self.tally.steps, 1)

    @property
    def eta_s(self) -> float | None:
        """Seconds to its end, from the pace so far; None when nothing is known."""
        if self.campaign.terminal:
            return 0.0
        fraction = self.fraction
        return (self.now - self.campaign.created_at) * (1.0 - fraction) / fraction if fraction > 0.0 else None


def overview(campaigns: CampaignStore, campaign: Campaign, *, now: float) -> CampaignOverview:
    """One campaign, with its progress."""
    return overviews(campaigns, [campaign], now=now)[0]


def overviews(campaigns: CampaignStore, chosen: Sequence[Campaign], *, now: float) -> list[CampaignOverview]:
    """Campaigns in the given order, with their progress."""
    tallies = campaigns.tally(chosen)
    return [CampaignOverview(campaign=campaign, tally=tallies[campaign.id], now=now) for campaign in chosen]


def campaign_page(
    campaigns: CampaignStore, *, suite: str | None, state: str | None, size: int, cursor: str | None, now: float
) -> Page[CampaignOverview]:
    """A page of the list of campaigns, newest first, only those of a suite or in a state if one is given."""

    def newest(limit: int, before: int | None) -> list[Campaign]:
        return campaigns.newest(suite=suite, state=state, limit=limit, before=before)

    page = read_page(newest, size=size, cursor=cursor)
    return Page(overviews(campaigns, page.items, now=now), page.next_cursor)
