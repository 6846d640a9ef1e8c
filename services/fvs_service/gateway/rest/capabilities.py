"""The capabilities over REST."""

from fvs_schema.service import Capabilities
from fvs_service.gateway.capabilities import capabilities_of
from fvs_service.gateway.rest.dependencies import App, Caller
from fvs_service.gateway.rest.routing import json_router

router = json_router("/v1", "service")


@router.get("/capabilities")
def get_capabilities(app: App, _caller: Caller) -> Capabilities:
    """Return the features and limits of the service."""
    return capabilities_of(app)
