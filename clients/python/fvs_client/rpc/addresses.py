"""How channels reach a service: address, TLS and options."""

import os
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import grpc

from fvs_client.connection import Connection

_MOST_BYTES = 1 << 28
"""Maximum size of an answer: thousands of candidates."""
_PING_MS, _PING_WITHIN_MS = 30_000, 20_000
_FIRST_RECONNECT_MS, _LONGEST_RECONNECT_MS = 200, 5_000
_CONNECT_MS = 10_000
"""Minimum pause between two attempts to connect; gRPC also gives up an attempt after this time."""


def target_of(connection: Connection) -> str:
    """The address of the service as gRPC writes it."""
    return f"dns:///{urlsplit(connection.url).netloc}"


def credentials_of(connection: Connection) -> grpc.ChannelCredentials | None:
    """The credentials of a service with TLS, which honour SSL_CERT_FILE; None without TLS."""
    if urlsplit(connection.url).scheme == "grpc":
        return None
    if connection.credentials is not None:
        return connection.credentials
    trusted = os.environ.get("SSL_CERT_FILE")
    return grpc.ssl_channel_credentials(Path(trusted).read_bytes() if trusted else None)


def options_of(connection: Connection) -> tuple[tuple[str, Any], ...]:
    """The options of channels."""
    return (
        ("grpc.primary_user_agent", connection.user_agent),
        ("grpc.max_receive_message_length", _MOST_BYTES),
        ("grpc.enable_retries", 0),  # the session retries
        ("grpc.enable_http_proxy", 0 if connection.loopback else 1),
        ("grpc.initial_reconnect_backoff_ms", _FIRST_RECONNECT_MS),
        ("grpc.min_reconnect_backoff_ms", _CONNECT_MS),
        ("grpc.max_reconnect_backoff_ms", _LONGEST_RECONNECT_MS),
        # A service that has vanished is noticed.
        ("grpc.keepalive_time_ms", _PING_MS),
        ("grpc.keepalive_timeout_ms", _PING_WITHIN_MS),
        # Channels do not share connections: closing one must not be noticed by another.
        ("grpc.use_local_subchannel_pool", 1),
    )
