"""The service itself over REST: capabilities, health, metrics."""

import importlib.metadata
import shutil
from typing import Annotated

from fastapi import Response
from prometheus_client import CONTENT_TYPE_LATEST, generate_latest
from pydantic import Field
from sqlalchemy import text
from sqlalchemy.exc import SQLAlchemyError

from fvs_engine.images.pixels import FORMATS
from fvs_service.errors import OutOfSpaceError, UnavailableError
from fvs_service.gateway.rest.dependencies import App, Caller, Counters
from fvs_service.gateway.rest.routing import json_router
from fvs_service.model import Model
from fvs_service.settings import Limits

router = json_router("", "service")

_TEXT = {200: {"description": "Prometheus' text format.", "content": {"text/plain": {}}}}


class Capabilities(Model):
    """The features and limits of this service."""

    version: str
    api: tuple[str, ...] = ("v1",)
    methods: tuple[str, ...]
    """The methods of rankings."""
    generators: tuple[str, ...] = ("orbit", "grid", "dataset", "around-current")
    image_formats: tuple[str, ...]
    keys_required: bool
    limits: Annotated[Limits, Field(description="Limits per request, scene and tenant.")]


class Health(Model):
    """The service is healthy."""

    status: str = "ok"


@router.get("/v1/capabilities")
def capabilities(app: App, _caller: Caller) -> Capabilities:
    """Return the features and limits of the service."""
    settings = app.storage.settings
    return Capabilities(
        version=importlib.metadata.version("fvs"),
        methods=app.rankings.methods,
        image_formats=FORMATS,
        keys_required=settings.keys_required,
        limits=settings.limits,
    )


@router.get("/livez")
def live() -> Health:
    """Check that the gateway runs."""
    return Health()


@router.get("/readyz")
def ready(app: App) -> Health:
    """Check that the gateway can store images; 503 or 507 when it cannot."""
    try:
        with app.storage.database.connect() as connection:
            connection.execute(text("SELECT 1"))
    except SQLAlchemyError as error:
        raise UnavailableError("The database cannot be reached.", retry_after_s=5) from error
    settings = app.storage.settings
    if shutil.disk_usage(settings.root).free < settings.reserve_bytes:
        raise OutOfSpaceError("The disk is full.", hint="Free some space.", retry_after_s=60)
    return Health()


@router.get("/metrics", response_class=Response, responses=_TEXT)  # type: ignore[arg-type]
def metrics(counters: Counters, _caller: Caller) -> Response:
    """Return the metrics for Prometheus."""
    return Response(generate_latest(counters.registry), media_type=CONTENT_TYPE_LATEST)
