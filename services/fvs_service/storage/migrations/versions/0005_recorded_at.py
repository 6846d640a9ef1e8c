"""Record when jobs, snapshots and rankings were added, by the database's clock.

Their ids follow the clocks of the machines that made them, which may differ.
"""

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None

_TABLES = ("jobs", "snapshots", "rankings")
_CLOCK = "CAST(extract(epoch from clock_timestamp()) * 1000 AS BIGINT)"


def upgrade() -> None:
    """Add the column: 0 in rows that exist, whose order stays that of their ids."""
    for table in _TABLES:
        op.add_column(table, sa.Column("recorded_at_ms", sa.BigInteger(), nullable=False, server_default="0"))
        if op.get_bind().dialect.name == "postgresql":  # programs of the old version go on adding rows
            op.alter_column(table, "recorded_at_ms", server_default=sa.text(_CLOCK))
    op.create_index("ix_jobs_recorded", "jobs", ["recorded_at_ms", "id"])


def downgrade() -> None:
    """Drop it."""
    op.drop_index("ix_jobs_recorded", "jobs")
    for table in _TABLES:
        op.drop_column(table, "recorded_at_ms")
