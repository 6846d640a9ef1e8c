"""Visits have numbers: one vehicle may have several of one candidate's id, which are different views."""

import sqlalchemy as sa
from alembic import op
from fvs_service.storage.tables import UtcDateTime

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None

_KEPT = "scene_id, vehicle, candidate_id, state, pose, reported_at, expires_at"


def upgrade() -> None:
    """Copy the visits into a table with numbers."""
    number = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
    op.create_table(
        "numbered_visits", sa.Column("number", number, primary_key=True, autoincrement=True), *_columns()
    )
    _replace_by("numbered_visits")
    op.create_index("ix_visits_scene_id", "visits", ["scene_id"])


def downgrade() -> None:
    """Drop them: earlier versions have one for each id, and all expire within a day."""
    op.drop_table("visits")
    op.create_table("visits", *_columns(), sa.PrimaryKeyConstraint("scene_id", "vehicle", "candidate_id"))


def _columns() -> list[sa.Column[object]]:
    return [
        sa.Column("scene_id", sa.String(40), sa.ForeignKey("scenes.id"), nullable=False),
        sa.Column("vehicle", sa.String(64), nullable=False),
        sa.Column("candidate_id", sa.String(128), nullable=False),
        sa.Column("state", sa.String(16), nullable=False),
        sa.Column("pose", sa.JSON, nullable=False),
        sa.Column("reported_at", UtcDateTime, nullable=False),
        sa.Column("expires_at", UtcDateTime, nullable=False),
    ]


def _replace_by(table: str) -> None:
    op.execute(f"INSERT INTO {table} ({_KEPT}) SELECT {_KEPT} FROM visits ORDER BY reported_at")
    op.drop_table("visits")
    op.rename_table(table, "visits")
