"""Capabilities of the service: its features and limits."""

import importlib.metadata

from fvs_engine.images.unreadable import FORMATS
from fvs_schema.service import Basemap, Capabilities
from fvs_service.application import Application
from fvs_service.jobs.fleet import workers_of
from fvs_service.settings import BasemapSettings

ARCHIVE_URL = "/console/basemap.pmtiles"
"""Where the service has the archive of tiles."""


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
        basemap=_basemap(settings.basemap),
        limits=settings.limits,
    )


def _basemap(given: BasemapSettings) -> Basemap | None:
    if given.tiles is not None:
        return Basemap(kind="raster-tiles", url=given.tiles, attribution=given.attribution)
    if given.archive is not None:
        return Basemap(kind="pmtiles", url=ARCHIVE_URL, attribution=given.attribution)
    return None
