"""Capabilities and health of the service."""

from fvs_client.models.base import Answer


class Limits(Answer):
    """Limits of a request, a scene or a tenant; None where the service does not publish one."""

    image_bytes: int | None = None
    image_pixels: int | None = None
    images_per_scene: int | None = None
    digests_per_check: int | None = None
    candidates_per_ranking: int | None = None
    open_uploads_per_tenant: int | None = None
    page_items: int | None = None


class WorkerStatus(Answer):
    """A worker of the service: whether it is alive, and the scenes it has loaded."""

    id: str
    alive: bool
    heartbeat_age_s: float
    backend: str
    slots: int
    """How many jobs it runs at once."""
    disk_full: bool
    """It takes no jobs until there is room."""
    runners: int
    """Scenes whose model is loaded."""
    runner_bytes: int
    work: str = "all"
    """What it does: `sfm`, `training`, or `all`."""


class Capabilities(Answer):
    """Capabilities and limits of the service."""

    version: str
    api: tuple[str, ...]
    methods: tuple[str, ...]
    """Methods of ranking."""
    generators: tuple[str, ...]
    mission_formats: tuple[str, ...] = ()
    """What missions are written for."""
    image_formats: tuple[str, ...]
    job_kinds: tuple[str, ...] = ()
    workers: tuple[WorkerStatus, ...] = ()
    """Workers that are alive, and those that stopped sending heartbeats."""
    keys_required: bool
    limits: Limits


class Health(Answer):
    """Health of the service."""

    status: str
