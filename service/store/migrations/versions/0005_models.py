"""Jobs of more than one kind; uploads that are pinned, or that a job has made."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("job", sa.Column("kind", sa.String(16), nullable=False, server_default="insertion"))
    op.add_column("upload", sa.Column("job_id", sa.String(32)))
    op.add_column(
        "upload",
        sa.Column("pinned", sa.Boolean(create_constraint=False), nullable=False, server_default=sa.false()),
    )


def downgrade() -> None:
    with op.batch_alter_table("upload") as table:
        table.drop_column("pinned")
        table.drop_column("job_id")
    with op.batch_alter_table("job") as table:
        table.drop_column("kind")
