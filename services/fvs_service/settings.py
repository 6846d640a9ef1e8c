"""The settings of the service: one frozen object."""

import re
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, BeforeValidator, Field, FilePath, ValidationInfo, field_validator
from pydantic_settings import (
    BaseSettings,
    NoDecode,
    PydanticBaseSettingsSource,
    SettingsConfigDict,
)

from fvs_engine.records import Record
from fvs_schema.service import Limits
from fvs_service.environment import (
    PREFIX,
    FilesOfEnvironment,
    UnknownOfEnvironment,
    ValuesOfEnvironment,
)
from fvs_service.host_names import host_of, is_loopback, name_or_network, web_origin

GPU_MEMORY = "fvs-gpu-memory"
"""The private folder of reservations of GPU memory, which the runners of a machine's user share."""
MEGABYTE = 1_000_000
GIGABYTE = 1_000 * MEGABYTE


def _names(value: object) -> object:
    """The names of a list with commas, as environment variables have it."""
    return (
        tuple(name.strip() for name in value.split(",") if name.strip()) if isinstance(value, str) else value
    )


_Origin = Annotated[str, AfterValidator(web_origin)]
_WebhookHost = Annotated[str, AfterValidator(name_or_network)]

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


class BlobSettings(Record):
    """The store of images and models."""

    url: str | None = Field(default=None, pattern=r"^s3://[a-z0-9]")
    """Bucket of an S3-compatible object store: ``s3://bucket/prefix``. By default blobs are in the root."""
    endpoint: str | None = Field(default=None, pattern=r"^https?://")
    """URL of the object store, if it is not Amazon S3."""
    region: str | None = None
    """Region of the bucket."""
    access_key_id: str | None = None
    """Access key; by default that of the ``AWS_…`` variables or of the machine's role."""
    secret_access_key: str | None = Field(default=None, repr=False)
    """Secret of the access key."""


class WorkerSettings(Record):
    """The share of the machine that workers use, and the defaults of jobs."""

    count: _Processes = 1
    """Number of workers (``--workers``). They share one GPU."""
    jobs_at_once: _Processes = 1
    """Maximum number of jobs that one worker runs at once."""
    turn_s: _Seconds = 30.0
    """After this time a job makes room for a waiting job that is preferred."""
    memory_bytes: _Bytes | None = None
    """Memory for all scenes of one worker, by default ¾ of the machine's divided by ``count``. A job
    that does not fit waits."""
    idle_s: _Seconds = 600.0
    """A runner that has no requests for this time ends."""
    threads: int | None = Field(default=None, ge=1, le=1_024)
    """Threads of one runner, by default all cores; in a cluster the CPUs that a scene takes of its node, by
    default 2. With 1, results repeat bit by bit."""
    gpus: float | None = Field(default=None, ge=0, le=16)
    """In a cluster, the GPUs that a scene takes to train: a share below 1, or a whole number. By default 1
    where a node has one, else 0."""
    backend: str = "auto"
    """Rasteriser: ``cpu``, ``triton``, ``gsplat``, or ``auto``: ``gsplat`` where it can run."""
    long_side_px: int = Field(default=800, ge=64, le=8192)
    """Long side to which updates reduce training images."""
    initial_iterations: _Iterations = 2_000
    """Minimum number of training iterations of the full model that every update trains; an eighth of them
    sees images of full size. The quick model that precedes it has a quarter of the iterations, none at full
    size; with images below 800 px a fifth."""
    iterations_per_image: _Iterations = 40
    """Training iterations of full models per image of the scene."""
    fine_iterations: _Iterations = 30_000
    """Training iterations of fine models."""
    max_gaussians: _Gaussians = 100_000
    """Maximum number of Gaussians in a model that updates train."""
    fine_max_gaussians: _Gaussians = 1_000_000
    """Maximum number of Gaussians in a fine model."""

    @field_validator("gpus")
    @classmethod
    def _can_be_divided(cls, gpus: float | None) -> float | None:
        if gpus is not None and gpus > 1 and not gpus.is_integer():
            raise ValueError("more than one GPU must be a whole number")
        return gpus


class Retention(Record):
    """How many snapshots, rankings, plans, events and jobs each scene keeps, and for how long.

    What exceeds either limit is deleted. Scenes can have their own numbers for snapshots, rankings and plans.
    The idempotency keys of a tenant are limited in the same way.
    """

    snapshots: _Number | None = None
    """Number of snapshots that a scene keeps; by default all."""
    snapshot_days: _Days | None = None
    """Age up to which snapshots are kept; by default without limit."""
    rankings: _Number | None = None
    """Number of rankings that a scene keeps; by default all."""
    ranking_days: _Days | None = None
    """Age up to which rankings are kept; by default without limit."""
    plans: _Number | None = None
    """Number of plans that a scene keeps; by default all."""
    plan_days: _Days | None = None
    """Age up to which plans are kept; by default without limit."""
    events: _Number | None = 10_000
    """Number of events that a scene keeps."""
    event_days: _Days | None = 90.0
    """Number of days for which events are kept."""
    jobs: _Number | None = 1_000
    """Number of jobs that a scene keeps; those that have not ended, or whose snapshot exists, stay."""
    job_days: _Days | None = 90.0
    """Number of days for which ended jobs are kept."""
    idempotency_keys: _Number = 10_000
    """Number of idempotency keys that a tenant keeps."""
    idempotency_days: _Days = 2.0
    """Number of days for which an idempotency key is kept: a repeated request creates nothing new."""


_CLUSTER = re.compile(r"auto|ray://[A-Za-z0-9._-]+:[0-9]{1,5}")
_TILES = r"^https?://([A-Za-z0-9._-]+|\[[0-9A-Fa-f:.]+\])(:[0-9]{1,5})?/\S*\{z\}\S*$"
"""The host becomes part of a header, in which other characters would have a meaning."""


class BasemapSettings(Record):
    """What the console's map shows below the scene; by default nothing, so that it contacts nobody."""

    tiles: str | None = Field(default=None, pattern=_TILES, max_length=500)
    """URL of raster tiles with ``{z}``, ``{x}`` and ``{y}``. Browsers that show the console load them."""
    archive: FilePath | None = None
    """A file of tiles (PMTiles 3) that the service sends: raster tiles, or vectors as Protomaps has."""
    attribution: str = Field(default="", max_length=200)
    """Whom the map names as the source of its tiles."""

    @field_validator("archive")
    @classmethod
    def _one_source(cls, archive: FilePath | None, known: ValidationInfo) -> FilePath | None:
        if archive is not None and known.data.get("tiles") is not None:
            raise ValueError("give either FVS_BASEMAP__TILES or FVS_BASEMAP__ARCHIVE")
        return archive

    @property
    def origins(self) -> tuple[str, ...]:
        """Web origins that the page contacts for tiles."""
        return () if self.tiles is None else ("/".join(self.tiles.split("/")[:3]),)


class Settings(BaseSettings):
    """Settings from the environment (``FVS_ROOT``, ``FVS_LIMITS__IMAGE_BYTES``, …) or from code.

    A variable with the suffix ``_FILE`` names a file that has the value:
    ``FVS_DATABASE_URL_FILE=/run/secrets/database-url``.
    """

    model_config = SettingsConfigDict(
        env_prefix=PREFIX, env_nested_delimiter="__", frozen=True, extra="forbid"
    )

    root: Path = Path("fvs-service")
    """Folder of all data that the service keeps on this machine (``--root``)."""
    database_url: str | None = Field(
        default=None, repr=False, pattern=r"^(postgres|postgresql|sqlite)(\+[a-z0-9]+)?://"
    )
    """URL of a PostgreSQL database; without it, SQLite in the root."""
    blobs: BlobSettings = BlobSettings()
    cluster: str | None = Field(default=None)
    """Ray cluster whose nodes run the jobs: ``ray://host:10001``, or ``auto`` on a machine that is one of
    them. It needs PostgreSQL, an object store, and the extra ``fvs[ray]``."""
    host: str = "127.0.0.1"
    """Address to listen on (``--host``)."""
    port: int = Field(default=8000, ge=0, le=65_535)
    """Port of HTTP (``--port``); 0 is a free one."""
    rest: bool = True
    """Serve REST (``--no-rest``). Without it, HTTP has only ``/livez``, ``/readyz`` and ``/metrics``."""
    console: bool = True
    """Serve the operator's console at ``/`` (``--no-console``), besides REST."""
    basemap: BasemapSettings = BasemapSettings()
    grpc: bool = True
    """Serve gRPC (``--no-grpc``)."""
    grpc_port: int | None = Field(default=None, ge=0, le=65_535)
    """Port of gRPC (``--grpc-port``), by default the one after ``port``; 0 is a free one."""
    require_keys: bool | None = None
    """Whether every request needs an API key. By default it does where ``host`` or one of ``allowed_hosts``
    is not loopback, and once a key was created. ``false`` serves whoever can reach the service."""
    reserve_bytes: _Room = 500 * MEGABYTE
    """Disk space that uploads and jobs leave free. Rankings are refused at half of it."""
    lease_s: _Seconds = 20.0
    """Time after which a worker's lease of a scene expires if the worker does not extend it."""
    event_heartbeat_s: _Seconds = 15.0
    """Interval at which an event stream without events sends a comment, so that proxies do not close it."""
    upload_idle_s: _Seconds = 30.0
    """Maximum wait for the next bytes of a request's body."""
    upload_grace_s: _Seconds = 30.0
    """Time for which the body of a request may be slower than ``upload_bytes_per_s``, in all."""
    upload_bytes_per_s: float = Field(default=500.0, ge=1e-3, le=GIGABYTE)
    """Minimum speed at which the body of a request must arrive after the grace period."""
    upload_place_s: _Seconds = 300.0
    """When all upload places of a tenant are taken, a new upload ends the slowest one that is older than
    this, or than ``upload_grace_s`` if its key has more uploads than the new one's. When a tenant has
    too many unfinished uploads, a new one replaces the smallest of those that did not grow for this time."""
    partial_upload_s: _Seconds = 3600.0
    """Time for which an unfinished upload can be resumed after its last byte."""
    drain_s: float = Field(default=10.0, ge=0, le=3600)
    """Time for requests in progress to end when the service stops. Containers must be given 10 s more."""
    allowed_hosts: Annotated[tuple[str, ...], NoDecode, BeforeValidator(_names)] = ()
    """Host names, besides those of loopback, under which the service may be reached, as behind a proxy."""
    allowed_origins: Annotated[tuple[_Origin, ...], NoDecode, BeforeValidator(_names)] = ()
    """Web origins, besides the service's own, whose pages may use the service (CORS)."""
    webhook_hosts: Annotated[tuple[_WebhookHost, ...], NoDecode, BeforeValidator(_names)] = ()
    """Hosts that webhooks may go to: names, addresses, and networks such as ``10.1.0.0/16``. A name leads
    only to public addresses, and to those that are listed. Empty: webhooks are off."""
    inspectors: _Processes = 2
    """Processes that decode uploaded images. Each may take twice ``image_decoding_bytes``."""
    limits: Limits = Limits()
    worker: WorkerSettings = WorkerSettings()
    retention: Retention = Retention()
    sweep_s: _Seconds = 20.0
    """Interval of the sweeps, which apply the retention and remove deleted blobs."""
    removal_grace_s: _Seconds = 180.0
    """Time for which the blobs of a deleted snapshot stay for rankings that are being computed."""

    @classmethod
    def settings_customise_sources(
        cls,
        settings_cls: type[BaseSettings],
        init_settings: PydanticBaseSettingsSource,
        env_settings: PydanticBaseSettingsSource,  # noqa: ARG003 - the names are the base class's
        dotenv_settings: PydanticBaseSettingsSource,  # noqa: ARG003
        file_secret_settings: PydanticBaseSettingsSource,  # noqa: ARG003
    ) -> tuple[PydanticBaseSettingsSource, ...]:
        """Values from code, from the environment, from files that the environment names."""
        values, files = ValuesOfEnvironment(settings_cls), FilesOfEnvironment(settings_cls)
        return init_settings, values, files, UnknownOfEnvironment(settings_cls)

    @field_validator("cluster")
    @classmethod
    def _reaches_the_data(cls, cluster: str | None, known: ValidationInfo) -> str | None:
        if cluster is None:
            return None
        if not _CLUSTER.fullmatch(cluster):
            raise ValueError("a cluster is `auto`, or `ray://host:10001`, the port of Ray's client server")
        database, blobs = known.data.get("database_url"), known.data.get("blobs")
        if not (database or "").startswith("postgres") or blobs is None or blobs.url is None:
            raise ValueError("a cluster needs FVS_DATABASE_URL of PostgreSQL and FVS_BLOBS__URL")
        return cluster

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
        return self.database_url is None or self.database_url.startswith("sqlite")

    @property
    def scenes(self) -> Path:
        """The folder of the scenes' working files on a worker."""
        return self.root / "scenes"

    @property
    def blobs_folder(self) -> Path:
        """The folder of the blobs, unless they are in an object store."""
        return self.root / "blobs"

    @property
    def uploads(self) -> Path:
        """The folder of images that have not fully arrived."""
        return self.root / "uploads"

    @property
    def rpc_port(self) -> int | None:
        """The port of gRPC; None when it is not served."""
        if not self.grpc:
            return None
        if self.grpc_port is not None:
            return self.grpc_port
        return self.port + 1 if 0 < self.port < 65_535 else 0

    @property
    def remote_hosts(self) -> tuple[str, ...]:
        """The address and names, other than those of loopback, under which the service may be reached."""
        names = tuple(name for name in self.allowed_hosts if not is_loopback(host_of(name)))
        return names if is_loopback(self.host) else (self.host, *names)

    @property
    def keys_required(self) -> bool | None:
        """Whether every request needs an API key; None: once there is one."""
        if self.require_keys is not None:
            return self.require_keys
        return True if self.remote_hosts else None
