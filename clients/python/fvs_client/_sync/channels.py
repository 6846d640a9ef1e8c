"""Code that differs from the asynchronous client: channels of gRPC and waiting for messages, for threads.

``_async/channels.py`` has the same for tasks. Both are written by hand, as the names of gRPC's two
interfaces do not correspond.
"""

import queue
import threading
from typing import Any, TypeAlias

import grpc

from fvs_client.connection import Connection
from fvs_client.rpc.addresses import credentials_of, options_of, target_of

Channel: TypeAlias = grpc.Channel


def open_channel(connection: Connection) -> Channel:
    """A channel to the service, which connects with the first call."""
    target, options, credentials = target_of(connection), options_of(connection), credentials_of(connection)
    channel: Channel = (
        grpc.insecure_channel(target, options)
        if credentials is None
        else grpc.secure_channel(target, credentials, options)
    )
    return channel


class Reader:
    """Reads the messages of a stream, each within a time."""

    def __init__(self, call: Any) -> None:
        self._call = call
        self._arrived: queue.SimpleQueue[bytes | grpc.RpcError] = queue.SimpleQueue()
        threading.Thread(target=self._receive, name="fvs-client-events", daemon=True).start()

    def read(self, within_s: float) -> bytes | None:
        """The next message; empty after the last, None when none arrived in time."""
        try:
            content = self._arrived.get(timeout=within_s)
        except queue.Empty:
            return None
        if isinstance(content, grpc.RpcError):
            raise content
        return bytes(content)

    def cancel(self) -> None:
        """End the stream."""
        self._call.cancel()

    def _receive(self) -> None:
        try:
            for content in self._call:
                self._arrived.put(content)
            self._arrived.put(b"")
        except grpc.RpcError as error:
            self._arrived.put(error)
