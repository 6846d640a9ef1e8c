"""The service itself: its features, limits, workers and health."""

from typing import Annotated, Literal, get_args

from pydantic import Field

from fvs_schema.base import Input, Output
from fvs_schema.jobs import JobKind
from fvs_schema.missions import MissionFormat
from fvs_schema.quantities import MAX_PIXELS, Count, Number
from fvs_schema.words import Method

_MEGABYTE = 1_000_000
_GIGABYTE = 1_000 * _MEGABYTE
# Numbers beyond these have no sense, and some of them overflow clocks and timers.
_Bytes = Annotated[int, Field(ge=1, le=1_000_000 * _GIGABYTE)]
_Number = Annotated[int, Field(ge=1, le=1_000_000_000)]
_Few = Annotated[int, Field(ge=1, le=10_000)]


class Limits(Input):
    """Limits per request, scene and tenant; published by ``GET /v1/capabilities``."""

    image_bytes: int = Field(default=64 * _MEGABYTE, ge=1, le=100 * _GIGABYTE)
    """Maximum size of an image file."""
    image_pixels: int = Field(default=128_000_000, ge=1, le=MAX_PIXELS)
    """Maximum number of pixels per image."""
    image_decoding_bytes: _Bytes = 1024 * _MEGABYTE
    """Maximum memory for decoding an image, estimated from its header."""
    video_bytes: _Bytes = 20 * _GIGABYTE
    """Maximum size of a video file."""
    video_s: float = Field(default=3600.0, ge=1, le=86_400)
    """Maximum length of a video."""
    multipart_bytes: _Bytes = 1024 * _MEGABYTE
    """Maximum size of a form."""
    json_bytes: int = Field(default=1_500_000, ge=1_000, le=64 * _MEGABYTE)
    """Maximum size of a JSON body or gRPC message with a list. Those without a list may have 64 KiB."""
    images_per_scene: int = Field(default=10_000, ge=1, le=1_000_000)
    """Maximum number of images per scene."""
    scenes_per_tenant: _Number = 1_000
    """Maximum number of scenes per tenant."""
    open_jobs_per_tenant: _Number = 32
    """Maximum number of queued and running jobs per tenant."""
    running_jobs_per_tenant: _Number = 8
    """Maximum number of jobs per tenant that run at once, on all workers together. The others wait."""
    open_uploads_per_tenant: _Few = 32
    """Maximum number of concurrent uploads per tenant and gateway (see ``upload_place_s``)."""
    partial_uploads_per_tenant: _Few = 256
    """Maximum number of unfinished uploads that are kept per tenant and gateway. Beyond it, a new one
    replaces the smallest of those that do not grow (see ``upload_place_s``)."""
    rankings_at_once_per_tenant: _Few = 64
    """Maximum number of concurrent ranking requests per tenant and gateway."""
    rankings_queued_per_scene: _Few = 64
    """Maximum number of different rankings and renders that wait for one scene."""
    rankings_queued_per_key: _Few = 32
    """Maximum number of different rankings and renders of one API key that wait for one scene."""
    ranking_timeout_s: float = Field(default=180.0, ge=1e-3, le=86_400)
    """Maximum time that a client waits for a ranking, and its default (``X-Timeout-S``)."""
    refusals_per_key: _Number = 120
    """Number of requests of one API key that may be refused as wrong (400, 413, 415, 422) within a minute,
    per gateway. After that the key is on hold: its requests with a body are answered 429, until a minute
    after the first of them."""
    event_streams_per_tenant: _Few = 64
    """Maximum number of concurrent event streams, and of requests that wait for a job, per tenant and
    gateway."""
    candidates_per_ranking: int = Field(default=2_000, ge=1, le=100_000)
    """Maximum number of candidates per ranking."""


class WorkerStatus(Output):
    """A worker: whether it is alive, and what it has loaded."""

    id: str
    """The worker's id."""
    alive: bool
    """Whether it sends heartbeats."""
    heartbeat_age_s: Number
    """The time since its last heartbeat."""
    backend: str
    """The rasteriser that it uses; until its first runner has started the one that it is set to."""
    slots: Count
    """How many jobs it runs at once; 0 while it cannot reach its Ray cluster."""
    disk_full: bool
    """It takes no jobs until there is room."""
    work: str = "all"
    """Deprecated: always `all`."""
    runners: Count
    """Scenes whose model is loaded."""
    runner_bytes: Count
    """Resident memory of its runners."""

    @property
    def takes_jobs(self) -> bool:
        """Whether a job can begin on it."""
        return self.alive and self.slots > 0 and not self.disk_full


class Basemap(Output):
    """What maps show below a scene."""

    kind: Literal["raster-tiles", "pmtiles"]
    """Whether `url` is a template for tiles or one archive of them."""
    url: str
    """With `{z}`, `{x}` and `{y}` for tiles, or where the archive is."""
    attribution: str
    """Whom the map names as its source."""


class Capabilities(Output):
    """The features and limits of this service."""

    version: str
    """The version of the service."""
    api: tuple[str, ...] = ("v1",)
    """The versions of the interface."""
    methods: tuple[Method, ...] = get_args(Method)
    """The methods of rankings."""
    generators: tuple[str, ...] = ("orbit", "grid", "dataset", "around-current", "in-volume")
    """The generators of candidates."""
    mission_formats: tuple[str, ...] = tuple(one.value for one in MissionFormat)
    """The formats of missions."""
    image_formats: tuple[str, ...]
    """The formats of photographs that are accepted."""
    job_kinds: tuple[str, ...] = tuple(kind.value for kind in JobKind)
    """The kinds of jobs."""
    workers: tuple[WorkerStatus, ...]
    """Workers that are alive, and those that stopped sending heartbeats."""
    keys_required: bool
    """Whether requests need an API key."""
    basemap: Basemap | None = None
    """What the console's map shows below the scene; null: nothing."""
    limits: Annotated[Limits, Field(description="Limits per request, scene and tenant.")]


class Health(Output):
    """That the service is alive, or ready."""

    status: Literal["ok"]
    """Always `ok`; otherwise the response is a problem document."""
