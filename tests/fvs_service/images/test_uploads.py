"""One store for uploads over all transports: what arrived over one is continued over another."""

import asyncio
import os
import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx2
import pytest
from fvs.v1.images_pb2 import UploadImageRequest
from fvs_service.errors import LimitExceededError, MalformedRequestError, OffsetMismatchError
from fvs_service.images.uploads import Upload, Uploads
from grpc_uploads import upload_over_grpc
from tus_device import Device, bytes_on_disk, sha256_of, wait_until

from fvs_schema.images import ImageMetadata

_PART = 300


def _over_grpc(gateway: Any, device: Device, start: int, stop: int | None = None) -> Any:
    upload = {
        "scene_id": device.scene,
        "digest": f"sha256:{sha256_of(device.content)}",
        "size_bytes": len(device.content),
        "offset_bytes": start,
    }
    messages = iter(
        [
            UploadImageRequest(upload=upload).SerializeToString(),
            UploadImageRequest(chunk=device.content[start:stop]).SerializeToString(),
        ]
    )

    async def receive() -> bytes | None:
        return next(messages, None)

    return asyncio.run(upload_over_grpc(gateway, receive))


def _put_head(device: Device) -> bytes:
    path = f"/v1/scenes/{device.scene}/images/sha256:{sha256_of(device.content)}"
    return f"PUT {path} HTTP/1.1\r\nHost: localhost\r\nContent-Length: {len(device.content)}\r\n\r\n".encode()


def _connect(gateway: Any) -> socket.socket:
    url = gateway.client.base_url
    return socket.create_connection((url.host, url.port), 30)


def _begin_with_put(gateway: Any, device: Device) -> None:
    with _connect(gateway) as connection:
        connection.sendall(_put_head(device) + device.content[:_PART])
        wait_until(lambda: bytes_on_disk(gateway) == _PART)
    device.create()


def _begin_with_tus(_gateway: Any, device: Device) -> None:
    device.create(device.content[:_PART])


def _begin_with_grpc(gateway: Any, device: Device) -> None:
    with pytest.raises(MalformedRequestError, match=f"after {_PART} of"):
        _over_grpc(gateway, device, 0, _PART)
    device.create()


def _end_with_put(gateway: Any, device: Device) -> None:
    assert gateway.put(device.scene, device.content).status_code == 201


def _end_with_tus(_gateway: Any, device: Device) -> None:
    wait_until(lambda: device.patch(_PART).status_code == 204)  # once the connection of a PUT has ended


def _end_with_grpc(gateway: Any, device: Device) -> None:
    assert _over_grpc(gateway, device, _PART).created


@pytest.mark.parametrize("end", [_end_with_put, _end_with_tus, _end_with_grpc])
@pytest.mark.parametrize("begin", [_begin_with_put, _begin_with_tus, _begin_with_grpc])
def test_an_upload_that_began_over_one_transport_goes_on_over_another(
    serve: Callable[..., Any],
    photograph: Callable[..., bytes],
    begin: Callable[[Any, Device], None],
    end: Callable[[Any, Device], None],
) -> None:
    gateway = serve()
    device = Device(gateway.client, gateway.scene(), photograph(1))
    begin(gateway, device)
    assert device.offset == _PART
    end(gateway, device)
    assert device.image()["verdict"] == "accepted"
    assert device.offset == len(device.content)
    assert bytes_on_disk(gateway) == 0
    content = gateway.client.get(
        f"/v1/scenes/{device.scene}/images/sha256:{sha256_of(device.content)}/content"
    )
    assert content.content == device.content


def test_a_put_replaces_bytes_that_were_damaged_and_loses_none(
    serve: Callable[..., Any], photograph: Callable[..., bytes]
) -> None:
    gateway = serve()
    device = Device(gateway.client, gateway.scene(), photograph(1))
    device.create(device.content[:_PART])
    (part,) = gateway.settings.uploads.rglob("*.part")
    part.write_bytes(b"y" * _PART)
    with _connect(gateway) as connection:
        connection.sendall(_put_head(device) + device.content[:100])
        wait_until(lambda: part.read_bytes()[:100] == device.content[:100])
    assert device.offset == _PART
    assert gateway.put(device.scene, device.content).status_code == 201
    assert device.image()["verdict"] == "accepted"


def test_of_two_puts_the_second_waits_for_the_first(
    serve: Callable[..., Any], photograph: Callable[..., bytes]
) -> None:
    gateway = serve()
    device = Device(gateway.client, gateway.scene(), photograph(1))
    with _connect(gateway) as first, _connect(gateway) as second:
        first.sendall(_put_head(device) + device.content[:_PART])
        wait_until(lambda: bytes_on_disk(gateway) == _PART)
        second.sendall(_put_head(device) + device.content)
        first.sendall(device.content[_PART:])
        assert first.recv(64).startswith(b"HTTP/1.1 201 ")
        assert second.recv(64).startswith(b"HTTP/1.1 200 ")


def test_a_put_goes_on_when_its_link_is_back(
    serve: Callable[..., Any], photograph: Callable[..., bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fvs_service.images.upload_locks._STALLED_S", 0.2)
    gateway = serve()
    device = Device(gateway.client, gateway.scene(), photograph(1))
    with _connect(gateway) as first:
        first.sendall(_put_head(device) + device.content[:_PART])
        wait_until(lambda: bytes_on_disk(gateway) == _PART)
        assert gateway.put(device.scene, device.content).status_code == 201
        assert first.recv(64).startswith(b"HTTP/1.1 423 ")


def test_a_put_of_unknown_length_is_stored(gateway: Any, photograph: Callable[..., bytes]) -> None:
    scene, content = gateway.scene(), photograph(1)
    url = f"/v1/scenes/{scene}/images/sha256:{sha256_of(content)}"

    def send(sent: bytes) -> httpx2.Response:
        answer: httpx2.Response = gateway.client.put(url, content=iter([sent[:_PART], sent[_PART:]]))
        return answer

    assert send(content[:-1]).json()["code"] == "digest-mismatch"
    assert send(content).status_code == 201
    assert send(content).status_code == 200
    assert not list(gateway.settings.uploads.rglob("*.part"))


def test_an_offset_at_which_nothing_has_arrived_is_refused(
    gateway: Any, photograph: Callable[..., bytes]
) -> None:
    device = Device(gateway.client, gateway.scene(), photograph(1))
    with pytest.raises(OffsetMismatchError, match="0 bytes"):
        _over_grpc(gateway, device, _PART)


def _upload(digit: str, scene: str = "scn_1") -> Upload:
    return Upload(
        tenant_id="tenant",
        scene_id=scene,
        digest=f"sha256:{digit * 64}",
        size_bytes=9,
        metadata=ImageMetadata(),
    )


def _send(uploads: Uploads, upload: Upload, content: bytes) -> None:
    with uploads.writer(upload, 0, begin=True) as writer:
        writer.write(content)


def test_uploads_that_nobody_goes_on_with_expire(tmp_path: Path) -> None:
    uploads = Uploads(
        tmp_path, keep_s=100, per_tenant=9, spared_s=1, reserve_bytes=0, max_bytes=9, max_video_bytes=9
    )
    for digit in "12":
        _send(uploads, _upload(digit), b"abc")
    (old,) = tmp_path.rglob(f"*{'1' * 64}*")
    os.utime(old, (time.time() - 101,) * 2)
    uploads.prune()
    assert uploads.arrived_bytes(_upload("1")) is None
    assert uploads.find_part("tenant", "scn_1", f"sha256:{'2' * 64}").offset_bytes == 3


def test_of_too_many_uploads_the_smallest_gives_way_and_the_one_that_arrives_stays(tmp_path: Path) -> None:
    uploads = Uploads(
        tmp_path, keep_s=100, per_tenant=2, spared_s=0, reserve_bytes=0, max_bytes=9, max_video_bytes=9
    )
    _send(uploads, _upload("1"), b"abc")
    _send(uploads, _upload("2"), b"ab")
    _send(uploads, _upload("3"), b"abcd")
    arrived = [uploads.arrived_bytes(_upload(digit)) for digit in "123"]
    assert arrived == [3, None, 4]
    with (
        uploads.writer(_upload("1"), 3),
        uploads.writer(_upload("3"), 4),
        pytest.raises(LimitExceededError, match="2 uploads are unfinished"),
    ):
        _send(uploads, _upload("4"), b"a")


def test_uploads_of_a_scene_go_with_it_and_those_that_cannot_go_on_with_the_gateway(tmp_path: Path) -> None:
    uploads = Uploads(
        tmp_path, keep_s=100, per_tenant=9, spared_s=1, reserve_bytes=0, max_bytes=9, max_video_bytes=9
    )
    _send(uploads, _upload("1"), b"abc")
    _send(uploads, _upload("1", scene="scn_2"), b"abc")
    uploads.remove_scene("tenant", "scn_1")
    killed = uploads.receive()
    killed.write(b"abc")
    uploads.clear()
    assert [path.name[:9] for path in tmp_path.rglob("*.part")] == ["upl_scn_2"]
    killed.__exit__(None, None, None)
