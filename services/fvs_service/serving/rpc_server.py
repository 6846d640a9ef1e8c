"""The gRPC server: port, limits, and a stop that lets calls end."""

import asyncio
import contextlib

import grpc
from grpc_health.v1.health_pb2 import DESCRIPTOR as HEALTH
from grpc_health.v1.health_pb2_grpc import add_HealthServicer_to_server

from fvs_service.errors import UnavailableError
from fvs_service.gateway.rpc.calls import MAX_CALLS, Gateway
from fvs_service.gateway.rpc.capabilities import CapabilityServicer
from fvs_service.gateway.rpc.health import Health
from fvs_service.gateway.rpc.operations import Servicer, handlers_of
from fvs_service.gateway.rpc.reflection import serve_reflection
from fvs_service.images.rpc import ImageServicer
from fvs_service.jobs.rpc import JobServicer
from fvs_service.rankings.rpc import ViewServicer
from fvs_service.scenes.rpc import SceneServicer
from fvs_service.settings import Settings
from fvs_service.snapshots.rpc import SnapshotServicer
from fvs_service.webhooks.rpc import WebhookServicer

_CALLS_OF_TRANSPORT = MAX_CALLS + 256
"""Maximum number of concurrent calls, with those of health and reflection, and those that get an error with
details because there are too many. gRPC itself refuses more, with a status that has none."""
_CALLS_PER_CONNECTION = 256
_PING_MS, _PING_WITHIN_MS = 30_000, 20_000
_METADATA_BYTES = 16_384
_CHUNK_BYTES = 1_048_576
"""Maximum size of a chunk of an upload, which no limit of lists lowers."""
_ENVELOPE_BYTES = 65_536
"""What the transport accepts beyond: requests that are a little too large get an error with details. gRPC
itself refuses larger ones, with a status that has none."""
_CUT_S = 0.2
"""Calls are aborted this long before the server stops, so that their clients receive the reason."""


class RpcServer:
    """The services of ``fvs.v1``, health and reflection on a port of their own."""

    def __init__(self, gateway: Gateway, settings: Settings) -> None:
        self._gateway, self._settings = gateway, settings
        self._server = grpc.aio.server(
            options=_options(max(settings.limits.json_bytes, _CHUNK_BYTES) + _ENVELOPE_BYTES),
            maximum_concurrent_rpcs=_CALLS_OF_TRANSPORT,
        )
        servicers: tuple[Servicer, ...] = (
            SceneServicer(gateway.application),
            ImageServicer(gateway.application),
            JobServicer(gateway.application),
            SnapshotServicer(gateway.application),
            ViewServicer(gateway.application),
            WebhookServicer(gateway.application),
            CapabilityServicer(gateway.application),
        )
        self._server.add_generic_rpc_handlers(tuple(handlers_of(gateway, servicer) for servicer in servicers))
        names = [servicer.service.full_name for servicer in servicers]
        add_HealthServicer_to_server(Health(gateway, names), self._server)
        health = HEALTH.services_by_name["Health"].full_name
        serve_reflection((*names, health), self._server)

    async def start(self) -> int:
        """Listen; returns the port. Raises ``UnavailableError`` when another program uses it."""
        host, port = self._settings.host, self._settings.rpc_port
        address = f"{f'[{host}]' if ':' in host else host}:{port}"
        try:
            bound: int = self._server.add_insecure_port(address)
        except RuntimeError as error:
            raise UnavailableError(
                f"gRPC cannot listen on {address}.",
                hint="Choose another port with --grpc-port, or serve REST alone with --no-grpc.",
            ) from error
        await self._server.start()
        return bound

    async def stop(self, within_s: float) -> None:
        """Accept no more calls, wait for those in progress, and abort those that take longer."""
        self._gateway.drain.begin()
        stop = asyncio.ensure_future(self._server.stop(within_s))
        await asyncio.wait((stop,), timeout=max(0.0, within_s - _CUT_S))
        for task in tuple(self._gateway.running):
            task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await stop


def _options(most_bytes: int) -> tuple[tuple[str, int], ...]:
    return (
        ("grpc.so_reuseport", 0),  # a port that is in use is an error
        ("grpc.max_receive_message_length", most_bytes),
        ("grpc.max_metadata_size", _METADATA_BYTES),
        ("grpc.absolute_max_metadata_size", 2 * _METADATA_BYTES),
        ("grpc.max_concurrent_streams", _CALLS_PER_CONNECTION),
        # A client that has vanished is noticed, and its calls are cancelled.
        ("grpc.keepalive_time_ms", _PING_MS),
        ("grpc.keepalive_timeout_ms", _PING_WITHIN_MS),
        ("grpc.http2.max_pings_without_data", 0),
        ("grpc.http2.min_ping_interval_without_data_ms", 10_000),
        ("grpc.keepalive_permit_without_calls", 1),
    )
