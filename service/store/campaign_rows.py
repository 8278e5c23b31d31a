"""Rows of the tables of campaigns, and what is asked of all jobs of one, within a transaction of the caller's."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from sqlalchemy import ColumnElement, Connection, Row, Select, bindparam, case, func, select, type_coerce

from service.store import schema
from service.store.campaign import RUNNING, Campaign, CampaignActiveError, CampaignCase, CampaignPinnedError, Tally
from service.store.job import QUEUED, TERMINAL
from service.store.job import RUNNING as JOB_RUNNING
from service.store.turns import lane_of

_job, _campaign = schema.job, schema.campaign
_done = case((_job.c.state.in_(sorted(TERMINAL)), _job.c.steps), else_=0)
TALLY = (  # read from an index alone: of a large campaign it is asked every second
    select(_job.c.state, func.count(), func.sum(_job.c.steps), func.sum(_done))
    .where(_job.c.lane == bindparam("of_lane"))
    .group_by(_job.c.state)
)
_kept = func.coalesce(_job.c.result, schema.campaign_case.c.outcome)  # of both documents the one that there is
WHOLE = type_coerce(_kept, _job.c.result.type).label("result")
_MEASURED = {  # what tables, scores, pictures and trends take from a result: a quarter of it
    "status": None,
    "message": None,
    "metrics": None,
    "timing": None,
    "digest": None,
    "warnings": None,
    "provenance": {
        "commit": None,
        "cpu": None,
        "cpu_count": None,
        "arm": None,
        "scenario": {
            "noise_mm": None,
            "needle": {"yield_mpa": None},
            "trajectory": {"entry_mm": None, "target_mm": None},
            "controller": {"kind": None, "name": None},
        },
    },
}


def _parts(names: dict[str, Any], path: str) -> Any:
    """A document with these parts of the result alone; a part that is not there is null."""
    pairs = [
        (name, func.json_extract(_kept, f"{path}.{name}") if inner is None else _parts(inner, f"{path}.{name}"))
        for name, inner in names.items()
    ]
    return func.json_object(*[one for pair in pairs for one in pair])


MEASURED = type_coerce(case((_kept.is_not(None), _parts(_MEASURED, "$"))), _job.c.result.type).label("result")
_OWN_LANE: ColumnElement[str] = func.coalesce(_campaign.c.owner, "").concat("/").concat(_campaign.c.id)
WHOLLY_ENDED = select(_campaign.c.id).where(  # running campaigns of which no job is active
    _campaign.c.state == RUNNING,
    ~select(_job.c.seq)
    .where(_job.c.lane == _OWN_LANE, _job.c.state.in_((QUEUED, JOB_RUNNING)))
    .correlate(_campaign)
    .exists(),
)


def check_removable(connection: Connection, campaign_id: str, mine: Select[Any]) -> None:
    """Each job must be one that could be deleted by itself: at its end and not pinned."""
    active = select(_job.c.id).where(_job.c.id.in_(mine), _job.c.state.not_in(sorted(TERMINAL))).limit(1)
    if (job := connection.execute(active).scalar_one_or_none()) is not None:
        raise CampaignActiveError(f"job {job} of campaign {campaign_id} has not ended: cancel it first")
    pinned = select(_job.c.id).where(_job.c.id.in_(mine), _job.c.pinned).limit(1)
    if (job := connection.execute(pinned).scalar_one_or_none()) is not None:
        raise CampaignPinnedError(f"job {job} of campaign {campaign_id} is pinned: unpin it first")


def tally_of(connection: Connection, campaign: Campaign) -> Tally:
    """How many of its jobs are in which state, and how many steps are done."""
    rows = connection.execute(TALLY, {"of_lane": lane_of(campaign.owner, campaign.id)}).all()
    return Tally(
        states={row[0]: row[1] for row in rows},
        steps=sum(row[2] for row in rows),
        steps_done=sum(row[3] for row in rows),
    )


def to_campaign(row: Row[Any]) -> Campaign:
    """A row of the campaign table."""
    columns = {field.name: getattr(row, field.name) for field in fields(Campaign)}
    return Campaign(**{**columns, "timeout_s": float(columns["timeout_s"])})


def to_case(row: Row[Any]) -> CampaignCase:
    """A row of a campaign's cases, with its result."""
    names = ("number", "case_id", "labels", "job_id", "state", "error_kind", "error", "result")
    return CampaignCase(**dict(zip(names, row, strict=True)))
