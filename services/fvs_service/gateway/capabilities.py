"""Capabilities of the service: its features and limits."""

import importlib.metadata

from fvs_engine.images.unreadable import FORMATS
from fvs_schema.service import Capabilities
from fvs_service.application import Application
from fvs_service.jobs.fleet import workers_of


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
