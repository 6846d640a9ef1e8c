"""Record when scenes were added, by the database's clock, as version 0005 does of jobs."""

import sqlalchemy as sa
from alembic import op

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None

_CLOCK = "CAST(extract(epoch from clock_timestamp()) * 1000 AS BIGINT)"


def upgrade() -> None:
    """Add the column: 0 in rows that exist, whose order stays that of their ids."""
    op.add_column("scenes", sa.Column("recorded_at_ms", sa.BigInteger(), nullable=False, server_default="0"))
    if op.get_bind().dialect.name == "postgresql":  # programs of the old version go on adding rows
        op.alter_column("scenes", "recorded_at_ms", server_default=sa.text(_CLOCK))


def downgrade() -> None:
    """Drop it."""
    op.drop_column("scenes", "recorded_at_ms")
