"""The database's identity, which the blob store is marked with."""

import sqlalchemy as sa
from alembic import op
from fvs_service.ids import new_id

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Create the table with its only row."""
    identity = op.create_table("identity", sa.Column("id", sa.String(40), primary_key=True))
    op.bulk_insert(identity, [{"id": new_id("dbs")}])


def downgrade() -> None:
    """Drop it; the store stays marked."""
    op.drop_table("identity")
