"""The tables of the database. Only repositories use rows; they return domain models."""

from datetime import UTC, datetime
from typing import Any

import sqlalchemy
from sqlalchemy import JSON, BigInteger, DateTime, ForeignKey, Index, Integer, String, Text, text
from sqlalchemy.engine import Dialect
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column
from sqlalchemy.types import TypeDecorator

from fvs_service.storage.clock import now_ms


class UtcDateTime(TypeDecorator[datetime]):
    """Timestamps in UTC, also in databases without time zones (SQLite)."""

    impl = DateTime(timezone=True)
    cache_ok = True

    def process_bind_param(self, value: datetime | None, _dialect: Dialect) -> datetime | None:
        """Store UTC."""
        return None if value is None else value.astimezone(UTC)

    def process_result_value(self, value: datetime | None, _dialect: Dialect) -> datetime | None:
        """Return UTC."""
        if value is None:
            return None
        return value.replace(tzinfo=UTC) if value.tzinfo is None else value.astimezone(UTC)


class Table(DeclarativeBase):
    """Base of all tables."""

    type_annotation_map = {datetime: UtcDateTime, dict[str, Any]: JSON, list[Any]: JSON}  # noqa: RUF012


def columns_of(kind: type[Table]) -> sqlalchemy.Table:
    """The table of a class of rows, for statements that make no objects: they take half the time."""
    table = kind.__table__
    assert isinstance(table, sqlalchemy.Table)
    return table


class Recorded:
    """Rows that record when they were added, by the clock of the database.

    The order of ids alone is that of the machines' clocks, which may differ.
    """

    id: Mapped[str] = mapped_column(String(40), primary_key=True)
    recorded_at_ms: Mapped[int] = mapped_column(BigInteger, default=now_ms())

    @classmethod
    def in_order(cls) -> "sqlalchemy.Tuple":
        """A value that orders rows."""
        return sqlalchemy.tuple_(cls.recorded_at_ms, cls.id)

    @classmethod
    def oldest_first(cls) -> tuple[sqlalchemy.ColumnElement[Any], ...]:
        """The arguments of ``order_by``."""
        return cls.recorded_at_ms.asc(), cls.id.asc()

    @classmethod
    def newest_first(cls) -> tuple[sqlalchemy.ColumnElement[Any], ...]:
        """The arguments of ``order_by``."""
        return cls.recorded_at_ms.desc(), cls.id.desc()


class ApiKeyRow(Table):
    """An API key with the SHA-256 of its secret."""

    __tablename__ = "api_keys"

    id: Mapped[str] = mapped_column(String(40), primary_key=True)
    tenant_id: Mapped[str] = mapped_column(String(64), index=True)
    name: Mapped[str] = mapped_column(String(200))
    sha256: Mapped[str] = mapped_column(String(64))
    scopes: Mapped[list[Any]]
    scene_id: Mapped[str | None] = mapped_column(String(40))
    created_at: Mapped[datetime]
    expires_at: Mapped[datetime | None]
    revoked_at: Mapped[datetime | None]


class IdempotencyRow(Table):
    """The resource that a tenant's idempotency key created; ``fingerprint`` is a hash of the request."""

    __tablename__ = "idempotency_keys"

    tenant_id: Mapped[str] = mapped_column(String(64), primary_key=True)
    key: Mapped[str] = mapped_column(String(255), primary_key=True)
    fingerprint: Mapped[str] = mapped_column(String(64))
    resource_id: Mapped[str] = mapped_column(String(40))
    created_at: Mapped[datetime] = mapped_column(index=True)


class SceneRow(Recorded, Table):
    """A scene; ``snapshot_id`` points to the latest snapshot, ``working_copy`` to that of its folder.

    ``folded_name`` is its name for searches. Of its events those up to ``last_deleted_event`` are not kept
    any longer.
    """

    __tablename__ = "scenes"

    tenant_id: Mapped[str] = mapped_column(String(64), index=True)
    folded_name: Mapped[str] = mapped_column(Text)
    request: Mapped[dict[str, Any]]
    origin: Mapped[dict[str, Any] | None]
    control_points: Mapped[dict[str, Any] | None]
    snapshot_id: Mapped[str | None] = mapped_column(String(40))
    working_bytes: Mapped[int] = mapped_column(BigInteger)
    working_copy: Mapped[str | None] = mapped_column(String(40))
    last_image_number: Mapped[int]
    last_deleted_event: Mapped[int] = mapped_column(BigInteger)
    created_at: Mapped[datetime]


class SceneLeaseRow(Table):
    """The lease of a scene. ``token`` only increases; times are the database's, in ms since 1970."""

    __tablename__ = "scene_leases"

    scene_id: Mapped[str] = mapped_column(ForeignKey("scenes.id"), primary_key=True)
    worker_id: Mapped[str] = mapped_column(String(128), index=True)
    endpoint: Mapped[str | None] = mapped_column(String(255))
    token: Mapped[int] = mapped_column(BigInteger)
    expires_at_ms: Mapped[int] = mapped_column(BigInteger)


class WorkerRow(Table):
    """A worker's last heartbeat, by the database's clock.

    ``process_id``: the process that is the worker; ``slots``: the number of jobs that it runs at once;
    ``disk_full``: it takes no jobs for lack of room; ``runner_bytes``: the resident memory of its runners.
    """

    __tablename__ = "workers"

    id: Mapped[str] = mapped_column(String(128), primary_key=True)
    process_id: Mapped[str] = mapped_column(String(40))
    beaten_at_ms: Mapped[int] = mapped_column(BigInteger)
    slots: Mapped[int]
    disk_full: Mapped[bool]
    backend: Mapped[str] = mapped_column(String(16))
    runner_bytes: Mapped[int] = mapped_column(BigInteger)


class TenantRow(Table):
    """When the last turn of one of a tenant's jobs began (the database's clock)."""

    __tablename__ = "tenants"

    id: Mapped[str] = mapped_column(String(64), primary_key=True)
    served_at_ms: Mapped[int] = mapped_column(BigInteger)


class RunnerRequestRow(Table):
    """A scene whose runner a worker is to start."""

    __tablename__ = "runner_requests"

    scene_id: Mapped[str] = mapped_column(ForeignKey("scenes.id"), primary_key=True)


class ImageRow(Table):
    """An image of a scene; ``number`` counts in the order of arrival."""

    __tablename__ = "images"

    scene_id: Mapped[str] = mapped_column(ForeignKey("scenes.id"), primary_key=True)
    sha256: Mapped[str] = mapped_column(String(64), primary_key=True)
    number: Mapped[int]
    name: Mapped[str] = mapped_column(String(255))
    verdict: Mapped[str] = mapped_column(String(32))
    registration: Mapped[str] = mapped_column(String(16))
    pixels_sha256: Mapped[str | None] = mapped_column(String(64))
    document: Mapped[dict[str, Any]]
    received_at: Mapped[datetime]

    __table_args__ = (
        Index("ix_images_number", "scene_id", "number", unique=True),
        Index("ix_images_pixels", "scene_id", "pixels_sha256"),
        Index("ix_images_counts", "scene_id", "verdict", "registration"),
    )


def frames_not_taken() -> sqlalchemy.ColumnElement[bool]:
    """The condition that an image is a video whose frames are still to be taken."""
    return sqlalchemy.and_(ImageRow.verdict == "video", ImageRow.document["frames"].as_integer().is_(None))


class JobRow(Recorded, Table):
    """A job. While it is queued or running, it waits, or is in a turn on the worker ``worker_id``.

    ``taken_at_ms``: when its last turn began; ``waiting_since_ms``: since when it waits, or waited before its
    turn; ``obstacle``: what it lacked then, not to be tried again before ``not_before_ms`` (the database's
    clock); ``work``: what it needs next; ``starts``: those of its attempt without progress; ``traceparent``:
    the span of the request that queued it.
    """

    __tablename__ = "jobs"

    scene_id: Mapped[str] = mapped_column(ForeignKey("scenes.id"), index=True)
    tenant_id: Mapped[str] = mapped_column(String(64), index=True)
    kind: Mapped[str] = mapped_column(String(16))
    request: Mapped[dict[str, Any]]
    state: Mapped[str] = mapped_column(String(16), index=True)
    stage: Mapped[str | None] = mapped_column(String(64))
    progress: Mapped[float]
    eta_s: Mapped[float | None]
    attempt: Mapped[int] = mapped_column(Integer)
    worker_id: Mapped[str | None] = mapped_column(String(128), index=True)
    taken_at_ms: Mapped[int] = mapped_column(BigInteger)
    waiting_since_ms: Mapped[int] = mapped_column(BigInteger)
    obstacle: Mapped[str | None] = mapped_column(String(16))
    not_before_ms: Mapped[int] = mapped_column(BigInteger)
    work: Mapped[str] = mapped_column(String(16))
    starts: Mapped[dict[str, Any] | None]
    traceparent: Mapped[str | None] = mapped_column(String(64))
    cancel_requested: Mapped[bool]
    warnings: Mapped[list[Any]]
    error: Mapped[dict[str, Any] | None]
    snapshot_id: Mapped[str | None] = mapped_column(String(40))
    created_at: Mapped[datetime]
    started_at: Mapped[datetime | None]
    finished_at: Mapped[datetime | None]

    __table_args__ = (
        Index("ix_jobs_recorded", "recorded_at_ms", "id"),
        Index(
            "ix_jobs_one_queued",
            "scene_id",
            "kind",
            unique=True,
            sqlite_where=text("state = 'queued'"),
            postgresql_where=text("state = 'queued'"),
        ),
        Index(
            "ix_jobs_one_in_turn",
            "scene_id",
            unique=True,
            sqlite_where=text("worker_id IS NOT NULL"),
            postgresql_where=text("worker_id IS NOT NULL"),
        ),
    )


class JobMilestoneRow(Table):
    """A step that a job has finished and does not repeat, with the data that later steps need."""

    __tablename__ = "job_milestones"

    job_id: Mapped[str] = mapped_column(ForeignKey("jobs.id"), primary_key=True)
    name: Mapped[str] = mapped_column(String(64), primary_key=True)
    document: Mapped[dict[str, Any]]
    created_at: Mapped[datetime]


class SnapshotRow(Recorded, Table):
    """An immutable model of a scene; retention keeps those that are ``pinned``."""

    __tablename__ = "snapshots"

    scene_id: Mapped[str] = mapped_column(ForeignKey("scenes.id"), index=True)
    job_id: Mapped[str] = mapped_column(ForeignKey("jobs.id"), index=True)
    pinned: Mapped[bool]
    document: Mapped[dict[str, Any]]
    created_at: Mapped[datetime]


class SnapshotArtifactRow(Table):
    """A reference of a snapshot to the blob of an artifact; equal artifacts of a scene have one blob."""

    __tablename__ = "snapshot_artifacts"

    snapshot_id: Mapped[str] = mapped_column(ForeignKey("snapshots.id"), primary_key=True)
    name: Mapped[str] = mapped_column(String(64), primary_key=True)
    scene_id: Mapped[str] = mapped_column(ForeignKey("scenes.id"))
    sha256: Mapped[str] = mapped_column(String(64))
    size_bytes: Mapped[int] = mapped_column(BigInteger)

    __table_args__ = (Index("ix_snapshot_artifacts_blob", "scene_id", "sha256"),)


class RankingRow(Recorded, Table):
    """An immutable ranking; it can outlive its snapshot."""

    __tablename__ = "rankings"

    scene_id: Mapped[str] = mapped_column(ForeignKey("scenes.id"), index=True)
    snapshot_id: Mapped[str] = mapped_column(String(40))
    document: Mapped[dict[str, Any]]
    created_at: Mapped[datetime]


class PlanRow(Recorded, Table):
    """An immutable plan; it can outlive its snapshot."""

    __tablename__ = "plans"

    scene_id: Mapped[str] = mapped_column(ForeignKey("scenes.id"), index=True)
    snapshot_id: Mapped[str] = mapped_column(String(40))
    document: Mapped[dict[str, Any]]
    created_at: Mapped[datetime]


class VisitRow(Table):
    """What a vehicle does about a view, until it expires; ``pose`` is as the vehicle gave it.

    Candidates of different rankings have the same ids, so one vehicle may have several visits with one id.
    """

    __tablename__ = "visits"

    number: Mapped[int] = mapped_column(
        BigInteger().with_variant(Integer, "sqlite"), primary_key=True, autoincrement=True
    )
    scene_id: Mapped[str] = mapped_column(ForeignKey("scenes.id"), index=True)
    vehicle: Mapped[str] = mapped_column(String(64))
    candidate_id: Mapped[str] = mapped_column(String(128))
    state: Mapped[str] = mapped_column(String(16))
    pose: Mapped[dict[str, Any]]
    reported_at: Mapped[datetime]
    expires_at: Mapped[datetime]


class EventRow(Table):
    """An event of a scene; ``number`` increases in the order of commits. The last one outlives the scene."""

    __tablename__ = "events"

    number: Mapped[int] = mapped_column(
        BigInteger().with_variant(Integer, "sqlite"), primary_key=True, autoincrement=True
    )
    scene_id: Mapped[str] = mapped_column(String(40))
    kind: Mapped[str] = mapped_column(String(32))
    subject: Mapped[str | None] = mapped_column(String(80))
    data: Mapped[dict[str, Any]]
    created_at: Mapped[datetime]

    __table_args__ = (
        Index("ix_events_scene", "scene_id", "number"),
        {"sqlite_autoincrement": True},
    )


class WebhookRow(Table):
    """A webhook, and how far its deliveries are: up to the event ``delivered``.

    It outlives its scene until it has delivered the scene's last event. ``not_before_ms``: when the next
    delivery may begin, and until when a gateway has claimed the webhook (the database's clock).
    """

    __tablename__ = "webhooks"

    id: Mapped[str] = mapped_column(String(40), primary_key=True)
    scene_id: Mapped[str] = mapped_column(String(40), index=True)
    tenant_id: Mapped[str] = mapped_column(String(64))
    url: Mapped[str] = mapped_column(String(2_000))
    secret: Mapped[str] = mapped_column(String(100))
    kinds: Mapped[list[Any]]
    delivered: Mapped[int] = mapped_column(BigInteger)
    not_before_ms: Mapped[int] = mapped_column(BigInteger)
    failures: Mapped[int]
    failing_since: Mapped[datetime | None]
    error: Mapped[str | None] = mapped_column(String(500))
    disabled: Mapped[bool]
    created_at: Mapped[datetime]
    delivered_at: Mapped[datetime | None]


class RemovalRow(Table):
    """Blobs to remove once they are due: one, or all below a ``key`` that ends with a slash.

    A row with ``removed_at`` is all that is left of a scene: workers remove its working folders.
    """

    __tablename__ = "removals"

    key: Mapped[str] = mapped_column(String(255), primary_key=True)
    scene_id: Mapped[str] = mapped_column(String(40), index=True)
    created_at: Mapped[datetime]
    due_at: Mapped[datetime]
    removed_at: Mapped[datetime | None]

    __table_args__ = (Index("ix_removals_due", "removed_at", "due_at"),)


class IdentityRow(Table):
    """The database's identity: one row, made with the table. Copies and backups have the same."""

    __tablename__ = "identity"

    id: Mapped[str] = mapped_column(String(40), primary_key=True)


class SweepRow(Table):
    """When the next sweep is due (in ms since 1970 by the database); a worker postpones it, then runs it."""

    __tablename__ = "sweeps"

    name: Mapped[str] = mapped_column(String(32), primary_key=True)
    due_at_ms: Mapped[int] = mapped_column(BigInteger)
