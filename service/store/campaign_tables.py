"""The tables of campaigns and schedules. Times are UTC seconds since 1970."""

from __future__ import annotations

from sqlalchemy import (
    JSON,
    BigInteger,
    Boolean,
    CheckConstraint,
    Column,
    Float,
    ForeignKey,
    Index,
    Integer,
    String,
    Table,
    Text,
    UniqueConstraint,
)

from service.store.tables import metadata

_Sequence = BigInteger().with_variant(Integer, "sqlite")

campaign = Table(
    "campaign",
    metadata,
    Column("seq", _Sequence, primary_key=True, autoincrement=True),
    Column("id", String(32), nullable=False, unique=True),
    Column("name", String(100), nullable=False),
    Column("request", JSON, nullable=False),  # what was asked for
    Column("suite", String(100), nullable=False),
    Column("suite_sha256", String(64), nullable=False),
    Column("cases", Integer, nullable=False),
    Column("state", String(16), nullable=False),
    Column("cancel_requested", Boolean(create_constraint=False), nullable=False),
    Column("priority", Integer, nullable=False),
    Column("timeout_s", Float, nullable=False),
    Column("schedule_id", String(32)),  # no foreign key: what ran stays when its schedule is deleted
    Column("scheduled_for", Float),
    Column("created_at", Float, nullable=False),
    Column("finished_at", Float),
    Column("point", JSON(none_as_null=True)),  # of its suite's trend, once it has ended
    Column("version", Integer, nullable=False),
    CheckConstraint("state IN ('running', 'done', 'cancelled')", name="state"),
    sqlite_autoincrement=True,
)
Index("ix_campaign_state", campaign.c.state)
Index("ix_campaign_suite_seq", campaign.c.suite, campaign.c.seq)

campaign_case = Table(
    "campaign_case",
    metadata,
    Column("campaign_id", ForeignKey("campaign.id", ondelete="CASCADE"), primary_key=True),
    Column("number", Integer, primary_key=True),
    Column("case_id", String(200), nullable=False),
    Column("labels", JSON, nullable=False),
    Column("job_id", ForeignKey("job.id", ondelete="SET NULL"), unique=True),  # null once the job was deleted
    Column("outcome", JSON(none_as_null=True)),  # the result, kept when the campaign ends: it outlives the job
    UniqueConstraint("campaign_id", "case_id"),
)

schedule = Table(
    "schedule",
    metadata,
    Column("seq", _Sequence, primary_key=True, autoincrement=True),
    Column("id", String(32), nullable=False, unique=True),
    Column("name", String(100), nullable=False, unique=True),
    Column("cron", String(200), nullable=False),
    Column("timezone", String(64), nullable=False),
    Column("catchup", String(8), nullable=False),
    Column("overlap", String(8), nullable=False),
    Column("request", JSON, nullable=False),  # of the campaign that each tick starts
    Column("enabled", Boolean(create_constraint=False), nullable=False),
    Column("next_run_at", Float),
    Column("created_at", Float, nullable=False),
    Column("version", Integer, nullable=False),
    CheckConstraint("catchup IN ('skip', 'latest', 'all')", name="catchup"),
    CheckConstraint("overlap IN ('forbid', 'allow', 'replace')", name="overlap"),
    sqlite_autoincrement=True,
)
Index("ix_schedule_next_run_at", schedule.c.next_run_at)

schedule_run = Table(
    "schedule_run",
    metadata,
    Column("seq", _Sequence, primary_key=True, autoincrement=True),
    Column("schedule_id", ForeignKey("schedule.id", ondelete="CASCADE"), nullable=False),
    Column("scheduled_for", Float, nullable=False),
    Column("fired_at", Float, nullable=False),
    Column("outcome", String(16), nullable=False),
    Column("campaign_id", String(32)),
    Column("message", Text),
    UniqueConstraint("schedule_id", "scheduled_for"),  # a tick fires once, whatever crashes when
    CheckConstraint("outcome IN ('started', 'missed', 'overlap', 'failed')", name="outcome"),
    sqlite_autoincrement=True,
)
