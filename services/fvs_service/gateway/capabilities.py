"""Capabilities of the service: its features and limits."""

import importlib.metadata
from typing import Annotated

from pydantic import Field

from fvs_engine.images.pixels import FORMATS
from fvs_service.application import Application
from fvs_service.fleet import WorkerStatus, workers_of
from fvs_service.jobs.model import JobKind
from fvs_service.missions.model import MissionFormat
from fvs_service.model import Model
from fvs_service.settings import Limits


class Capabilities(Model):
    """The features and limits of this service."""

    version: str
    api: tuple[str, ...] = ("v1",)
    methods: tuple[str, ...]
    """The methods of rankings."""
    generators: tuple[str, ...] = ("orbit", "grid", "dataset", "around-current", "in-volume")
    mission_formats: tuple[str, ...] = tuple(one.value for one in MissionFormat)
    """The formats of missions."""
    image_formats: tuple[str, ...]
    job_kinds: tuple[str, ...] = tuple(kind.value for kind in JobKind)
    workers: tuple[WorkerStatus, ...]
    """Workers that are alive, and those that stopped sending heartbeats."""
    keys_required: bool
    limits: Annotated[Limits, Field(description="Limits per request, scene and tenant.")]


def capabilities_of(app: Application) -> Capabilities:
    """The features and limits of the service."""
    settings = app.storage.settings
    with app.storage.database.reading() as session:
        workers = workers_of(session)
    return Capabilities(
        version=importlib.metadata.version("fvs"),
        methods=app.rankings.methods,
        image_formats=FORMATS,
        workers=workers,
        keys_required=app.storage.keys.required,
        limits=settings.limits,
    )
