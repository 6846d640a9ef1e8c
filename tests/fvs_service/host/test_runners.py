"""How long a ranking waits for its scene's runner."""

import asyncio
import socket
from types import SimpleNamespace
from typing import Any

import pytest
from fvs_service.errors import UnavailableError
from fvs_service.host.worker import runners
from fvs_service.host.worker.runners import LeasedRunners
from fvs_service.rankings.port import RankedViews, RankViews

_RANKED = RankedViews(snapshot_id="snp_a", iterations=1, gaussians=1)


def _question(scene: str, timeout_s: float, endpoint: str | None = None) -> RankViews:
    return RankViews(
        scene_id=scene,
        endpoint=endpoint,
        snapshot_id="snp_a",
        timeout_s=timeout_s,
        method="median-frequency",
        views=(),
    )


def test_a_client_whose_time_is_nearly_up_is_told_that_there_is_no_runner(gateway: Any) -> None:
    leased = LeasedRunners(gateway.application.storage)
    with pytest.raises(UnavailableError, match="No worker has loaded"):
        asyncio.run(leased.rank(_question(gateway.scene(), timeout_s=2.0)))


def test_the_time_with_a_runner_that_then_dies_is_no_time_without_one(
    gateway: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = [0.0]
    monkeypatch.setattr(runners, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    scene = gateway.scene()
    storage = gateway.application.storage
    asked = 0

    async def runner(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        nonlocal asked
        asked += 1
        await reader.readline()
        await reader.readline()
        if asked == 1:
            clock[0] += runners._START_S + 1  # and then it dies
        else:
            writer.write(b'{"result":' + _RANKED.model_dump_json().encode() + b"}\n")
            await writer.drain()
        writer.close()

    async def rank() -> RankedViews:
        async with await asyncio.start_server(runner, "127.0.0.1", 0) as server:
            host, port = server.sockets[0].getsockname()
            storage.leases.extend(gateway.lease(scene), f"{host}:{port}/secret")
            leased = LeasedRunners(storage)
            try:
                return await leased.rank(_question(scene, timeout_s=600.0))
            finally:
                await leased.close()

    assert asyncio.run(rank()) == _RANKED
    assert asked == 2


def test_a_runner_that_has_moved_since_the_question_is_found_by_its_lease(gateway: Any) -> None:
    scene = gateway.scene()
    storage = gateway.application.storage
    received: list[bytes] = []

    async def runner(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        received.extend([await reader.readline(), await reader.readline()])
        writer.write(b'{"result":' + _RANKED.model_dump_json().encode() + b"}\n")
        await writer.drain()
        writer.close()

    async def rank() -> RankedViews:
        async with await asyncio.start_server(runner, "127.0.0.1", 0) as server:
            host, port = server.sockets[0].getsockname()
            with socket.create_server(("127.0.0.1", 0)) as gone:
                old = f"127.0.0.1:{gone.getsockname()[1]}/old"
            storage.leases.extend(gateway.lease(scene), f"{host}:{port}/secret")
            leased = LeasedRunners(storage)
            try:
                return await leased.rank(_question(scene, timeout_s=60.0, endpoint=old))
            finally:
                await leased.close()

    assert asyncio.run(rank()) == _RANKED
    assert b"endpoint" not in received[1]
