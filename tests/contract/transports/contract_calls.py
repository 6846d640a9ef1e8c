"""Calls over gRPC as the tests make them: with a tenant's key, in chunks, and refused."""

import hashlib
import time
from collections.abc import Callable, Iterator
from typing import Any

import grpc
import pytest
from contract_outcome import outcome_of_error
from fvs.v1 import images_pb2 as images

CHUNK = 1000


def refused(call: Callable[[], Any]) -> Any:
    with pytest.raises(grpc.RpcError) as caught:
        call()
    return caught.value, outcome_of_error(caught.value)


def with_key(tenant: Any) -> tuple[tuple[str, str], ...]:
    return (("authorization", f"Bearer {tenant.key}"),)


def digest_of(content: bytes) -> str:
    return f"sha256:{hashlib.sha256(content).hexdigest()}"


def upload_parts(
    scene: str, content: bytes, *, offset: int = 0, stop: int | None = None, **given: Any
) -> Iterator[Any]:
    upload = {
        "scene_id": scene,
        "digest": digest_of(content),
        "size_bytes": len(content),
        "offset_bytes": offset,
    }
    yield images.UploadImageRequest(upload={**upload, **given})
    for start in range(offset, len(content) if stop is None else stop, CHUNK):
        yield images.UploadImageRequest(chunk=content[start : start + CHUNK])


def send(tenant: Any, parts: Iterator[Any]) -> Any:
    return tenant.transport.upload_call()(parts, timeout=60, metadata=with_key(tenant))


def wait_until(true: Callable[[], bool]) -> None:
    until = time.monotonic() + 60
    while not true():
        assert time.monotonic() < until
        time.sleep(0.02)
