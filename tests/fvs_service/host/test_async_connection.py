"""Kept connections to runners."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from fvs_service.host.protocol.async_connection import AsyncConnections

_GENERATIONS = 20


@asynccontextmanager
async def runner() -> AsyncIterator[tuple[str, list[asyncio.StreamWriter]]]:
    """A runner that answers every request with the request; yields its endpoint and its connections."""
    connections: list[asyncio.StreamWriter] = []

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        connections.append(writer)
        await reader.readline()  # the secret
        while line := await reader.readline():
            writer.write(line)
        writer.close()

    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    port = server.sockets[0].getsockname()[1]
    yield f"127.0.0.1:{port}/secret", connections
    server.close()
    for writer in connections:
        writer.close()
        await writer.wait_closed()
    await server.wait_closed()


def open_descriptors() -> int:
    """The number of this process's open files."""
    return len(list(Path("/dev/fd").iterdir()))


def test_a_connection_is_used_again() -> None:
    async def scenario() -> int:
        connections = AsyncConnections()
        async with runner() as (endpoint, accepted):
            for number in range(3):
                assert await connections.call(endpoint, b"%d" % number) == b"%d\n" % number
            connections.close()
            return len(accepted)

    assert asyncio.run(scenario()) == 1


def test_connections_to_runners_that_ended_are_closed() -> None:
    async def scenario() -> int:
        connections = AsyncConnections()
        before = open_descriptors()
        for _ in range(_GENERATIONS):
            async with runner() as (endpoint, _accepted):
                await connections.call(endpoint, b"hello")
        async with runner() as (endpoint, _accepted):
            await connections.call(endpoint, b"hello")
            kept = open_descriptors() - before
            connections.close()
        return kept

    assert asyncio.run(scenario()) < _GENERATIONS / 2
