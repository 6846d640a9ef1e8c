"""Code that differs from the synchronous client: channels of gRPC and waiting for messages, for tasks.

``_sync/channels.py`` has the same for threads. Both are written by hand, as the names of gRPC's two
interfaces do not correspond.
"""

import asyncio
from typing import Any, TypeAlias

import grpc

from fvs_client.connection import Connection
from fvs_client.rpc.addresses import credentials_of, options_of, target_of

AsyncChannel: TypeAlias = grpc.aio.Channel


def open_channel(connection: Connection) -> AsyncChannel:
    """A channel to the service, which connects with the first call."""
    target, options, credentials = target_of(connection), options_of(connection), credentials_of(connection)
    channel: AsyncChannel = (
        grpc.aio.insecure_channel(target, options)
        if credentials is None
        else grpc.aio.secure_channel(target, credentials, options)
    )
    return channel


class AsyncReader:
    """Reads the messages of a stream, each within a time."""

    def __init__(self, call: Any) -> None:
        self._call = call
        self._reading: asyncio.Task[Any] | None = None

    async def read(self, within_s: float) -> bytes | None:
        """The next message; empty after the last, None when none arrived in time."""
        if self._reading is None:
            self._reading = asyncio.ensure_future(self._call.read())
        await asyncio.wait((self._reading,), timeout=within_s)
        if not self._reading.done():
            return None
        content, self._reading = self._reading.result(), None
        return b"" if content is grpc.aio.EOF else bytes(content)

    def cancel(self) -> None:
        """End the stream."""
        if self._reading is not None:
            self._reading.cancel()
        self._call.cancel()
