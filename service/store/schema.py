"""All tables, as the newest migration leaves them: jobs, campaigns, schedules, keys, sessions, uploads.

Times are UTC seconds since 1970; paths start at the data folder.
"""

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
    MetaData,
    String,
    Table,
    Text,
    UniqueConstraint,
    false,
    text,
)

REVISION = "job_notes"  # of the newest migration
STATES = ("queued", "running", "finished", "failed", "cancelled", "timed_out")

metadata = MetaData(
    naming_convention={
        "ix": "ix_%(table_name)s_%(column_0_N_name)s",
        "uq": "uq_%(table_name)s_%(column_0_N_name)s",
        "ck": "ck_%(table_name)s_%(constraint_name)s",
        "fk": "fk_%(table_name)s_%(column_0_N_name)s",
        "pk": "pk_%(table_name)s",
    }
)

_Sequence = BigInteger().with_variant(Integer, "sqlite")  # SQLite counts up INTEGER keys only

job = Table(
    "job",
    metadata,
    Column("seq", _Sequence, primary_key=True, autoincrement=True),  # order of arrival
    Column("id", String(32), nullable=False, unique=True),
    Column("name", String(100), nullable=False),
    Column("spec", JSON, nullable=False),
    Column("spec_hash", String(64), nullable=False),
    Column("steps", Integer, nullable=False),  # of the whole run, known before it starts
    Column("state", String(16), nullable=False),
    Column("outcome", String(32)),  # of a job that finished: `job.OUTCOMES`
    Column("priority", Integer, nullable=False),
    Column("timeout_s", Float, nullable=False),
    Column("attempt", Integer, nullable=False),  # counts the claims; with the id it names the owner of a running job
    Column("crashes", Integer, nullable=False),  # attempts that ended with the death of a worker or of the server
    Column("cancel_requested", Boolean(create_constraint=False), nullable=False),
    Column("pinned", Boolean(create_constraint=False), nullable=False, server_default=false()),  # never removed
    Column("heartbeat_at", Float),
    Column("progress", JSON(none_as_null=True)),
    Column("metrics", JSON(none_as_null=True)),
    Column("result", JSON(none_as_null=True)),
    Column("error_kind", String(32)),
    Column("error", Text),
    Column("cpu_s", Float),
    Column("max_rss_mb", Float),
    Column("created_at", Float, nullable=False),
    Column("started_at", Float),
    Column("finished_at", Float),
    Column("version", Integer, nullable=False),  # goes up with every change: the ETag
    Column("owner", String(32)),  # the API key that submitted it; null where none was asked for
    Column("kind", String(16), nullable=False, server_default="insertion"),  # what its worker does: `jobs.KINDS`
    Column("lane", String(70), nullable=False, server_default="/"),  # owner/campaign: those of a priority take turns
    Column("tags", JSON, nullable=False, server_default=text("'[]'")),  # in the order in which they were given
    Column("note", Text, nullable=False, server_default=""),
    CheckConstraint("state IN ('queued', 'running', 'finished', 'failed', 'cancelled', 'timed_out')", name="state"),
    sqlite_autoincrement=True,
)
Index(
    "ix_job_queued",
    job.c.priority.desc(),
    job.c.lane,
    job.c.seq,
    job.c.state,  # so that the index alone is read
    sqlite_where=text("state = 'queued'"),
    postgresql_where=text("state = 'queued'"),
)
Index("ix_job_lane_state", job.c.lane, job.c.state, job.c.steps)  # how far a campaign is, from the index alone
Index("ix_job_state_seq", job.c.state, job.c.seq)
Index("ix_job_outcome_seq", job.c.outcome, job.c.seq)

artefact = Table(
    "artefact",
    metadata,
    Column("id", _Sequence, primary_key=True, autoincrement=True),
    Column("job_id", ForeignKey("job.id", ondelete="CASCADE"), nullable=False),
    Column("kind", String(32), nullable=False),
    Column("name", String(200), nullable=False),
    Column("path", String(500), nullable=False),
    Column("sha256", String(64), nullable=False),
    Column("bytes", BigInteger, nullable=False),
    UniqueConstraint("job_id", "name"),
)

event = Table(
    "event",
    metadata,
    Column("seq", _Sequence, primary_key=True, autoincrement=True),
    Column("job_id", String(32), nullable=False),  # no foreign key: what happened stays when the job is deleted
    Column("at", Float, nullable=False),
    Column("kind", String(32), nullable=False),
    Column("attempt", Integer, nullable=False),
    Column("data", JSON(none_as_null=True)),
    sqlite_autoincrement=True,
)
Index("ix_event_job_id_seq", event.c.job_id, event.c.seq)

idempotency = Table(
    "idempotency",
    metadata,
    Column("key", String(200), primary_key=True),
    Column("request_hash", String(64), nullable=False),
    Column("job_id", ForeignKey("job.id", ondelete="CASCADE"), nullable=False),
    Column("created_at", Float, nullable=False),
)


# -- campaigns and schedules

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
    Column("owner", String(32)),  # the API key that asked for it, or for its schedule
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
    Column("owner", String(32)),  # the API key that made it
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


# -- who may do what, and what was sent in

api_key = Table(
    "api_key",
    metadata,
    Column("id", String(32), primary_key=True),  # the part of a key that may be shown
    Column("secret_sha256", String(64), nullable=False),
    Column("scope", String(16), nullable=False),
    Column("note", String(200), nullable=False),
    Column("created_at", Float, nullable=False),
    Column("used_at", Float),
    Column("revoked_at", Float),
    CheckConstraint("scope IN ('read', 'submit', 'admin')", name="scope"),
)

session = Table(
    "session",
    metadata,
    Column("token_sha256", String(64), primary_key=True),
    Column("key_id", String(32), nullable=False),
    Column("secret_sha256", String(64), nullable=False),  # of the key: a session ends with the key that opened it
    Column("created_at", Float, nullable=False),
    Column("expires_at", Float, nullable=False),
)

upload = Table(
    "upload",
    metadata,
    Column("id", String(80), primary_key=True),  # SHA-256 and suffix: also the name of the file
    Column("kind", String(16), nullable=False),
    Column("name", String(100), nullable=False),  # what the sender calls it: a label
    Column("sha256", String(64), nullable=False),
    Column("bytes", BigInteger, nullable=False),
    Column("content", JSON, nullable=False),  # what was found in it
    Column("owner", String(32)),
    Column("created_at", Float, nullable=False),
    Column("job_id", String(32)),  # that made it; no foreign key: it stays when the job is deleted
    Column("pinned", Boolean(create_constraint=False), nullable=False, server_default=false()),  # never removed
)

job_upload = Table(
    "job_upload",
    metadata,
    Column("job_id", ForeignKey("job.id", ondelete="CASCADE"), primary_key=True),
    Column("upload_id", String(80), primary_key=True),
)
Index("ix_job_upload_upload_id", job_upload.c.upload_id)
