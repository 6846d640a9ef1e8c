"""Indexes of what every upload and every ranking asks: how many images there are, and which keys are old."""

from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Add the indexes."""
    op.create_index("ix_idempotency_keys_created_at", "idempotency_keys", ["created_at"])
    op.create_index("ix_images_counts", "images", ["scene_id", "verdict", "registration"])


def downgrade() -> None:
    """Drop the indexes."""
    op.drop_index("ix_images_counts", "images")
    op.drop_index("ix_idempotency_keys_created_at", "idempotency_keys")
