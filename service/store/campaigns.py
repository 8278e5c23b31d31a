"""All SQL of campaigns: made with their jobs in one transaction, ended when the last of these has ended."""

from __future__ import annotations

import secrets
from dataclasses import fields
from typing import TYPE_CHECKING, Any

from sqlalchemy import Connection, case, delete, func, insert, select, update

from service.store import schema
from service.store.campaign import (
    CANCELLED,
    DONE,
    RUNNING,
    Campaign,
    CampaignActiveError,
    CampaignCase,
    CampaignPlan,
    Tally,
    UnknownCampaignError,
)
from service.store.campaign_rows import MEASURED, WHOLE, WHOLLY_ENDED, check_removable, tally_of, to_campaign, to_case
from service.store.job import QUEUED
from service.store.job import RUNNING as JOB_RUNNING
from service.store.job_queries import check_room
from service.store.schema import campaign as _campaign
from service.store.schema import campaign_case as _case
from service.store.turns import lane_of
from service.store.upload_references import check_uploads

if TYPE_CHECKING:
    from collections.abc import Sequence

    from service.store.jobs import Store

_job = schema.job
_COLUMNS = [_campaign.c[field.name] for field in fields(Campaign)]


class CampaignStore:
    """Campaigns and their cases, on the job store's connections and clock."""

    def __init__(self, store: Store) -> None:
        self._store = store

    def create(self, plan: CampaignPlan, *, owner: str | None = None) -> Campaign:
        """A running campaign with all of its jobs queued, or nothing. owner: the API key that asked.

        Raises QueueFullError, UploadGoneError.
        """
        with self._store.writing() as connection:
            return self.create_within(connection, plan, owner=owner)

    def create_within(
        self,
        connection: Connection,
        plan: CampaignPlan,
        *,
        owner: str | None = None,
        schedule_id: str | None = None,
        scheduled_for: float | None = None,
    ) -> Campaign:
        """`create` as a part of a larger transaction."""
        check_room(connection, owner, self._store.limits, more=len(plan.jobs))
        check_uploads(connection, plan.uploads, {"request": plan.request})
        now = self._store.now
        values = {
            name: getattr(plan, name) for name in ("name", "request", "suite", "suite_sha256", "priority", "timeout_s")
        }
        row = connection.execute(
            insert(_campaign)
            .values(
                **values,
                id=secrets.token_hex(8),
                cases=len(plan.jobs),
                state=RUNNING,
                cancel_requested=False,
                schedule_id=schedule_id,
                scheduled_for=scheduled_for,
                owner=owner,
                created_at=now,
                version=1,
            )
            .returning(*_COLUMNS)
        ).one()
        made = to_campaign(row)
        ids = [secrets.token_hex(8) for _ in plan.jobs]
        if ids:
            self._insert_jobs(connection, made, plan, ids, now)
        return made

    def _insert_jobs(
        self, connection: Connection, made: Campaign, plan: CampaignPlan, ids: list[str], now: float
    ) -> None:
        common: dict[str, Any] = {
            "state": QUEUED,
            "priority": plan.priority,
            "timeout_s": plan.timeout_s,
            "attempt": 0,
            "crashes": 0,
            "cancel_requested": False,
            "created_at": now,
            "version": 1,
            "owner": made.owner,
            "lane": lane_of(made.owner, made.id),
        }
        own = ("name", "spec", "spec_hash", "steps")
        jobs = [{"id": i, **{n: getattr(job, n) for n in own}, **common} for i, job in zip(ids, plan.jobs, strict=True)]
        connection.execute(insert(_job), jobs)
        cases = [
            {"campaign_id": made.id, "number": n, "case_id": job.case_id, "labels": job.labels, "job_id": i}
            for n, (i, job) in enumerate(zip(ids, plan.jobs, strict=True))
        ]
        connection.execute(insert(_case), cases)
        used = [{"job_id": i, "upload_id": upload} for i in ids for upload in plan.uploads]
        if used:
            connection.execute(insert(schema.job_upload), used)
        data = {"priority": plan.priority, "timeout_s": plan.timeout_s, "campaign": made.id}
        events = [{"job_id": i, "at": now, "kind": QUEUED, "attempt": 0, "data": data} for i in ids]
        connection.execute(insert(schema.event), events)

    # -- reading

    def get(self, campaign_id: str) -> Campaign:
        """Raises UnknownCampaignError."""
        with self._store.reading() as connection:
            return self._read(connection, campaign_id)

    def _read(self, connection: Connection, campaign_id: str) -> Campaign:
        row = connection.execute(select(*_COLUMNS).where(_campaign.c.id == campaign_id)).one_or_none()
        if row is None:
            raise UnknownCampaignError(f"there is no campaign {campaign_id}")
        return to_campaign(row)

    def newest(
        self,
        *,
        suite: str | None = None,
        state: str | None = None,
        schedule_id: str | None = None,
        limit: int = 50,
        before: int | None = None,
    ) -> list[Campaign]:
        """Campaigns, newest first, those that arrived before sequence number `before`."""
        query = select(*_COLUMNS).order_by(_campaign.c.seq.desc()).limit(limit)
        wanted = {"suite": suite, "state": state, "schedule_id": schedule_id}
        for name, value in wanted.items():
            if value is not None:
                query = query.where(_campaign.c[name] == value)
        if before is not None:
            query = query.where(_campaign.c.seq < before)
        with self._store.reading() as connection:
            return [to_campaign(row) for row in connection.execute(query)]

    def tally(self, campaigns: Sequence[Campaign]) -> dict[str, Tally]:
        """Where the jobs of these campaigns are, by the campaign's id."""
        with self._store.reading() as connection:
            return {one.id: tally_of(connection, one) for one in campaigns}

    def cases(
        self, campaign_id: str, *, whole: bool = True, first: int = 0, limit: int | None = None
    ) -> list[CampaignCase]:
        """The cases in suite order; a result is the job's while there is one. Raises UnknownCampaignError.

        whole: False reads of each result what tables, scores and trends need. first: number of the first case, from 0;
        limit: at most so many.
        """
        columns: list[Any] = [_case.c.number, _case.c.case_id, _case.c.labels, _case.c.job_id]
        columns += [_job.c.state, _job.c.error_kind, _job.c.error, WHOLE if whole else MEASURED]
        query = (
            select(*columns)
            .select_from(_case.outerjoin(_job, _job.c.id == _case.c.job_id))
            .where(_case.c.campaign_id == campaign_id, _case.c.number >= first)
            .order_by(_case.c.number)
            .limit(limit)
        )
        with self._store.reading() as connection:
            self._read(connection, campaign_id)
            return [to_case(row) for row in connection.execute(query)]

    def version_of_jobs(self, campaign_id: str) -> tuple[int, int]:
        """How many of its jobs there are, and the sum of their versions: jobs only go, and versions only grow, so that
        both are as before only where nothing has changed."""
        query = select(func.count(_job.c.id), func.coalesce(func.sum(_job.c.version), 0)).where(
            _case.c.campaign_id == campaign_id, _job.c.id == _case.c.job_id
        )
        with self._store.reading() as connection:
            jobs, versions = connection.execute(query).one()
        return jobs, versions

    def of_jobs(self, job_ids: Sequence[str]) -> dict[str, tuple[str, str]]:
        """Job -> id and name of its campaign; without those that belong to none."""
        query = select(_case.c.job_id, _campaign.c.id, _campaign.c.name).where(
            _case.c.job_id.in_(job_ids), _campaign.c.id == _case.c.campaign_id
        )
        with self._store.reading() as connection:
            return {job: (campaign, name) for job, campaign, name in connection.execute(query)}

    # -- changing

    def cancel(self, campaign_id: str) -> Campaign:
        """Cancel queued jobs and ask running ones to stop. Idempotent, and no error after the end."""
        with self._store.writing() as connection:
            now = self._read(connection, campaign_id)
            if now.terminal or now.cancel_requested:
                return now
            changed = self.cancel_within(connection, campaign_id)
        self._store.notify(campaign_id)
        return changed

    def cancel_within(self, connection: Connection, campaign_id: str) -> Campaign:
        """`cancel` as a part of a larger transaction."""
        mine = select(_case.c.job_id).where(_case.c.campaign_id == campaign_id)
        at = self._store.now
        newer = {"version": _job.c.version + 1}
        queued = update(_job).where(_job.c.id.in_(mine), _job.c.state == QUEUED)
        stopped = connection.execute(queued.values(state=CANCELLED, finished_at=at, **newer).returning(_job.c.id)).all()
        running = update(_job).where(_job.c.id.in_(mine), _job.c.state == JOB_RUNNING, ~_job.c.cancel_requested)
        asked = connection.execute(running.values(cancel_requested=True, **newer).returning(_job.c.id)).all()
        events = [
            {"job_id": row.id, "at": at, "kind": kind, "attempt": 0, "data": {"campaign": campaign_id}}
            for kind, rows in ((CANCELLED, stopped), ("cancel_requested", asked))
            for row in rows
        ]
        if events:
            connection.execute(insert(schema.event), events)
            self._store.changed_within(event["job_id"] for event in events)
        row = connection.execute(
            update(_campaign)
            .where(_campaign.c.id == campaign_id)
            .values(cancel_requested=True, version=_campaign.c.version + 1)
            .returning(*_COLUMNS)
        ).one()
        return to_campaign(row)

    def settle(self) -> list[Campaign]:
        """End every running campaign whose jobs have all ended; their results are kept with the cases."""
        with self._store.reading() as connection:
            ended = connection.execute(WHOLLY_ENDED).scalars().all()
        return [self._end(campaign_id) for campaign_id in ended]

    def _end(self, campaign_id: str) -> Campaign:
        result = select(_job.c.result).where(_job.c.id == _case.c.job_id).scalar_subquery()
        keep = update(_case).where(_case.c.campaign_id == campaign_id, _case.c.job_id.is_not(None))
        state = case((_campaign.c.cancel_requested, CANCELLED), else_=DONE)
        with self._store.writing() as connection:
            connection.execute(keep.values(outcome=result))
            row = connection.execute(
                update(_campaign)
                .where(_campaign.c.id == campaign_id, _campaign.c.state == RUNNING)
                .values(state=state, finished_at=self._store.now, version=_campaign.c.version + 1)
                .returning(*_COLUMNS)
            ).one_or_none()
            ended = self._read(connection, campaign_id) if row is None else to_campaign(row)
        self._store.notify(campaign_id)
        return ended

    def points(self, suite: str, *, limit: int) -> list[tuple[Campaign, dict[str, Any] | None]]:
        """The newest campaigns of a suite that were not cancelled, oldest first, each with its point if it was kept."""
        query = select(*_COLUMNS, _campaign.c.point).where(_campaign.c.suite == suite, _campaign.c.state == DONE)
        with self._store.reading() as connection:
            rows = connection.execute(query.order_by(_campaign.c.seq.desc()).limit(limit)).all()
        return [(to_campaign(row), row.point) for row in reversed(rows)]

    def keep_point(self, campaign_id: str, point: dict[str, Any]) -> None:
        """Keep what the campaign adds to its suite's trend."""
        with self._store.writing() as connection:
            connection.execute(update(_campaign).where(_campaign.c.id == campaign_id).values(point=point))

    def suites(self) -> list[str]:
        """Suites of which a campaign has ended, by name."""
        query = select(_campaign.c.suite).where(_campaign.c.state == DONE).distinct().order_by(_campaign.c.suite)
        with self._store.reading() as connection:
            return list(connection.execute(query).scalars())

    def delete(self, campaign_id: str) -> list[str]:
        """Forget a campaign that has ended, with its jobs; the ids of these, whose folders may go.

        Raises UnknownCampaignError, CampaignActiveError, CampaignPinnedError.
        """
        with self._store.writing() as connection:
            if not self._read(connection, campaign_id).terminal:
                raise CampaignActiveError(f"campaign {campaign_id} is running: cancel it first")
            mine = select(_case.c.job_id).where(_case.c.campaign_id == campaign_id, _case.c.job_id.is_not(None))
            check_removable(connection, campaign_id, mine)
            ids = list(connection.execute(mine).scalars())
            connection.execute(delete(_job).where(_job.c.id.in_(mine)))
            self._store.changed_within(ids)
            connection.execute(delete(_campaign).where(_campaign.c.id == campaign_id))
        return ids
