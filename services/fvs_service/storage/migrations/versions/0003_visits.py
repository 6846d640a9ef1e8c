"""Visits: what vehicles do about views."""

import sqlalchemy as sa
from alembic import op
from fvs_service.storage.tables import UtcDateTime

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Create the table."""
    op.create_table(
        "visits",
        sa.Column("scene_id", sa.String(40), sa.ForeignKey("scenes.id"), primary_key=True),
        sa.Column("vehicle", sa.String(64), primary_key=True),
        sa.Column("candidate_id", sa.String(128), primary_key=True),
        sa.Column("state", sa.String(16), nullable=False),
        sa.Column("pose", sa.JSON, nullable=False),
        sa.Column("reported_at", UtcDateTime, nullable=False),
        sa.Column("expires_at", UtcDateTime, nullable=False),
    )


def downgrade() -> None:
    """Drop it."""
    op.drop_table("visits")
