"""Capabilities of the service: its features and limits."""

import importlib.metadata
from typing import Annotated, get_args

from pydantic import Field

from fvs_engine.choices import Method
from fvs_engine.images.pixels import FORMATS
from fvs_service.application import Application
from fvs_service.jobs.fleet import WorkerStatus, workers_of
from fvs_service.jobs.model import JobKind
from fvs_service.missions.model import MissionFormat
from fvs_service.model import Model
from fvs_service.settings import Limits


class Capabilities(Model):
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
    limits: Annotated[Limits, Field(description="Limits per request, scene and tenant.")]


def capabilities_of(app: Application) -> Capabilities:
    """The features and limits of the service."""
    settings = app.storage.settings
    with app.storage.database.reading() as session:
        workers = workers_of(session)
    return Capabilities(
        version=importlib.metadata.version("fvs"),
        image_formats=FORMATS,
        workers=workers,
        keys_required=app.storage.keys.required,
        limits=settings.limits,
    )
