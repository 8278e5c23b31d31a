"""Campaigns, their cases, schedules and their runs."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None

_Sequence = sa.BigInteger().with_variant(sa.Integer, "sqlite")
_OUTCOMES = "outcome IN ('started', 'missed', 'overlap', 'failed')"


def upgrade() -> None:
    _create_campaign()
    _create_campaign_case()
    _create_schedule()
    _create_schedule_run()


def _create_campaign() -> None:
    op.create_table(
        "campaign",
        sa.Column("seq", _Sequence, nullable=False, autoincrement=True),
        sa.Column("id", sa.String(32), nullable=False),
        sa.Column("name", sa.String(100), nullable=False),
        sa.Column("request", sa.JSON, nullable=False),
        sa.Column("suite", sa.String(100), nullable=False),
        sa.Column("suite_sha256", sa.String(64), nullable=False),
        sa.Column("cases", sa.Integer, nullable=False),
        sa.Column("state", sa.String(16), nullable=False),
        sa.Column("cancel_requested", sa.Boolean(create_constraint=False), nullable=False),
        sa.Column("priority", sa.Integer, nullable=False),
        sa.Column("timeout_s", sa.Float, nullable=False),
        sa.Column("schedule_id", sa.String(32)),
        sa.Column("scheduled_for", sa.Float),
        sa.Column("created_at", sa.Float, nullable=False),
        sa.Column("finished_at", sa.Float),
        sa.Column("point", sa.JSON(none_as_null=True)),
        sa.Column("version", sa.Integer, nullable=False),
        sa.PrimaryKeyConstraint("seq", name="pk_campaign"),
        sa.UniqueConstraint("id", name="uq_campaign_id"),
        sa.CheckConstraint("state IN ('running', 'done', 'cancelled')", name=op.f("ck_campaign_state")),
        sqlite_autoincrement=True,
    )
    op.create_index("ix_campaign_state", "campaign", ["state"])
    op.create_index("ix_campaign_suite_seq", "campaign", ["suite", "seq"])


def _create_campaign_case() -> None:
    op.create_table(
        "campaign_case",
        sa.Column("campaign_id", sa.String(32), nullable=False),
        sa.Column("number", sa.Integer, nullable=False),
        sa.Column("case_id", sa.String(200), nullable=False),
        sa.Column("labels", sa.JSON, nullable=False),
        sa.Column("job_id", sa.String(32)),
        sa.Column("outcome", sa.JSON(none_as_null=True)),
        sa.PrimaryKeyConstraint("campaign_id", "number", name="pk_campaign_case"),
        sa.UniqueConstraint("campaign_id", "case_id", name="uq_campaign_case_campaign_id_case_id"),
        sa.UniqueConstraint("job_id", name="uq_campaign_case_job_id"),
        sa.ForeignKeyConstraint(
            ["campaign_id"], ["campaign.id"], name="fk_campaign_case_campaign_id", ondelete="CASCADE"
        ),
        sa.ForeignKeyConstraint(["job_id"], ["job.id"], name="fk_campaign_case_job_id", ondelete="SET NULL"),
    )


def _create_schedule() -> None:
    op.create_table(
        "schedule",
        sa.Column("seq", _Sequence, nullable=False, autoincrement=True),
        sa.Column("id", sa.String(32), nullable=False),
        sa.Column("name", sa.String(100), nullable=False),
        sa.Column("cron", sa.String(200), nullable=False),
        sa.Column("timezone", sa.String(64), nullable=False),
        sa.Column("catchup", sa.String(8), nullable=False),
        sa.Column("overlap", sa.String(8), nullable=False),
        sa.Column("request", sa.JSON, nullable=False),
        sa.Column("enabled", sa.Boolean(create_constraint=False), nullable=False),
        sa.Column("next_run_at", sa.Float),
        sa.Column("created_at", sa.Float, nullable=False),
        sa.Column("version", sa.Integer, nullable=False),
        sa.PrimaryKeyConstraint("seq", name="pk_schedule"),
        sa.UniqueConstraint("id", name="uq_schedule_id"),
        sa.UniqueConstraint("name", name="uq_schedule_name"),
        sa.CheckConstraint("catchup IN ('skip', 'latest', 'all')", name=op.f("ck_schedule_catchup")),
        sa.CheckConstraint("overlap IN ('forbid', 'allow', 'replace')", name=op.f("ck_schedule_overlap")),
        sqlite_autoincrement=True,
    )
    op.create_index("ix_schedule_next_run_at", "schedule", ["next_run_at"])


def _create_schedule_run() -> None:
    op.create_table(
        "schedule_run",
        sa.Column("seq", _Sequence, nullable=False, autoincrement=True),
        sa.Column("schedule_id", sa.String(32), nullable=False),
        sa.Column("scheduled_for", sa.Float, nullable=False),
        sa.Column("fired_at", sa.Float, nullable=False),
        sa.Column("outcome", sa.String(16), nullable=False),
        sa.Column("campaign_id", sa.String(32)),
        sa.Column("message", sa.Text),
        sa.PrimaryKeyConstraint("seq", name="pk_schedule_run"),
        sa.UniqueConstraint("schedule_id", "scheduled_for", name="uq_schedule_run_schedule_id_scheduled_for"),
        sa.ForeignKeyConstraint(
            ["schedule_id"], ["schedule.id"], name="fk_schedule_run_schedule_id", ondelete="CASCADE"
        ),
        sa.CheckConstraint(
            "outcome IN ('started', 'missed', 'overlap', 'failed')", name=op.f("ck_schedule_run_outcome")
        ),
        sqlite_autoincrement=True,
    )
