"""One gateway, which a tenant of each transport calls."""

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import grpc
import pytest
from conftest_of import conftest_of
from contract_tenant import Tenant
from contract_transports import Direct, Rest, Rpc
from fvs_service.gateway.drain import Drain
from fvs_service.gateway.rpc.calls import Gateway as RpcGateway
from fvs_service.serving.rpc_server import RpcServer
from fvs_service.settings import Settings
from gateways import running_gateway, settings_for

_service = conftest_of("fvs_service")
photograph = _service.photograph
_plain_logs = _service._plain_logs


@pytest.fixture(scope="session")
def gateway(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """A gateway that requires keys, with small limits, shared by all tests."""
    limits = {
        "candidates_per_ranking": 40,
        "images_per_scene": 6,
        "open_jobs_per_tenant": 2,
        "refusals_per_key": 30,
    }
    settings = settings_for(
        tmp_path_factory.mktemp("contract") / "service",
        {
            "require_keys": True,
            "grpc_port": 0,
            "limits": limits,
            "webhook_hosts": ("hooks.example",),
        },
    )
    with running_gateway(settings) as gateway:
        yield gateway


def _start(gateway: Any, settings: Settings) -> tuple[RpcServer, int]:
    state = gateway.app.state

    async def start() -> tuple[RpcServer, int]:
        # Each server ends by itself.
        parts = replace(RpcGateway.of(state, settings.upload_idle_s), drain=Drain())
        server = RpcServer(parts, settings)
        return server, await server.start()

    started: tuple[RpcServer, int] = gateway.client.portal.call(start)
    return started


@pytest.fixture(scope="session")
def rpc_port(gateway: Any) -> Iterator[int]:
    """The port of gRPC of the gateway."""
    server, port = _start(gateway, gateway.settings)
    yield port
    gateway.client.portal.call(server.stop, 1.0)


@pytest.fixture
def open_rpc(gateway: Any) -> Iterator[Callable[..., tuple[RpcServer, int]]]:
    """Serve gRPC on another port, with other settings."""
    servers = []

    def start(**changed: Any) -> tuple[RpcServer, int]:
        server, port = _start(gateway, gateway.settings.model_copy(update=changed))
        servers.append(server)
        return server, port

    yield start
    for server in servers:
        gateway.client.portal.call(server.stop, 1.0)


@pytest.fixture
def open_both(tmp_path: Path) -> Iterator[Callable[..., tuple[Any, grpc.Channel]]]:
    """Open a gateway of one's own, with some settings; returns it and a channel to its gRPC."""
    with contextlib.ExitStack() as stack:

        def start(**changed: Any) -> tuple[Any, grpc.Channel]:
            settings = settings_for(tmp_path / "service", {"grpc_port": 0, **changed})
            gateway = stack.enter_context(running_gateway(settings))
            server, port = _start(gateway, settings.model_copy(update={"host": "127.0.0.1"}))
            stack.callback(gateway.client.portal.call, server.stop, 1.0)
            return gateway, stack.enter_context(grpc.insecure_channel(f"127.0.0.1:{port}"))

        yield start


@pytest.fixture(scope="session")
def rpc(rpc_port: int) -> Iterator[Rpc]:
    """Calls over gRPC."""
    with grpc.insecure_channel(f"127.0.0.1:{rpc_port}") as channel:
        yield Rpc(channel)


@pytest.fixture
def compare(gateway: Any, rpc: Rpc, request: pytest.FixtureRequest) -> Callable[..., None]:
    """Play a scenario over each transport, each with a tenant of its own, and compare what they saw."""

    def play(scenario: Callable[[Tenant], None]) -> None:
        tenants = [
            Tenant(gateway, transport, f"{request.node.name}-{transport.name}")
            for transport in (Direct(gateway), Rest(gateway), rpc)
        ]
        for tenant in tenants:
            scenario(tenant)
            tenant.leave()  # its jobs would stand in the line before those of the next one
        direct, *others = tenants
        for other in others:
            assert [name for name, _ in other.seen] == [name for name, _ in direct.seen]
            for (name, theirs), (_, ours) in zip(other.seen, direct.seen, strict=True):
                assert theirs == ours, f"{name} over {other.transport.name}"

    return play


@pytest.fixture
def tenant(gateway: Any, rpc: Rpc, request: pytest.FixtureRequest) -> Tenant:
    """A tenant who calls over gRPC."""
    return Tenant(gateway, rpc, request.node.name)
