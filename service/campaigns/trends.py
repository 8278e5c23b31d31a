"""The history of a suite: a point for each campaign, judged against those before it."""

from __future__ import annotations

from benchmarks.trend import Judgement, Point, judged
from service.campaigns.results import outcomes, point, point_json, point_of
from service.store.campaign import Campaign
from service.store.campaigns import CampaignStore

MOST_POINTS = 200


def kept_point(campaigns: CampaignStore, campaign: Campaign) -> Point:
    """The point of a campaign that has ended, kept in the database."""
    found = point(campaign, outcomes(campaigns.cases(campaign.id)))
    campaigns.keep_point(campaign.id, point_json(found))
    return found


def history(campaigns: CampaignStore, suite: str) -> list[tuple[Campaign, Point, Judgement]]:
    """The suite's last campaigns, oldest first. One whose end was cut short is caught up now."""
    found = [
        (campaign, kept_point(campaigns, campaign) if kept is None else point_of(kept))
        for campaign, kept in campaigns.points(suite, limit=MOST_POINTS)
    ]
    marks = judged([one for _, one in found])
    return [(campaign, one, mark) for (campaign, one), mark in zip(found, marks, strict=True)]
