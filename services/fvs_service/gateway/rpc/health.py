"""The health of the gateway over gRPC (``grpc.health.v1``), with the meaning of ``/readyz``."""

from collections.abc import AsyncIterator, Collection

import grpc
from anyio.to_thread import run_sync
from grpc_health.v1.health_pb2 import HealthCheckRequest, HealthCheckResponse
from grpc_health.v1.health_pb2_grpc import HealthServicer

from fvs_service.concurrency import ConcurrencyLimit
from fvs_service.errors import LimitExceededError, ServiceError
from fvs_service.gateway.readiness import require_ready
from fvs_service.gateway.rpc.calls import Context, Gateway

_EVERY_S = 5.0
_WATCHERS = 64
_ALL = ""


class Health(HealthServicer):  # type: ignore[misc]
    """Answers without an API key, as ``/readyz`` does; ``names`` are those of the services."""

    def __init__(self, gateway: Gateway, names: Collection[str]) -> None:
        self._gateway = gateway
        self._names = frozenset({_ALL, *names})
        self._watchers = ConcurrencyLimit("watches of the health", _WATCHERS)

    async def Check(self, request: HealthCheckRequest, context: Context) -> HealthCheckResponse:  # noqa: N802
        """Return whether the gateway can serve."""
        if request.service not in self._names:
            await context.abort(grpc.StatusCode.NOT_FOUND, "There is no such service.")
        return HealthCheckResponse(status=await self._status())

    async def Watch(  # noqa: N802
        self, request: HealthCheckRequest, context: Context
    ) -> AsyncIterator[HealthCheckResponse]:
        """Stream whether the gateway can serve, whenever that changes."""
        if request.service not in self._names:
            yield HealthCheckResponse(status=HealthCheckResponse.SERVICE_UNKNOWN)
            return
        try:
            with self._watchers.slot(_ALL):
                last = None
                stops = False
                while not stops:
                    stops = self._gateway.drain.begun
                    status = await self._status()
                    if status != last:
                        yield HealthCheckResponse(status=status)
                    last = status
                    await self._gateway.drain.wait(0 if stops else _EVERY_S)
        except LimitExceededError as error:
            await context.abort(grpc.StatusCode.RESOURCE_EXHAUSTED, error.message)

    async def _status(self) -> int:
        if self._gateway.drain.begun:
            return int(HealthCheckResponse.NOT_SERVING)
        try:
            await run_sync(require_ready, self._gateway.application)
        except ServiceError:
            return int(HealthCheckResponse.NOT_SERVING)
        return int(HealthCheckResponse.SERVING)
