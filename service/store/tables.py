"""The tables, as the newest migration leaves them. Times are UTC seconds since 1970; paths start at the data folder."""

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

STATES = ("queued", "running", "succeeded", "failed", "cancelled", "timed_out")

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
    Column("priority", Integer, nullable=False),
    Column("timeout_s", Float, nullable=False),
    Column("attempt", Integer, nullable=False),  # counts the claims; with the id it names the owner of a running job
    Column("crashes", Integer, nullable=False),  # attempts that ended with the death of a worker or of the server
    Column("cancel_requested", Boolean(create_constraint=False), nullable=False),
    Column("pinned", Boolean(create_constraint=False), nullable=False, server_default=false()),  # never cleared away
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
    CheckConstraint("state IN ('queued', 'running', 'succeeded', 'failed', 'cancelled', 'timed_out')", name="state"),
    sqlite_autoincrement=True,
)
Index(
    "ix_job_queued",
    job.c.priority.desc(),
    job.c.seq,
    sqlite_where=text("state = 'queued'"),
    postgresql_where=text("state = 'queued'"),
)
Index("ix_job_state_seq", job.c.state, job.c.seq)

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
