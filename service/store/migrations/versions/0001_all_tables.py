"""All tables: jobs, keys, uploads, campaigns, schedules."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "job_notes"
down_revision = None
branch_labels = None
depends_on = None

_Sequence = sa.BigInteger().with_variant(sa.Integer, "sqlite")
_STATES = "state IN ('queued', 'running', 'finished', 'failed', 'cancelled', 'timed_out')"


def upgrade() -> None:
    """Make all tables."""
    _create_job()
    _create_artefact()
    _create_event()
    _create_idempotency()
    _create_keys()
    _create_upload()
    _create_campaign()
    _create_campaign_case()
    _create_schedule()
    _create_schedule_run()


def _create_job() -> None:
    op.create_table(
        "job",
        sa.Column("seq", _Sequence, autoincrement=True, nullable=False),
        sa.Column("id", sa.String(32), nullable=False),
        sa.Column("name", sa.String(100), nullable=False),
        sa.Column("spec", sa.JSON, nullable=False),
        sa.Column("spec_hash", sa.String(64), nullable=False),
        sa.Column("steps", sa.Integer, nullable=False),
        sa.Column("state", sa.String(16), nullable=False),
        sa.Column("outcome", sa.String(32)),
        sa.Column("priority", sa.Integer, nullable=False),
        sa.Column("timeout_s", sa.Float, nullable=False),
        sa.Column("attempt", sa.Integer, nullable=False),
        sa.Column("crashes", sa.Integer, nullable=False),
        sa.Column("cancel_requested", sa.Boolean(create_constraint=False), nullable=False),
        sa.Column("heartbeat_at", sa.Float),
        sa.Column("progress", sa.JSON),
        sa.Column("metrics", sa.JSON),
        sa.Column("result", sa.JSON),
        sa.Column("error_kind", sa.String(32)),
        sa.Column("error", sa.Text),
        sa.Column("cpu_s", sa.Float),
        sa.Column("max_rss_mb", sa.Float),
        sa.Column("created_at", sa.Float, nullable=False),
        sa.Column("started_at", sa.Float),
        sa.Column("finished_at", sa.Float),
        sa.Column("version", sa.Integer, nullable=False),
        sa.Column("owner", sa.String(32)),
        sa.Column("pinned", sa.Boolean(create_constraint=False), nullable=False, server_default=sa.false()),
        sa.Column("kind", sa.String(16), nullable=False, server_default="insertion"),
        sa.Column("lane", sa.String(70), nullable=False, server_default="/"),
        sa.Column("tags", sa.JSON, nullable=False, server_default=sa.text("'[]'")),
        sa.Column("note", sa.Text, nullable=False, server_default=""),
        sa.PrimaryKeyConstraint("seq", name="pk_job"),
        sa.UniqueConstraint("id", name="uq_job_id"),
        sa.CheckConstraint(_STATES, name=op.f("ck_job_state")),
        sqlite_autoincrement=True,
    )
    op.create_index(
        "ix_job_queued",
        "job",
        [sa.text("priority DESC"), "lane", "seq", "state"],
        sqlite_where=sa.text("state = 'queued'"),
        postgresql_where=sa.text("state = 'queued'"),
    )
    op.create_index("ix_job_lane_state", "job", ["lane", "state", "steps"])
    op.create_index("ix_job_state_seq", "job", ["state", "seq"])
    op.create_index("ix_job_outcome_seq", "job", ["outcome", "seq"])


def _create_artefact() -> None:
    op.create_table(
        "artefact",
        sa.Column("id", _Sequence, autoincrement=True, nullable=False),
        sa.Column("job_id", sa.String(32), nullable=False),
        sa.Column("kind", sa.String(32), nullable=False),
        sa.Column("name", sa.String(200), nullable=False),
        sa.Column("path", sa.String(500), nullable=False),
        sa.Column("sha256", sa.String(64), nullable=False),
        sa.Column("bytes", sa.BigInteger, nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_artefact"),
        sa.UniqueConstraint("job_id", "name", name="uq_artefact_job_id_name"),
        sa.ForeignKeyConstraint(["job_id"], ["job.id"], name="fk_artefact_job_id", ondelete="CASCADE"),
    )


def _create_event() -> None:
    op.create_table(
        "event",
        sa.Column("seq", _Sequence, autoincrement=True, nullable=False),
        sa.Column("job_id", sa.String(32), nullable=False),
        sa.Column("at", sa.Float, nullable=False),
        sa.Column("kind", sa.String(32), nullable=False),
        sa.Column("attempt", sa.Integer, nullable=False),
        sa.Column("data", sa.JSON),
        sa.PrimaryKeyConstraint("seq", name="pk_event"),
        sqlite_autoincrement=True,
    )
    op.create_index("ix_event_job_id_seq", "event", ["job_id", "seq"])
    if op.get_bind().dialect.name == "sqlite":
        op.execute(
            "CREATE TRIGGER event_append_only BEFORE UPDATE ON event "
            "BEGIN SELECT RAISE(ABORT, 'events are append-only'); END"
        )


def _create_idempotency() -> None:
    op.create_table(
        "idempotency",
        sa.Column("key", sa.String(200), nullable=False),
        sa.Column("request_hash", sa.String(64), nullable=False),
        sa.Column("job_id", sa.String(32), nullable=False),
        sa.Column("created_at", sa.Float, nullable=False),
        sa.PrimaryKeyConstraint("key", name="pk_idempotency"),
        sa.ForeignKeyConstraint(["job_id"], ["job.id"], name="fk_idempotency_job_id", ondelete="CASCADE"),
    )


def _create_keys() -> None:
    op.create_table(
        "api_key",
        sa.Column("id", sa.String(32), nullable=False),
        sa.Column("secret_sha256", sa.String(64), nullable=False),
        sa.Column("scope", sa.String(16), nullable=False),
        sa.Column("note", sa.String(200), nullable=False),
        sa.Column("created_at", sa.Float, nullable=False),
        sa.Column("used_at", sa.Float),
        sa.Column("revoked_at", sa.Float),
        sa.PrimaryKeyConstraint("id", name="pk_api_key"),
        sa.CheckConstraint("scope IN ('read', 'submit', 'admin')", name="ck_api_key_scope"),
    )
    op.create_table(
        "session",
        sa.Column("token_sha256", sa.String(64), nullable=False),
        sa.Column("key_id", sa.String(32), nullable=False),
        sa.Column("secret_sha256", sa.String(64), nullable=False),
        sa.Column("created_at", sa.Float, nullable=False),
        sa.Column("expires_at", sa.Float, nullable=False),
        sa.PrimaryKeyConstraint("token_sha256", name="pk_session"),
    )


def _create_upload() -> None:
    op.create_table(
        "upload",
        sa.Column("id", sa.String(80), nullable=False),
        sa.Column("kind", sa.String(16), nullable=False),
        sa.Column("name", sa.String(100), nullable=False),
        sa.Column("sha256", sa.String(64), nullable=False),
        sa.Column("bytes", sa.BigInteger, nullable=False),
        sa.Column("content", sa.JSON, nullable=False),
        sa.Column("owner", sa.String(32)),
        sa.Column("created_at", sa.Float, nullable=False),
        sa.Column("job_id", sa.String(32)),
        sa.Column("pinned", sa.Boolean(create_constraint=False), nullable=False, server_default=sa.false()),
        sa.PrimaryKeyConstraint("id", name="pk_upload"),
    )
    op.create_table(
        "job_upload",
        sa.Column("job_id", sa.String(32), nullable=False),
        sa.Column("upload_id", sa.String(80), nullable=False),
        sa.PrimaryKeyConstraint("job_id", "upload_id", name="pk_job_upload"),
        sa.ForeignKeyConstraint(["job_id"], ["job.id"], name="fk_job_upload_job_id", ondelete="CASCADE"),
    )
    op.create_index("ix_job_upload_upload_id", "job_upload", ["upload_id"])


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
        sa.Column("owner", sa.String(32)),
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
        sa.Column("owner", sa.String(32)),
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
