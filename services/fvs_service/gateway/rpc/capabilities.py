"""The features and limits of the service over gRPC."""

from fvs.v1 import capabilities_pb2 as pb

from fvs_schema.service import Capabilities
from fvs_service.application import Application
from fvs_service.gateway.capabilities import capabilities_of
from fvs_service.principal import Principal


class CapabilityServicer:
    """``fvs.v1.CapabilityService``."""

    service = pb.DESCRIPTOR.services_by_name["CapabilityService"]

    def __init__(self, app: Application) -> None:
        self._app = app

    def get_capabilities(self, _caller: Principal, _request: pb.GetCapabilitiesRequest) -> Capabilities:
        """Return the features and limits of the service."""
        return capabilities_of(self._app)
