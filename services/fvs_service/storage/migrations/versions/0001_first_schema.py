"""The first schema: all tables of the service."""

import sqlalchemy as sa
from alembic import op
from fvs_service.ids import new_id
from fvs_service.storage.tables import UtcDateTime

revision = "0001"
down_revision = None
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Create the tables and their indexes, and give the database its identity."""
    _create_tables_of_the_service()
    _create_tables_of_scenes()
    _create_tables_of_jobs()
    _create_tables_of_flights_and_webhooks()


def _create_tables_of_the_service() -> None:
    identity = op.create_table("identity", sa.Column("id", sa.String(40), primary_key=True))
    op.bulk_insert(identity, [{"id": new_id("dbs")}])
    op.create_table(
        "workers",
        sa.Column("id", sa.String(128), primary_key=True),
        sa.Column("process_id", sa.String(40), nullable=False),
        sa.Column("beaten_at_ms", sa.BigInteger(), nullable=False),
        sa.Column("slots", sa.Integer(), nullable=False),
        sa.Column("disk_full", sa.Boolean(), nullable=False),
        sa.Column("backend", sa.String(16), nullable=False),
        sa.Column("runner_bytes", sa.BigInteger(), nullable=False),
    )
    op.create_table(
        "tenants",
        sa.Column("id", sa.String(64), primary_key=True),
        sa.Column("served_at_ms", sa.BigInteger(), nullable=False),
    )
    op.create_table(
        "removals",
        sa.Column("key", sa.String(255), primary_key=True),
        sa.Column("scene_id", sa.String(40), nullable=False, index=True),
        _time("created_at"),
        _time("due_at"),
        _time("removed_at", nullable=True),
        sa.Index("ix_removals_due", "removed_at", "due_at"),
    )
    op.create_table(
        "sweeps",
        sa.Column("name", sa.String(32), primary_key=True),
        sa.Column("due_at_ms", sa.BigInteger(), nullable=False),
    )
    op.create_table(
        "api_keys",
        sa.Column("id", sa.String(40), primary_key=True),
        sa.Column("tenant_id", sa.String(64), nullable=False, index=True),
        sa.Column("name", sa.String(200), nullable=False),
        sa.Column("sha256", sa.String(64), nullable=False),
        sa.Column("scopes", sa.JSON(), nullable=False),
        sa.Column("scene_id", sa.String(40)),
        _time("created_at"),
        _time("expires_at", nullable=True),
        _time("revoked_at", nullable=True),
    )
    op.create_table(
        "idempotency_keys",
        sa.Column("tenant_id", sa.String(64), primary_key=True),
        sa.Column("key", sa.String(255), primary_key=True),
        sa.Column("fingerprint", sa.String(64), nullable=False),
        sa.Column("resource_id", sa.String(40), nullable=False),
        _time("created_at", index=True),
    )


def _create_tables_of_scenes() -> None:
    op.create_table(
        "scenes",
        *_recorded(),
        sa.Column("tenant_id", sa.String(64), nullable=False, index=True),
        sa.Column("folded_name", sa.Text(), nullable=False),
        sa.Column("request", sa.JSON(), nullable=False),
        sa.Column("origin", sa.JSON()),
        sa.Column("control_points", sa.JSON()),
        sa.Column("snapshot_id", sa.String(40)),
        sa.Column("working_bytes", sa.BigInteger(), nullable=False),
        sa.Column("working_copy", sa.String(40)),
        sa.Column("last_image_number", sa.Integer(), nullable=False),
        sa.Column("last_deleted_event", sa.BigInteger(), nullable=False),
        _time("created_at"),
    )
    op.create_table(
        "scene_leases",
        _reference("scene_id", "scenes", primary_key=True),
        sa.Column("worker_id", sa.String(128), nullable=False, index=True),
        sa.Column("endpoint", sa.String(255)),
        sa.Column("token", sa.BigInteger(), nullable=False),
        sa.Column("expires_at_ms", sa.BigInteger(), nullable=False),
    )
    op.create_table("runner_requests", _reference("scene_id", "scenes", primary_key=True))
    op.create_table(
        "events",
        _number(),
        sa.Column("scene_id", sa.String(40), nullable=False),
        sa.Column("kind", sa.String(32), nullable=False),
        sa.Column("subject", sa.String(80)),
        sa.Column("data", sa.JSON(), nullable=False),
        _time("created_at"),
        sa.Index("ix_events_scene", "scene_id", "number"),
        sqlite_autoincrement=True,
    )
    op.create_table(
        "images",
        _reference("scene_id", "scenes", primary_key=True),
        sa.Column("sha256", sa.String(64), primary_key=True),
        sa.Column("number", sa.Integer(), nullable=False),
        sa.Column("name", sa.String(255), nullable=False),
        sa.Column("verdict", sa.String(32), nullable=False),
        sa.Column("registration", sa.String(16), nullable=False),
        sa.Column("pixels_sha256", sa.String(64)),
        sa.Column("document", sa.JSON(), nullable=False),
        _time("received_at"),
        sa.Index("ix_images_number", "scene_id", "number", unique=True),
        sa.Index("ix_images_pixels", "scene_id", "pixels_sha256"),
        sa.Index("ix_images_counts", "scene_id", "verdict", "registration"),
    )


def _create_tables_of_jobs() -> None:
    queued, in_turn = sa.text("state = 'queued'"), sa.text("worker_id IS NOT NULL")
    op.create_table(
        "jobs",
        *_recorded(),
        _reference("scene_id", "scenes", index=True),
        sa.Column("tenant_id", sa.String(64), nullable=False, index=True),
        sa.Column("kind", sa.String(16), nullable=False),
        sa.Column("request", sa.JSON(), nullable=False),
        sa.Column("state", sa.String(16), nullable=False, index=True),
        sa.Column("stage", sa.String(64)),
        sa.Column("progress", sa.Double(), nullable=False),
        sa.Column("eta_s", sa.Double()),
        sa.Column("attempt", sa.Integer(), nullable=False),
        sa.Column("worker_id", sa.String(128), index=True),
        sa.Column("taken_at_ms", sa.BigInteger(), nullable=False),
        sa.Column("waiting_since_ms", sa.BigInteger(), nullable=False),
        sa.Column("obstacle", sa.String(16)),
        sa.Column("not_before_ms", sa.BigInteger(), nullable=False),
        sa.Column("work", sa.String(16), nullable=False),
        sa.Column("starts", sa.JSON()),
        sa.Column("traceparent", sa.String(64)),
        sa.Column("cancel_requested", sa.Boolean(), nullable=False),
        sa.Column("warnings", sa.JSON(), nullable=False),
        sa.Column("error", sa.JSON()),
        sa.Column("snapshot_id", sa.String(40)),
        _time("created_at"),
        _time("started_at", nullable=True),
        _time("finished_at", nullable=True),
        sa.Index("ix_jobs_recorded", "recorded_at_ms", "id"),
        sa.Index(
            "ix_jobs_one_queued",
            "scene_id",
            "kind",
            unique=True,
            sqlite_where=queued,
            postgresql_where=queued,
        ),
        sa.Index(
            "ix_jobs_one_in_turn",
            "scene_id",
            unique=True,
            sqlite_where=in_turn,
            postgresql_where=in_turn,
        ),
    )
    op.create_table(
        "job_milestones",
        _reference("job_id", "jobs", primary_key=True),
        sa.Column("name", sa.String(64), primary_key=True),
        sa.Column("document", sa.JSON(), nullable=False),
        _time("created_at"),
    )
    op.create_table(
        "snapshots",
        *_recorded(),
        _reference("scene_id", "scenes", index=True),
        _reference("job_id", "jobs", index=True),
        sa.Column("pinned", sa.Boolean(), nullable=False),
        sa.Column("document", sa.JSON(), nullable=False),
        _time("created_at"),
    )
    op.create_table(
        "snapshot_artifacts",
        _reference("snapshot_id", "snapshots", primary_key=True),
        sa.Column("name", sa.String(64), primary_key=True),
        _reference("scene_id", "scenes"),
        sa.Column("sha256", sa.String(64), nullable=False),
        sa.Column("size_bytes", sa.BigInteger(), nullable=False),
        sa.Index("ix_snapshot_artifacts_blob", "scene_id", "sha256"),
    )
    for results in ("rankings", "plans"):
        op.create_table(
            results,
            *_recorded(),
            _reference("scene_id", "scenes", index=True),
            sa.Column("snapshot_id", sa.String(40), nullable=False),
            sa.Column("document", sa.JSON(), nullable=False),
            _time("created_at"),
        )


def _create_tables_of_flights_and_webhooks() -> None:
    op.create_table(
        "visits",
        _number(),
        _reference("scene_id", "scenes", index=True),
        sa.Column("vehicle", sa.String(64), nullable=False),
        sa.Column("candidate_id", sa.String(128), nullable=False),
        sa.Column("state", sa.String(16), nullable=False),
        sa.Column("pose", sa.JSON(), nullable=False),
        _time("reported_at"),
        _time("expires_at"),
    )
    op.create_table(
        "webhooks",
        sa.Column("id", sa.String(40), primary_key=True),
        sa.Column("scene_id", sa.String(40), nullable=False, index=True),
        sa.Column("tenant_id", sa.String(64), nullable=False),
        sa.Column("url", sa.String(2_000), nullable=False),
        sa.Column("secret", sa.String(100), nullable=False),
        sa.Column("kinds", sa.JSON(), nullable=False),
        sa.Column("delivered", sa.BigInteger(), nullable=False),
        sa.Column("not_before_ms", sa.BigInteger(), nullable=False),
        sa.Column("failures", sa.Integer(), nullable=False),
        _time("failing_since", nullable=True),
        sa.Column("error", sa.String(500)),
        sa.Column("disabled", sa.Boolean(), nullable=False),
        _time("created_at"),
        _time("delivered_at", nullable=True),
    )


def _number() -> sa.Column[object]:
    kind = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
    return sa.Column("number", kind, primary_key=True, autoincrement=True)


def _recorded() -> tuple[sa.Column[object], sa.Column[object]]:
    return (
        sa.Column("id", sa.String(40), primary_key=True),
        sa.Column("recorded_at_ms", sa.BigInteger(), nullable=False),
    )


def _time(name: str, *, nullable: bool = False, index: bool = False) -> sa.Column[object]:
    return sa.Column(name, UtcDateTime(timezone=True), nullable=nullable, index=index)


def _reference(name: str, table: str, *, primary_key: bool = False, index: bool = False) -> sa.Column[object]:
    return sa.Column(
        name,
        sa.String(40),
        sa.ForeignKey(f"{table}.id"),
        primary_key=primary_key,
        nullable=False,
        index=index,
    )
