"""API keys, browser sessions, uploaded files; the key that submitted a job."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("job", sa.Column("owner", sa.String(32)))
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
    _create_upload()


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


def downgrade() -> None:
    for table in ("job_upload", "upload", "session", "api_key"):
        op.drop_table(table)
    with op.batch_alter_table("job") as batch:
        batch.drop_column("owner")
