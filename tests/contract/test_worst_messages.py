"""The worst messages of every method are refused, and none of them holds the event loop."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import grpc
import pytest
from conftest_of import conftest_of
from gateways import running_gateway, settings_for
from google.protobuf.descriptor import Descriptor, FieldDescriptor
from google.protobuf.descriptor_pool import Default
from loop_watchdog import ALLOWED_S, watched_loops

_contract = conftest_of("contract")
_FILES = ("capabilities", "images", "jobs", "scenes", "snapshots", "views")
_DEPTH = 4
_SMALL_BYTES = 65_536
"""More than that is allowed for lists only."""


def _varint(number: int) -> bytes:
    out = bytearray()
    while number > 127:
        out.append(number & 127 | 128)
        number >>= 7
    return bytes([*out, number])


def _field(number: int, content: bytes) -> bytes:
    return _varint(number << 3 | 2) + _varint(len(content)) + content


def _worst_fields(message: Descriptor, size: int, depth: int = 0) -> Iterator[tuple[str, bytes]]:
    """Messages of about ``size`` bytes: each field that is long, and each list of many empty items."""
    for field in message.fields:
        if field.type in (FieldDescriptor.TYPE_STRING, FieldDescriptor.TYPE_BYTES):
            yield field.name, _field(field.number, b"a" * size)
        if field.is_repeated and field.type in (
            FieldDescriptor.TYPE_STRING,
            FieldDescriptor.TYPE_MESSAGE,
        ):
            empty = _field(field.number, b"")
            yield f"{field.name} []", empty * (size // len(empty))
        if field.is_repeated and field.type == FieldDescriptor.TYPE_DOUBLE:
            yield f"{field.name} []", _field(field.number, b"\0" * (size // 8 * 8))
        if field.message_type is not None and depth < _DEPTH:
            for name, content in _worst_fields(field.message_type, size, depth + 1):
                yield f"{field.name}.{name}", _field(field.number, content)


def _worst_messages(message: Descriptor, size: int) -> Iterator[tuple[str, bytes]]:
    yield from _worst_fields(message, size)
    yield "fields of newer clients", b"\xf8\x07\x01" * (size // 3)
    yield "groups", b"\x0b" * size
    yield "no message", b"\xff" * size


def _methods() -> Iterator[tuple[str, Descriptor]]:
    for name in _FILES:
        for service in Default().FindFileByName(f"fvs/v1/{name}.proto").services_by_name.values():
            for method in service.methods:
                yield f"/{service.full_name}/{method.name}", method.input_type


def _code(channel: grpc.Channel, method: str, content: bytes) -> grpc.StatusCode:
    try:
        for _ in channel.stream_stream(method)(iter([content]), timeout=60):
            pass
    except grpc.RpcError as error:
        code: grpc.StatusCode = error.code()
        return code
    return grpc.StatusCode.OK


@pytest.mark.system
def test_no_message_holds_the_event_loop(tmp_path: Path) -> None:
    settings = settings_for(tmp_path / "service", {"grpc_port": 0})
    sizes = (_SMALL_BYTES - 100, settings.limits.json_bytes - 100)
    codes: dict[tuple[str, str, int], grpc.StatusCode] = {}
    holds: dict[tuple[str, str, int], float] = {}
    with watched_loops() as watchdog, running_gateway(settings) as gateway:
        server, port = _contract._start(gateway, settings)
        with grpc.insecure_channel(f"127.0.0.1:{port}") as channel:
            for method, message in _methods():
                for size in sizes:
                    for name, content in _worst_messages(message, size):
                        called = (method, name, size)
                        codes[called], holds[called] = watchdog.hold_of(
                            partial(_code, channel, method, content)
                        )
        gateway.client.portal.call(server.stop, 1.0)
    faults = (grpc.StatusCode.UNKNOWN, grpc.StatusCode.INTERNAL, grpc.StatusCode.DEADLINE_EXCEEDED)
    assert len(codes) > 200
    assert grpc.StatusCode.OK not in codes.values()
    assert not [called for called, code in codes.items() if code in faults]
    assert not {called: held for called, held in holds.items() if held > ALLOWED_S}
