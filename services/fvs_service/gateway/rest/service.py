"""The service itself over REST: capabilities, health, metrics."""

import importlib.metadata
import shutil
from collections.abc import Sequence
from typing import Annotated

from fastapi import Query, Response
from prometheus_client import CONTENT_TYPE_LATEST, generate_latest
from pydantic import Field

from fvs_engine.images.pixels import FORMATS
from fvs_service.errors import OutOfSpaceError, UnavailableError
from fvs_service.fleet import WorkerStatus, workers_of
from fvs_service.gateway.rest.dependencies import App, Caller, Counters
from fvs_service.gateway.rest.routing import json_router
from fvs_service.jobs.model import JobKind
from fvs_service.model import Model
from fvs_service.settings import Limits

router = json_router("", "service")

_Workers = Annotated[
    int,
    Query(ge=0, le=10_000, description="How many workers must be alive; 0: the gateway alone is checked."),
]
_TEXT = {200: {"description": "Prometheus' text format.", "content": {"text/plain": {}}}}


class Capabilities(Model):
    """The features and limits of this service."""

    version: str
    api: tuple[str, ...] = ("v1",)
    methods: tuple[str, ...]
    """The methods of rankings."""
    generators: tuple[str, ...] = ("orbit", "grid", "dataset", "around-current")
    image_formats: tuple[str, ...]
    job_kinds: tuple[str, ...] = tuple(kind.value for kind in JobKind)
    workers: tuple[WorkerStatus, ...]
    """Those that live, and those that have fallen silent."""
    keys_required: bool
    limits: Annotated[Limits, Field(description="Limits per request, scene and tenant.")]


class Health(Model):
    """The service is healthy."""

    status: str = "ok"


@router.get("/v1/capabilities")
def capabilities(app: App, _caller: Caller) -> Capabilities:
    """Return the features and limits of the service."""
    settings = app.storage.settings
    with app.storage.database.reading() as session:
        workers = workers_of(session, settings.lease_s)
    return Capabilities(
        version=importlib.metadata.version("fvs"),
        methods=app.rankings.methods,
        image_formats=FORMATS,
        workers=workers,
        keys_required=settings.keys_required,
        limits=settings.limits,
    )


@router.get("/livez")
def live() -> Health:
    """Check that the gateway runs."""
    return Health()


@router.get("/readyz")
def ready(app: App, workers: _Workers = 0) -> Health:
    """Check that the gateway can store images, and that so many workers are alive; 503 or 507 otherwise."""
    with app.storage.database.reading() as session:
        known = workers_of(session, app.storage.settings.lease_s)
    settings = app.storage.settings
    if shutil.disk_usage(settings.root).free < settings.reserve_bytes:
        raise OutOfSpaceError("The disk is full.", hint="Free some space.", retry_after_s=60)
    _require_workers(known, workers)
    return Health()


def _require_workers(known: Sequence[WorkerStatus], least: int) -> None:
    alive = sum(worker.alive for worker in known)
    if alive >= least:
        return
    silent = ", ".join(
        f"{worker.id} for {worker.heartbeat_age_s:.0f} s" for worker in known if not worker.alive
    )
    raise UnavailableError(
        f"{alive} workers are alive, not {least}." + (f" Silent are {silent}." if silent else ""),
        hint="fvs serve starts workers, and its log says why they end.",
        retry_after_s=5,
    )


@router.get("/metrics", response_class=Response, responses=_TEXT)  # type: ignore[arg-type]
def metrics(counters: Counters, _caller: Caller) -> Response:
    """Return the metrics for Prometheus."""
    return Response(generate_latest(counters.registry), media_type=CONTENT_TYPE_LATEST)
