"""Rows of the tables of campaigns, and what is asked of all jobs of one, within a transaction of the caller's."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from sqlalchemy import Connection, Row, Select, case, func, select

from service.store import schema
from service.store.campaign import Campaign, CampaignActiveError, CampaignCase, CampaignPinnedError, Tally
from service.store.job import TERMINAL
from service.store.schema import campaign_case as _case

_job = schema.job


def check_removable(connection: Connection, campaign_id: str, mine: Select[Any]) -> None:
    """Each job must be one that could be deleted by itself: at its end and not pinned."""
    active = select(_job.c.id).where(_job.c.id.in_(mine), _job.c.state.not_in(sorted(TERMINAL))).limit(1)
    if (job := connection.execute(active).scalar_one_or_none()) is not None:
        raise CampaignActiveError(f"job {job} of campaign {campaign_id} has not ended: cancel it first")
    pinned = select(_job.c.id).where(_job.c.id.in_(mine), _job.c.pinned).limit(1)
    if (job := connection.execute(pinned).scalar_one_or_none()) is not None:
        raise CampaignPinnedError(f"job {job} of campaign {campaign_id} is pinned: unpin it first")


def tally_of(connection: Connection, campaign_id: str) -> Tally:
    """How many of its jobs are in which state, and how many steps are done."""
    done = case((_job.c.state.in_(sorted(TERMINAL)), _job.c.steps), else_=0)
    query = (
        select(_job.c.state, func.count(), func.sum(_job.c.steps), func.sum(done))
        .join(_case, _case.c.job_id == _job.c.id)
        .where(_case.c.campaign_id == campaign_id)
        .group_by(_job.c.state)
    )
    rows = connection.execute(query).all()
    return Tally(
        states={row[0]: row[1] for row in rows},
        steps=sum(row[2] for row in rows),
        steps_done=sum(row[3] for row in rows),
    )


def to_campaign(row: Row[Any]) -> Campaign:
    """A row of the campaign table."""
    columns = {field.name: getattr(row, field.name) for field in fields(Campaign)}
    return Campaign(**{**columns, "timeout_s": float(columns["timeout_s"])})


def to_case(row: Row[Any], results: bool) -> CampaignCase:
    """A row of a campaign's cases, with its result if it is wanted."""
    result = (row.of_job or row.outcome) if results else None
    names = ("number", "case_id", "labels", "job_id", "state", "error_kind", "error")
    return CampaignCase(**{name: getattr(row, name) for name in names}, result=result)
