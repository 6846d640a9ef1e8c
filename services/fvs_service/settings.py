"""The settings of the service: one frozen object."""

import ipaddress
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, FilePath, ValidationInfo, field_validator
from pydantic_settings import (
    BaseSettings,
    EnvSettingsSource,
    NoDecode,
    PydanticBaseSettingsSource,
    SettingsConfigDict,
)

from fvs_engine.images.limits import MAX_ASPECT_RATIO, MAX_PIXELS, MAX_SIDE_PX, MIN_SIDE_PX, ImageLimits
from fvs_engine.records import Record

MEGABYTE = 1_000_000
GIGABYTE = 1_000 * MEGABYTE
_PREFIX = "FVS_"
_FILE = "_FILE"


def _names(value: object) -> object:
    """The names of a list with commas, as environment variables have it."""
    return (
        tuple(name.strip() for name in value.split(",") if name.strip()) if isinstance(value, str) else value
    )


# Numbers beyond these have no sense, and some of them overflow clocks and timers.
_Bytes = Annotated[int, Field(ge=1, le=1_000_000 * GIGABYTE)]
_Room = Annotated[int, Field(ge=0, le=1_000_000 * GIGABYTE)]
_Number = Annotated[int, Field(ge=1, le=1_000_000_000)]
_Few = Annotated[int, Field(ge=1, le=10_000)]
_Processes = Annotated[int, Field(ge=1, le=256)]
_Iterations = Annotated[int, Field(ge=1, le=10_000_000)]
_Gaussians = Annotated[int, Field(ge=1_000, le=100_000_000)]
_Seconds = Annotated[float, Field(ge=1e-3, le=31_536_000)]
_Days = Annotated[float, Field(ge=1e-3, le=36_500)]


class Limits(Record):
    """Limits per request, scene and tenant; published by ``GET /v1/capabilities``."""

    image_bytes: int = Field(default=64 * MEGABYTE, ge=1, le=100 * GIGABYTE)
    image_pixels: int = Field(default=128_000_000, ge=1, le=MAX_PIXELS)
    image_min_side_px: int = Field(default=MIN_SIDE_PX, ge=1, le=MAX_SIDE_PX)
    image_max_side_px: int = Field(default=MAX_SIDE_PX, ge=1, le=MAX_PIXELS)
    image_max_aspect_ratio: float = Field(default=MAX_ASPECT_RATIO, ge=1, le=MAX_PIXELS)
    image_decoding_bytes: _Bytes = 1024 * MEGABYTE
    multipart_files: int = Field(default=200, ge=1, le=100_000)
    multipart_bytes: _Bytes = 1024 * MEGABYTE
    json_bytes: int = Field(default=1_500_000, ge=1_000, le=64 * MEGABYTE)
    digests_per_check: int = Field(default=10_000, ge=1, le=1_000_000)
    images_per_scene: int = Field(default=10_000, ge=1, le=1_000_000)
    scenes_per_tenant: _Number = 1_000
    open_jobs_per_tenant: _Number = 32
    running_jobs_per_tenant: _Number = 8
    open_uploads_per_tenant: _Few = 32
    rankings_at_once_per_tenant: _Few = 64
    rankings_queued_per_scene: _Few = 64
    rankings_queued_per_key: _Few = 32
    ranking_timeout_s: float = Field(default=180.0, ge=1e-3, le=86_400)
    event_streams_per_tenant: _Few = 64
    candidates_per_ranking: int = Field(default=2_000, ge=1, le=100_000)
    page_items: int = Field(default=1_000, ge=1, le=100_000)

    @property
    def of_images(self) -> ImageLimits:
        """The limits of one image."""
        return ImageLimits(
            max_pixels=self.image_pixels,
            min_side_px=self.image_min_side_px,
            max_side_px=self.image_max_side_px,
            max_aspect_ratio=self.image_max_aspect_ratio,
            max_decoding_bytes=self.image_decoding_bytes,
        )


class BlobSettings(Record):
    """Where the blobs are, by default in a folder of the root.

    ``url`` is that of an object store (``s3://bucket/prefix``), ``endpoint`` the address of one that is not
    Amazon's. What is not given here comes from the variables ``AWS_…``.
    """

    url: str | None = Field(default=None, pattern=r"^s3://[a-z0-9]")
    endpoint: str | None = Field(default=None, pattern=r"^https?://")
    region: str | None = None
    access_key_id: str | None = None
    secret_access_key: str | None = Field(default=None, repr=False)


class WorkerSettings(Record):
    """How workers share the machine, and the defaults of jobs.

    ``address`` is the name or the address of this machine under
    which gateways and workers on other machines reach its runners, which then listen there.

    ``work`` is what its workers do: structure from motion, after which a job waits for one that trains, or
    training. ``memory_bytes`` is for all scenes of one worker, by default its share of three quarters of
    the machine's memory; jobs that do not fit wait. A job starts when the disk has ``start_bytes`` more
    than the reserve, and stops when it comes to the reserve. After ``turn_s`` it makes room for waiting
    jobs of tenants with fewer running ones. ``threads`` is per job, by default all cores. A runner that is
    idle for ``idle_s`` ends. Of the jobs on one GPU ``trainings_per_gpu`` train at once. Jobs whose
    notification was lost are found after ``queue_poll_s``.
    """

    count: _Processes = 1
    address: str = Field(default="127.0.0.1", pattern=r"^[A-Za-z0-9.:_-]+$", max_length=120)
    work: Literal["all", "sfm", "training"] = "all"
    jobs_at_once: _Processes = 1
    trainings_per_gpu: _Processes = 1
    turn_s: _Seconds = 30.0
    memory_bytes: _Bytes | None = None
    start_bytes: _Room = 100 * MEGABYTE
    idle_s: _Seconds = 600.0
    threads: int | None = Field(default=None, ge=1, le=1_024)
    backend: str = "auto"
    long_side_px: int = Field(default=800, ge=64, le=8192)
    initial_iterations: _Iterations = 1_000
    iterations_per_image: _Iterations = 100
    fine_iterations: _Iterations = 30_000
    max_gaussians: _Gaussians = 100_000
    fine_max_gaussians: _Gaussians = 1_000_000
    queue_poll_s: _Seconds = 5.0


class Retention(Record):
    """How long snapshots and rankings, by default for ever, and events are kept.

    Of each scene's the newest ``snapshots``, ``rankings`` and ``events`` stay, and those younger than
    ``snapshot_days``, ``ranking_days`` and ``event_days``; with both limits, what exceeds either is deleted.
    Scenes can have numbers of their own for snapshots and rankings.
    """

    snapshots: _Number | None = None
    snapshot_days: _Days | None = None
    rankings: _Number | None = None
    ranking_days: _Days | None = None
    events: _Number | None = 10_000
    event_days: _Days | None = 90.0


class _FilesOfEnvironment(EnvSettingsSource):
    """Values of variables from files, for secrets: ``FVS_DATABASE_URL_FILE``."""

    def _load_env_vars(self) -> Mapping[str, Any]:
        named = {name: file for name, file in os.environ.items() if name.startswith(_PREFIX)}
        return {
            name.removesuffix(_FILE).lower(): Path(file).read_text(encoding="utf-8").strip()
            for name, file in named.items()
            if name.endswith(_FILE)
        }


class Settings(BaseSettings):
    """Settings from the environment (``FVS_ROOT``, ``FVS_LIMITS__IMAGE_BYTES``, …) or from code.

    ``root`` is the folder of everything that the service keeps on one machine. ``database_url`` is another
    place for the database, which is SQLite in ``root`` by default. With the suffix ``_FILE`` a variable names
    the file that has its value: ``FVS_DATABASE_URL_FILE=/run/secrets/database-url``.
    ``allowed_hosts`` and ``allowed_origins`` are names besides loopback's under which browsers may reach the
    service, and origins besides its own whose pages may use it. Events whose notification was lost are
    found after ``event_poll_s``. A body that for ``upload_grace_s`` in all has arrived more slowly than
    ``upload_bytes_per_s`` is refused. When a tenant's places for uploads are all held, an upload that is
    older than ``upload_place_s`` gives way to a new one (see ``images.upload_places``). gRPC is served beside
    REST (alone when ``rest`` is false), unless ``grpc`` is false, by default on the port after ``port`` (on a
    free one when that is 0). An upload that breaks off is kept for ``partial_upload_s``.
    """

    model_config = SettingsConfigDict(
        env_prefix=_PREFIX, env_nested_delimiter="__", frozen=True, extra="forbid"
    )

    root: Path = Path("fvs-service")
    database_url: str | None = Field(
        default=None, repr=False, pattern=r"^(postgres|postgresql|sqlite)(\+[a-z0-9]+)?://"
    )
    blobs: BlobSettings = BlobSettings()
    host: str = "127.0.0.1"
    port: int = Field(default=8000, ge=0, le=65_535)
    rest: bool = True
    grpc: bool = True
    grpc_port: int | None = Field(default=None, ge=0, le=65_535)
    require_keys: bool = False
    tls_certificate: FilePath | None = None
    tls_key: FilePath | None = None
    tls_client_ca: FilePath | None = None
    reserve_bytes: _Room = 500 * MEGABYTE
    lease_s: _Seconds = 20.0
    event_poll_s: _Seconds = 5.0
    event_heartbeat_s: _Seconds = 15.0
    upload_idle_s: _Seconds = 30.0
    upload_grace_s: _Seconds = 30.0
    upload_bytes_per_s: float = Field(default=500.0, ge=1e-3, le=GIGABYTE)
    upload_place_s: _Seconds = 300.0
    partial_upload_s: _Seconds = 3600.0
    read_within_s: _Seconds = 120.0
    allowed_hosts: Annotated[tuple[str, ...], NoDecode, BeforeValidator(_names)] = ()
    allowed_origins: Annotated[tuple[str, ...], NoDecode, BeforeValidator(_names)] = ()
    inspectors: _Processes = 2
    inspection_s: _Seconds = 60.0
    inspection_bytes: int = Field(default=2048 * MEGABYTE, ge=64 * MEGABYTE, le=1_000_000 * GIGABYTE)
    limits: Limits = Limits()
    worker: WorkerSettings = WorkerSettings()
    retention: Retention = Retention()
    sweep_s: _Seconds = 20.0
    """Interval of the sweeps, which apply retention and remove deleted blobs."""
    removal_grace_s: _Seconds = 180.0
    """How long the blobs of a deleted snapshot stay for rankings in computation, which end sooner."""

    @classmethod
    def settings_customise_sources(
        cls,
        settings_cls: type[BaseSettings],
        init_settings: PydanticBaseSettingsSource,
        env_settings: PydanticBaseSettingsSource,
        dotenv_settings: PydanticBaseSettingsSource,  # noqa: ARG003 - the names are the base class's
        file_secret_settings: PydanticBaseSettingsSource,  # noqa: ARG003
    ) -> tuple[PydanticBaseSettingsSource, ...]:
        """Values from code, from the environment, from files that the environment names."""
        return init_settings, env_settings, _FilesOfEnvironment(settings_cls)

    @field_validator("grpc")
    @classmethod
    def _serves_something(cls, grpc: bool, known: ValidationInfo) -> bool:
        if not grpc and not known.data.get("rest", True):
            raise ValueError("a gateway without REST needs gRPC")
        return grpc

    @property
    def database(self) -> str:
        """The database's URL for SQLAlchemy."""
        return self.database_url or f"sqlite:///{self.root.absolute() / 'fvs.sqlite3'}"

    @property
    def on_one_machine(self) -> bool:
        """Whether no other machine shares the database."""
        return self.database.startswith("sqlite")

    @property
    def scenes(self) -> Path:
        """The folder of the scenes' working files on a worker."""
        return self.root / "scenes"

    @property
    def staging(self) -> Path:
        """The folder of uploads that have not fully arrived."""
        return self.root / "staging"

    @property
    def partial_uploads(self) -> Path:
        """The folder of uploads that broke off and may be resumed."""
        return self.root / "partial-uploads"

    @property
    def rpc_port(self) -> int | None:
        """The port of gRPC; None when it is not served."""
        if not self.grpc:
            return None
        if self.grpc_port is not None:
            return self.grpc_port
        return self.port + 1 if 0 < self.port < 65_535 else 0

    @property
    def loopback(self) -> bool:
        """Whether the gateway can only be reached from this machine."""
        if self.host == "localhost":
            return True
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return False

    @property
    def keys_required(self) -> bool:
        """Whether requests need an API key."""
        return self.require_keys or not self.loopback
