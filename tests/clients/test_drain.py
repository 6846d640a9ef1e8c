"""Draining a gateway: requests in progress finish, over REST and gRPC; new ones are refused."""

import asyncio
import contextlib
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import grpc
import httpx2
import pytest
import uvicorn
from computing_runners import ComputingRunners
from fvs.v1.views_pb2 import RankViewsRequest
from fvs.v1.views_pb2_grpc import ViewServiceStub
from fvs_client import Client, FvsError, Orbit
from fvs_client.retries import NO_RETRIES
from fvs_service.serving.gateway import GatewayServer
from fvs_service.serving.rest_app import create_app
from gateways import Gateway, settings_for
from grpc_health.v1.health_pb2 import HealthCheckRequest, HealthCheckResponse
from grpc_health.v1.health_pb2_grpc import HealthStub

_ORBIT = Orbit(count=8)


@dataclass
class Stopping:
    """A gateway whose rankings finish only after ``go`` is set."""

    gateway: Any
    rpc_port: int
    stop: Callable[[], None]
    go: threading.Event
    begun: threading.Semaphore
    ended: Callable[[float], bool]

    def is_ready(self) -> bool:
        """Over both transports."""
        over_rest = self.gateway.client.get("/readyz").status_code
        with grpc.insecure_channel(f"127.0.0.1:{self.rpc_port}") as channel:
            over_grpc = HealthStub(channel).Check(HealthCheckRequest(), timeout=10).status
        assert (over_rest, over_grpc) in (
            (200, HealthCheckResponse.SERVING),
            (503, HealthCheckResponse.NOT_SERVING),
        )
        return bool(over_rest == 200)


@pytest.fixture
def serving(tmp_path: Path) -> Iterator[Callable[[float], Stopping]]:
    with contextlib.ExitStack() as stack:
        yield lambda drain_s: stack.enter_context(_serving(tmp_path, drain_s))


@contextlib.contextmanager
def _serving(tmp_path: Path, drain_s: float) -> Iterator[Stopping]:
    settings = settings_for(tmp_path / "service", {"grpc_port": 0, "drain_s": drain_s})
    app = create_app(settings, ComputingRunners)
    ports: list[int | None] = []
    config = uvicorn.Config(app, port=0, log_level="error", timeout_graceful_shutdown=1)
    server = GatewayServer(config, app, settings, ports.append)
    thread = threading.Thread(target=server.run)
    thread.start()
    while not ports:
        assert thread.is_alive()
        time.sleep(0.01)
    assert ports[0] is not None
    go, begun = threading.Event(), threading.Semaphore(0)
    runners = app.state.application.runners
    rank = runners.rank

    async def slow(request: Any) -> Any:
        begun.release()
        while not go.is_set():
            await asyncio.sleep(0.01)
        return await rank(request)

    runners.rank = slow

    def ended(within_s: float) -> bool:
        thread.join(within_s)
        return not thread.is_alive()

    port = server.servers[0].sockets[0].getsockname()[1]
    with httpx2.Client(base_url=f"http://127.0.0.1:{port}", timeout=30) as plain:
        gateway = Gateway(app, plain, settings)
        stop = lambda: server.handle_exit(signal.SIGTERM, None)  # noqa: E731
        yield Stopping(gateway, ports[0], stop, go, begun, ended)
        go.set()
        if thread.is_alive():
            stop()
            thread.join()


def _client(serving: Stopping) -> Client:
    return Client(str(serving.gateway.client.base_url).rstrip("/"), retries=NO_RETRIES)


def test_rankings_in_progress_end_and_new_requests_are_refused(
    serving: Callable[[float], Stopping],
) -> None:
    service = serving(30)
    scenes = [service.gateway.scene() for _ in range(2)]
    for scene in scenes:
        service.gateway.model(scene)
    asked = RankViewsRequest(scene_id=scenes[1], ranking={"generator": {"orbit": {"count": 8}}})
    with (
        ThreadPoolExecutor() as pool,
        _client(service) as client,
        grpc.insecure_channel(f"127.0.0.1:{service.rpc_port}") as channel,
    ):
        over_grpc = ViewServiceStub(channel).RankViews
        ranked = [
            pool.submit(client.scenes.get(scenes[0]).rank, generator=_ORBIT),
            pool.submit(over_grpc, asked),
        ]
        events = pool.submit(service.gateway.client.get, f"/v1/scenes/{scenes[0]}/events")
        for _ in ranked:
            assert service.begun.acquire(timeout=20)
        assert service.is_ready()
        service.stop()
        until = time.monotonic() + 10
        while service.is_ready():
            assert time.monotonic() < until
        with pytest.raises(FvsError, match="stopping"):
            client.scenes.get(scenes[0])
        with pytest.raises(grpc.RpcError, match="stopping"):
            over_grpc(asked)
        assert events.result(10).status_code == 200
        assert not any(future.done() for future in ranked)
        service.go.set()
        assert [len(future.result(20).candidates) for future in ranked] == [8, 8]
        assert service.ended(10)


def test_requests_that_take_longer_are_cut(serving: Callable[[float], Stopping]) -> None:
    service = serving(0.2)
    scene = service.gateway.scene()
    service.gateway.model(scene)
    with ThreadPoolExecutor() as pool, _client(service) as client:
        ranking = pool.submit(client.scenes.get(scene).rank, generator=_ORBIT)
        assert service.begun.acquire(timeout=20)
        service.stop()
        assert service.ended(5)
        with pytest.raises(FvsError):
            ranking.result(10)


def test_a_gateway_without_requests_ends_at_once(serving: Callable[[float], Stopping]) -> None:
    service = serving(30)
    assert service.is_ready()
    service.stop()
    assert service.ended(5)
