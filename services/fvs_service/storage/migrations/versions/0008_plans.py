"""Plans: what has been planned, as rankings."""

import sqlalchemy as sa
from alembic import op
from fvs_service.storage.tables import UtcDateTime

revision = "0008"
down_revision = "0007"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Create the table."""
    op.create_table(
        "plans",
        sa.Column("id", sa.String(40), primary_key=True),
        sa.Column("recorded_at_ms", sa.BigInteger(), nullable=False),
        sa.Column("scene_id", sa.String(40), sa.ForeignKey("scenes.id"), nullable=False, index=True),
        sa.Column("snapshot_id", sa.String(40), nullable=False),
        sa.Column("document", sa.JSON(), nullable=False),
        sa.Column("created_at", UtcDateTime(timezone=True), nullable=False),
    )


def downgrade() -> None:
    """Drop it."""
    op.drop_table("plans")
