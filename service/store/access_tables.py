"""The tables of who may do what and of what was sent in: keys, browser sessions, uploads."""

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
    String,
    Table,
    false,
)

from service.store.tables import metadata

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
    Column("pinned", Boolean(create_constraint=False), nullable=False, server_default=false()),  # never cleared away
)

job_upload = Table(
    "job_upload",
    metadata,
    Column("job_id", ForeignKey("job.id", ondelete="CASCADE"), primary_key=True),
    Column("upload_id", String(80), primary_key=True),
)
Index("ix_job_upload_upload_id", job_upload.c.upload_id)
