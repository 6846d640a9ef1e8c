"""Uploads that resume (tus 1.0.0): all of the protocol that the service claims, on a real connection."""

import asyncio
import base64
import contextlib
import hashlib
import io
import os
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx2
import pytest
from fvs_service.gateway.rest.bodies import blocks
from fvs_service.images.resumable_uploads import UploadWriter
from fvs_service.images.upload_locks import UploadLocks
from fvs_service.principal import Scope
from fvs_service.serving.process_tree import descendants
from fvs_service.serving.running import RunningService, running_service
from fvs_service.storage import blobs
from starlette.requests import Request
from tusclient.client import TusClient

_VERSION = {"Tus-Resumable": "1.0.0"}
_TYPE = {"Content-Type": "application/offset+octet-stream"}


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _metadata(**fields: str) -> str:
    pairs = ((name, base64.b64encode(value.encode()).decode()) for name, value in fields.items())
    return ",".join(f"{name} {encoded}".strip() for name, encoded in pairs)


def _sum(algorithm: str, content: bytes) -> dict[str, str]:
    digest = hashlib.new(algorithm, content).digest()
    return {"Upload-Checksum": f"{algorithm} {base64.b64encode(digest).decode()}"}


class Device:
    """Sends one image; every call is one request."""

    def __init__(
        self, client: httpx2.Client, scene: str, content: bytes, headers: Mapping[str, str] | None = None
    ) -> None:
        self.client, self.scene, self.content = client, scene, content
        self.headers = {**_VERSION, **(headers or {})}
        self.url = ""

    def create(self, body: bytes = b"", **metadata: str) -> httpx2.Response:
        given = {"scene": self.scene, "sha256": _sha256(self.content), **metadata}
        headers = {
            **self.headers,
            "Upload-Length": str(len(self.content)),
            "Upload-Metadata": _metadata(**given),
            **(_TYPE if body else {}),
        }
        made = self.client.post("/v1/uploads", headers=headers, content=body)
        self.url = made.headers.get("location", self.url)
        return made

    def head(self) -> httpx2.Response:
        return self.client.head(self.url, headers=self.headers)

    def patch(
        self, start: int, stop: int | None = None, headers: Mapping[str, str] | None = None
    ) -> httpx2.Response:
        sent = {**self.headers, **_TYPE, "Upload-Offset": str(start), **(headers or {})}
        return self.client.patch(self.url, headers=sent, content=self.content[start:stop])

    def delete(self) -> httpx2.Response:
        return self.client.delete(self.url, headers=self.headers)

    @property
    def offset(self) -> int:
        answer = self.head()
        assert answer.status_code == 200, answer.headers
        return int(answer.headers["upload-offset"])

    def image(self) -> dict[str, Any]:
        path = f"/v1/scenes/{self.scene}/images/sha256:{_sha256(self.content)}"
        answer = self.client.get(path, headers=self.headers)
        assert answer.status_code == 200, answer.text
        found: dict[str, Any] = answer.json()
        return found


@pytest.fixture
def gateway(serve: Any) -> Any:
    return serve()


@pytest.fixture
def device(gateway: Any, photograph: Callable[..., bytes]) -> Device:
    return Device(gateway.client, gateway.scene(), photograph(1, (320, 240)))


def _bytes_on_disk(gateway: Any) -> int:
    """Of all uploads, in any form."""
    folders = (gateway.settings.resumable_uploads, gateway.settings.staging, gateway.settings.partial_uploads)
    files = (file for folder in folders for file in folder.rglob("*") if file.is_file())
    return sum(file.stat().st_size for file in files if file.suffix != ".json")


def _descriptions(gateway: Any) -> list[Path]:
    return list(gateway.settings.resumable_uploads.rglob("*.json"))


def test_options_tells_what_is_supported(gateway: Any) -> None:
    answer = gateway.client.options("/v1/uploads")
    assert answer.status_code == 204
    assert answer.headers["tus-resumable"] == answer.headers["tus-version"] == "1.0.0"
    assert set(answer.headers["tus-extension"].split(",")) == {
        *("creation", "creation-with-upload", "expiration", "checksum", "termination")
    }
    assert int(answer.headers["tus-max-size"]) == gateway.settings.limits.image_bytes
    assert set(answer.headers["tus-checksum-algorithm"].split(",")) == {"sha1", "sha256"}


def test_an_image_arrives_in_parts_with_the_verdict_of_a_put(gateway: Any, device: Device) -> None:
    made = device.create(filename="DSC_1.jpg", yaw_deg="10.5")
    assert made.status_code == 201
    assert made.headers["tus-resumable"] == "1.0.0"
    assert made.headers["upload-offset"] == "0"
    left_s = (parsedate_to_datetime(made.headers["upload-expires"]) - datetime.now(UTC)).total_seconds()
    assert 0.9 * gateway.settings.partial_upload_s < left_s <= gateway.settings.partial_upload_s
    state = device.head()
    assert (state.status_code, state.headers["upload-offset"]) == (200, "0")
    assert state.headers["upload-length"] == str(len(device.content))
    assert state.headers["cache-control"] == "no-store"
    given = {"scene": device.scene, "sha256": _sha256(device.content)}
    assert state.headers["upload-metadata"] == _metadata(**given, filename="DSC_1.jpg", yaw_deg="10.5")
    assert "upload-expires" in state.headers

    first = device.patch(0, 1000)
    assert (first.status_code, first.headers["upload-offset"]) == (204, "1000")
    assert "upload-expires" in first.headers
    assert "content-location" not in first.headers
    assert device.offset == 1000
    last = device.patch(1000)
    assert (last.status_code, last.headers["upload-offset"]) == (204, str(len(device.content)))
    by_tus = gateway.client.get(last.headers["content-location"]).json()
    assert by_tus == device.image()
    assert by_tus["verdict"] == "accepted"
    assert (by_tus["name"], by_tus["prior"]["yaw_deg"]) == ("DSC_1.jpg", 10.5)
    assert gateway.client.get(f"{last.headers['content-location']}/content").content == device.content
    assert _bytes_on_disk(gateway) == 0

    other = gateway.scene()
    by_put = gateway.put(other, device.content, name="DSC_1.jpg", yaw_deg="10.5").json()
    for one in (by_put, by_tus):
        one.pop("scene_id")
        one.pop("received_at")
    assert by_put == by_tus


def test_a_client_that_missed_the_last_response_learns_that_all_has_arrived(device: Device) -> None:
    device.create()
    device.patch(0)
    size = len(device.content)
    assert device.offset == size
    assert device.create().headers["upload-offset"] == str(size)
    nothing = device.patch(size)  # what tuspy sends then
    assert (nothing.status_code, nothing.headers["upload-offset"]) == (204, str(size))
    assert device.patch(0).status_code == 409


def test_an_image_that_the_scene_has_needs_no_bytes(gateway: Any, device: Device) -> None:
    gateway.put(device.scene, device.content)
    made = device.create()
    assert (made.status_code, made.headers["upload-offset"]) == (201, str(len(device.content)))
    assert made.headers["content-location"].endswith(_sha256(device.content))
    assert device.offset == len(device.content)
    assert _bytes_on_disk(gateway) == 0
    wrong = Device(gateway.client, device.scene, device.content)
    headers = {**_VERSION, "Upload-Length": "7", "Upload-Metadata": made.request.headers["upload-metadata"]}
    assert wrong.client.post("/v1/uploads", headers=headers).status_code == 422


def test_an_upload_that_is_created_again_goes_on(device: Device) -> None:
    device.create(name="a.jpg")
    url = device.url
    device.patch(0, 700)
    again = device.create(name="b.jpg")
    assert (again.status_code, again.headers["location"], again.headers["upload-offset"]) == (201, url, "700")
    device.patch(700)
    assert device.image()["name"] == "b.jpg"


def test_a_creation_may_carry_the_first_bytes(gateway: Any, device: Device) -> None:
    made = device.create(device.content[:500])
    assert (made.status_code, made.headers["upload-offset"]) == (201, "500")
    again = device.create(device.content[:900])
    assert again.headers["upload-offset"] == "500", "they begin at 0, where the upload does not go on"
    device.delete()
    whole = device.create(device.content)
    assert (whole.status_code, whole.headers["upload-offset"]) == (201, str(len(device.content)))
    assert gateway.client.get(whole.headers["content-location"]).json()["verdict"] == "accepted"
    wrong = Device(gateway.client, device.scene, b"abc")
    headers = {**_VERSION, "Upload-Length": "3", "Content-Type": "image/jpeg"}
    headers["Upload-Metadata"] = _metadata(scene=device.scene, sha256=_sha256(b"abc"))
    assert wrong.client.post("/v1/uploads", headers=headers, content=b"abc").status_code == 415
    more = wrong.client.post("/v1/uploads", headers={**headers, **_TYPE}, content=b"abcd")
    assert more.status_code == 413
    assert len(_descriptions(gateway)) == 1, "of the image that is stored"


def test_a_chunk_that_does_not_begin_at_the_offset_is_refused(device: Device) -> None:
    device.create()
    device.patch(0, 100)
    for offset in (0, 99, 101):
        answer = device.patch(offset, offset + 10)
        assert (answer.status_code, answer.json()["code"]) == (409, "offset-mismatch")
    assert device.offset == 100


@pytest.mark.parametrize("offset", [None, "", "-1", "1.5", "x", "1e3", "9" * 30])
def test_an_offset_is_a_number(device: Device, offset: str | None) -> None:
    device.create()
    headers = {**device.headers, **_TYPE, **({} if offset is None else {"Upload-Offset": offset})}
    answer = device.client.patch(device.url, headers=headers, content=b"x")
    assert (answer.status_code, answer.json()["code"]) == (400, "malformed-request")


@pytest.mark.parametrize("kind", [None, "application/octet-stream", "image/jpeg"])
def test_the_type_of_a_chunk_is_that_of_the_protocol(device: Device, kind: str | None) -> None:
    device.create()
    headers = {**device.headers, "Upload-Offset": "0", **({} if kind is None else {"Content-Type": kind})}
    assert device.client.patch(device.url, headers=headers, content=b"x").status_code == 415
    assert device.offset == 0


@pytest.mark.parametrize("algorithm", ["sha1", "sha256"])
def test_of_a_chunk_with_another_checksum_nothing_is_kept(
    gateway: Any, device: Device, algorithm: str
) -> None:
    device.create()
    assert device.patch(0, 1000, _sum(algorithm, device.content[:1000])).status_code == 204
    wrong = device.patch(1000, 2000, _sum(algorithm, b"damaged"))
    assert (wrong.status_code, wrong.json()["code"]) == (460, "checksum-mismatch")
    assert wrong.json()["retryable"]
    assert device.offset == _bytes_on_disk(gateway) == 1000
    assert device.patch(1000, None, _sum(algorithm, device.content[1000:])).status_code == 204
    assert device.image()["verdict"] == "accepted"


@pytest.mark.parametrize("given", ["md5 1B2M2Y8AsgTpgAmY7PhCfg==", "sha256", "sha256 ????", "sha1 AAAA", ""])
def test_checksums_that_cannot_be_checked_are_refused(device: Device, given: str) -> None:
    device.create()
    answer = device.patch(0, 10, {"Upload-Checksum": given})
    assert (answer.status_code, answer.json()["code"]) == (400, "malformed-request")
    assert device.offset == 0


def test_a_damaged_image_is_not_stored_and_its_upload_begins_anew(gateway: Any, device: Device) -> None:
    right, device.content = device.content, device.content
    device.create()
    device.patch(0, 100)
    device.content = right[:100] + b"x" + right[101:]
    wrong = device.patch(100)
    assert (wrong.status_code, wrong.json()["code"]) == (422, "digest-mismatch")
    assert wrong.headers["content-type"] == "application/problem+json"
    assert device.head().status_code == 404
    assert _bytes_on_disk(gateway) == 0
    device.content = right
    assert device.create().headers["upload-offset"] == "0"
    assert device.patch(0).status_code == 204


def test_bytes_beyond_the_end_are_refused(gateway: Any, device: Device) -> None:
    device.create()
    device.patch(0, 100)
    device.content += b"more"
    assert device.patch(100).status_code == 413

    def chunks() -> Iterator[bytes]:  # without a declared length
        yield device.content[100:]

    headers = {**device.headers, **_TYPE, "Upload-Offset": "100"}
    assert device.client.patch(device.url, headers=headers, content=chunks()).status_code == 413
    assert device.offset == _bytes_on_disk(gateway) == 100


def test_a_deleted_upload_is_gone(gateway: Any, device: Device) -> None:
    device.create(device.content[:100])
    assert _bytes_on_disk(gateway) == 100
    deleted = device.delete()
    assert (deleted.status_code, deleted.headers["tus-resumable"]) == (204, "1.0.0")
    assert _bytes_on_disk(gateway) == 0
    assert not _descriptions(gateway)
    for answer in (device.head(), device.patch(0), device.delete()):
        assert answer.status_code == 404


@pytest.mark.parametrize("version", [None, "0.2.2", "2.0.0"])
def test_other_versions_of_the_protocol_are_refused(device: Device, version: str | None) -> None:
    device.create()
    device.headers = {} if version is None else {"Tus-Resumable": version}
    for answer in (device.create(), device.head(), device.patch(0, 10), device.delete()):
        assert (answer.status_code, answer.headers["tus-version"]) == (412, "1.0.0")
    assert device.client.head("/v1/uploads/upl_unknown", headers=device.headers).status_code == 412
    device.headers = dict(_VERSION)
    assert device.offset == 0


def test_a_post_may_stand_for_another_method(device: Device) -> None:
    device.create()

    def post(method: str, content: bytes = b"", **headers: str) -> httpx2.Response:
        sent = {**_VERSION, "X-HTTP-Method-Override": method, **_TYPE, **headers}
        return device.client.post(device.url, headers=sent, content=content)

    assert post("PATCH", device.content[:10], **{"Upload-Offset": "0"}).headers["upload-offset"] == "10"
    assert post("HEAD").headers["upload-offset"] == "10"
    assert post("DELETE").status_code == 204
    assert device.head().status_code == 404
    images = f"/v1/scenes/{device.scene}/images/sha256:{'0' * 64}"
    assert device.client.post(images, headers={"X-HTTP-Method-Override": "DELETE"}).status_code == 405


@pytest.mark.parametrize(
    ("fields", "status", "said"),
    [
        ({"sha256": ""}, 400, "sha256"),
        ({"sha256": "0" * 63}, 400, "sha256"),
        ({"sha256": "Z" * 64}, 400, "sha256"),
        ({"scene": ""}, 400, "scene"),
        ({"scene": "scn_none"}, 404, "scene"),
        ({"latitude_deg": "91", "longitude_deg": "0", "altitude_m": "0"}, 422, "latitude_deg"),
        ({"latitude_deg": "1"}, 422, "latitude_deg, longitude_deg and altitude_m belong together"),
        ({"x_m": "0", "y_m": "0", "z_m": "0"}, 422, "local"),
        ({"name": "a/b"}, 422, "name"),
        ({"lattitude_deg": "1"}, 422, "lattitude_deg"),
    ],
)
def test_metadata_that_cannot_be_used_are_refused(
    gateway: Any, device: Device, fields: dict[str, str], status: int, said: str
) -> None:
    answer = device.create(**fields)
    assert answer.status_code == status, answer.text
    assert said in answer.text
    assert answer.headers["tus-resumable"] == "1.0.0"
    assert not _descriptions(gateway)


def test_what_clients_add_to_metadata_is_ignored(device: Device) -> None:
    added = {"filetype": "image/jpeg", "type": "image/jpeg", "relativePath": "null"}
    assert device.create(filename="/DCIM/100/a.jpg", **added).status_code == 201
    device.patch(0)
    assert device.image()["name"] == "a.jpg"


@pytest.mark.parametrize(
    "headers",
    [
        {"Upload-Metadata": None},
        {"Upload-Metadata": "scene"},
        {"Upload-Metadata": "scene ?"},
        {"Upload-Metadata": "scene /w=="},
        {"Upload-Metadata": "scene YQ==,scene YQ=="},
        {"Upload-Metadata": "scene " + "YQ" * 5000},
        {"Upload-Length": None},
        {"Upload-Length": "-1"},
        {"Upload-Length": "x"},
        {"Upload-Length": None, "Upload-Defer-Length": "1"},
    ],
)
def test_creations_that_cannot_be_read_are_refused(
    gateway: Any, device: Device, headers: dict[str, str | None]
) -> None:
    usual = {**_VERSION, "Upload-Length": "5"}
    usual["Upload-Metadata"] = _metadata(scene=device.scene, sha256="0" * 64)
    sent = {name: value for name, value in {**usual, **headers}.items() if value is not None}
    answer = device.client.post("/v1/uploads", headers=sent)
    assert (answer.status_code, answer.json()["code"]) == (400, "malformed-request")
    assert answer.json()["hint"] or "bytes" in answer.json()["detail"]
    assert not _descriptions(gateway)


def test_an_upload_has_the_limits_of_images(serve: Any, photograph: Callable[..., bytes]) -> None:
    gateway = serve(limits={"image_bytes": 2000, "images_per_scene": 1})
    device = Device(gateway.client, gateway.scene(), photograph(1, (320, 240)))
    refused = device.create()
    assert (refused.status_code, refused.json()["code"]) == (413, "payload-too-large")
    assert not _descriptions(gateway)
    small = [
        Device(gateway.client, device.scene, photograph(seed, (32, 32), "PNG")[:1900]) for seed in (1, 2)
    ]
    for one in small:
        assert one.create(one.content[:100]).status_code == 201
    assert small[0].patch(100).status_code == 204
    for full in (small[1].patch(100), small[1].create()):
        assert (full.status_code, full.json()["code"]) == (409, "conflict")
        assert "no more are allowed" in full.json()["detail"]
    assert small[1].head().status_code == 404, "there is no body that could say why"


def test_capabilities_publish_the_limits(gateway: Any) -> None:
    limits = gateway.client.get("/v1/capabilities").json()["limits"]
    assert limits["partial_uploads_per_tenant"] == gateway.settings.limits.partial_uploads_per_tenant


def test_unfinished_uploads_are_limited_and_the_smallest_that_waits_gives_way(
    serve: Any, photograph: Callable[..., bytes]
) -> None:
    gateway = serve(limits={"partial_uploads_per_tenant": 2}, upload_place_s=100)
    scene = gateway.scene()
    first, second, third = (Device(gateway.client, scene, photograph(seed)) for seed in range(3))
    first.create(first.content[:200])
    second.create(second.content[:100])
    refused = third.create()
    assert (refused.status_code, refused.json()["code"]) == (429, "limit-exceeded")
    assert 90 <= int(refused.headers["retry-after"]) <= 100
    for part in gateway.settings.resumable_uploads.rglob("*.part"):
        os.utime(part, (time.time() - 101,) * 2)
    assert third.create().status_code == 201
    assert (first.head().status_code, second.head().status_code) == (200, 404)
    assert second.create().status_code == 201, "now the first waits"
    assert first.head().status_code == 404


def test_an_upload_expires(serve: Any, photograph: Callable[..., bytes]) -> None:
    gateway = serve(partial_upload_s=100, sweep_s=0.05)
    scene = gateway.scene()
    old, fresh = (Device(gateway.client, scene, photograph(seed)) for seed in range(2))
    for one in (old, fresh):
        one.create(one.content[:100])
    for file in gateway.settings.resumable_uploads.rglob(f"{old.url.rpartition('/')[2]}.*"):
        os.utime(file, (time.time() - 101,) * 2)
    assert old.head().status_code == 404
    assert old.patch(100).status_code == 404
    deadline = time.monotonic() + 20
    while _bytes_on_disk(gateway) > 100:
        assert time.monotonic() < deadline
        time.sleep(0.02)
    assert fresh.offset == 100
    assert len(_descriptions(gateway)) == 1


def test_a_full_disk_refuses_an_upload_before_its_bytes(serve: Any, photograph: Callable[..., bytes]) -> None:
    gateway = serve(reserve_bytes=10**15)
    device = Device(gateway.client, gateway.scene(), photograph(1))
    refused = device.create(device.content)
    assert (refused.status_code, refused.json()["code"]) == (507, "out-of-space")
    assert not _descriptions(gateway)


def test_a_disk_that_fills_up_refuses_the_rest(
    serve: Any, photograph: Callable[..., bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    gateway = serve()
    device = Device(gateway.client, gateway.scene(), photograph(1))
    device.create(device.content[:100])
    monkeypatch.setattr(blobs, "free_bytes", lambda _: len(device.content) - 101)
    refused = device.patch(100)
    assert (refused.status_code, refused.json()["code"]) == (507, "out-of-space")
    assert device.offset == _bytes_on_disk(gateway) == 100
    monkeypatch.undo()
    assert device.patch(100).status_code == 204


def test_an_empty_file_is_an_upload_without_bytes(gateway: Any) -> None:
    device = Device(gateway.client, gateway.scene(), b"")
    made = device.create()
    assert (made.status_code, made.headers["upload-offset"]) == (201, "0")
    assert device.image()["verdict"] == "unreadable"


def test_an_upload_whose_image_was_deleted_is_gone(gateway: Any, device: Device) -> None:
    device.create(device.content)
    gateway.client.delete(f"/v1/scenes/{device.scene}/images/sha256:{_sha256(device.content)}")
    assert device.head().status_code == 404
    assert device.patch(0).status_code == 404
    assert device.create(device.content).status_code == 201
    assert device.image()["verdict"] == "accepted"


def test_an_image_that_arrives_another_way_ends_its_upload(gateway: Any, device: Device) -> None:
    device.create(device.content[:100])
    gateway.put(device.scene, device.content)
    assert device.offset == len(device.content)
    assert _bytes_on_disk(gateway) == 0


def _raw(gateway: Any, device: Device, body: bytes, *, length: int) -> socket.socket:
    """A PATCH at 0 that declares ``length`` bytes and has sent ``body``."""
    url = urlsplit(str(gateway.client.base_url))
    head = (
        f"PATCH {device.url} HTTP/1.1\r\nHost: localhost\r\nTus-Resumable: 1.0.0\r\nUpload-Offset: 0\r\n"
        f"Content-Type: application/offset+octet-stream\r\nContent-Length: {length}\r\n\r\n"
    )
    connection = socket.create_connection((url.hostname, url.port), 30)
    connection.sendall(head.encode() + body)
    return connection


def _until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 20
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


@pytest.mark.parametrize("size", [1, 1000, 100_000, 700_001])
def test_what_arrived_before_a_connection_broke_is_kept(gateway: Any, size: int) -> None:
    content = os.urandom(1_000_000)
    device = Device(gateway.client, gateway.scene(), content)
    device.create()
    with _raw(gateway, device, content[:size], length=len(content)):
        pass
    _until(lambda: device.offset == size)
    assert device.patch(size).status_code == 204
    assert device.image()["verdict"] == "unreadable", "noise, but all of it"


def test_what_arrived_while_earlier_bytes_were_written_is_kept(
    gateway: Any, device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    write, writing, may_end = UploadWriter.write, threading.Event(), threading.Event()

    def slow(writer: UploadWriter, content: bytes) -> None:
        writing.set()
        assert may_end.wait(30)
        write(writer, content)

    monkeypatch.setattr(UploadWriter, "write", slow)
    device.create()
    with _raw(gateway, device, device.content[:300], length=len(device.content)) as connection:
        assert writing.wait(30)
        for start in (300, 600):  # the second of them lies in the server when the connection breaks
            connection.sendall(device.content[start : start + 300])
            time.sleep(0.2)
    time.sleep(0.2)
    may_end.set()
    _until(lambda: device.offset == 900)


def test_what_arrived_before_a_request_is_ended_is_not_dropped() -> None:
    parts = iter([b"x"])

    async def receive() -> dict[str, Any]:
        for part in parts:
            return {"type": "http.request", "body": part, "more_body": True}
        await asyncio.Event().wait()
        raise AssertionError

    async def run() -> list[bytes]:
        found = []

        async def read() -> None:
            async for block in blocks(Request({"type": "http"}, receive)):
                found.append(block)  # noqa: PERF401 - it is cancelled

        reading = asyncio.ensure_future(read())
        await asyncio.sleep(0.05)
        reading.cancel()
        with pytest.raises(asyncio.CancelledError):
            await reading
        return found

    assert asyncio.run(run()) == [b"x"]


def test_what_arrived_of_a_request_that_stops_is_kept(serve: Any, photograph: Callable[..., bytes]) -> None:
    gateway = serve(upload_idle_s=0.2)
    device = Device(gateway.client, gateway.scene(), photograph(1))
    device.create()
    with _raw(gateway, device, device.content[:300], length=len(device.content)) as connection:
        assert connection.recv(64).startswith(b"HTTP/1.1 408 ")
    assert device.offset == 300
    assert device.patch(300).status_code == 204


def test_of_two_requests_the_first_goes_on_while_its_bytes_arrive(gateway: Any, device: Device) -> None:
    device.create()
    with _raw(gateway, device, device.content[:300], length=len(device.content)) as connection:
        _until(lambda: device.offset == 300)
        second = device.patch(300)
        assert (second.status_code, second.json()["code"]) == (423, "locked")
        assert second.headers["retry-after"] == "1"
        connection.sendall(device.content[300:])
        assert connection.recv(64).startswith(b"HTTP/1.1 204 ")
    assert device.image()["verdict"] == "accepted"


def test_a_request_of_which_nothing_arrives_gives_way(gateway: Any, device: Device) -> None:
    gateway.app.state.application.upload_locks._stalled_s = 0.2
    device.create()
    with _raw(gateway, device, device.content[:300], length=len(device.content)) as connection:
        _until(lambda: device.offset == 300)
        time.sleep(0.3)
        assert device.patch(300).status_code == 204, "the device is back, over another link"
        assert connection.recv(64).startswith(b"HTTP/1.1 423 ")
    assert device.image()["verdict"] == "accepted"


def test_a_deletion_ends_the_request_that_sends(gateway: Any, device: Device) -> None:
    device.create()
    with _raw(gateway, device, device.content[:300], length=len(device.content)) as connection:
        _until(lambda: device.offset == 300)
        assert device.delete().status_code == 204
        assert connection.recv(64).startswith(b"HTTP/1.1 423 ")
    assert _bytes_on_disk(gateway) == 0


def test_an_upload_whose_image_is_not_stored_yet_is_not_finished(gateway: Any, device: Device) -> None:
    """As after a gateway that was killed between the last byte and the image."""
    device.create(device.content[:100])
    (part,) = gateway.settings.resumable_uploads.rglob("*.part")
    part.write_bytes(device.content)
    assert device.offset == len(device.content)
    assert device.image()["verdict"] == "accepted"
    damaged = Device(gateway.client, device.scene, b"x" * 500)
    damaged.create(b"x" * 100)
    (part,) = gateway.settings.resumable_uploads.rglob("*.part")
    part.write_bytes(b"y" * 500)
    assert damaged.head().status_code == 404
    assert _bytes_on_disk(gateway) == 0


def test_who_asks_while_an_image_is_stored_waits(
    gateway: Any, device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    images = gateway.app.state.application.images
    store, storing, may_end = images.store, threading.Event(), threading.Event()

    def slow(*arguments: Any) -> Any:
        storing.set()
        assert may_end.wait(30)
        return store(*arguments)

    monkeypatch.setattr(images, "store", slow)
    device.create()
    answers: list[Any] = []
    ask = [
        threading.Thread(target=lambda: answers.append(device.patch(0).status_code)),
        threading.Thread(target=lambda: answers.append(device.offset)),
    ]
    ask[0].start()
    assert storing.wait(30)
    ask[1].start()
    time.sleep(0.3)
    assert not answers
    may_end.set()
    for thread in ask:
        thread.join()
    assert sorted(answers) == [204, len(device.content)]


@pytest.fixture
def locked(serve: Any) -> Any:
    return serve(require_keys=True)


def test_nobody_else_writes_a_byte(locked: Any, photograph: Callable[..., bytes]) -> None:
    owner = locked.key("owner")
    scene = locked.scene(owner)
    device = Device(locked.client, scene, photograph(1), owner)
    device.create(device.content[:100])
    device_key = locked.key("owner", scopes=frozenset({Scope.UPLOAD}), scene_id=locked.scene(owner))
    for headers, status in (
        ({}, 401),
        ({"Authorization": "Bearer fvs_x_y"}, 401),
        (locked.key("stranger"), 404),
        (device_key, 404),
        (locked.key("owner", scopes=frozenset({Scope.READ})), 403),
    ):
        other = Device(locked.client, scene, device.content, headers)
        other.url = device.url
        answers = [other.patch(100), other.head(), other.delete(), other.create()]
        assert [answer.status_code for answer in answers] == [status] * 4, headers
        other.content = photograph(2)
        assert other.create(other.content).status_code == status
        assert _bytes_on_disk(locked) == 100
        assert len(_descriptions(locked)) == 1
    unknown = locked.client.patch("/v1/uploads/upl_none", headers=locked.key("stranger")).json()
    foreign = locked.client.patch(device.url, headers=locked.key("stranger")).json()
    assert unknown["detail"] == foreign["detail"]
    assert device.patch(100).status_code == 204


def test_an_unauthenticated_body_is_not_even_read(locked: Any, photograph: Callable[..., bytes]) -> None:
    owner = locked.key("owner")
    device = Device(locked.client, locked.scene(owner), photograph(1), owner)
    device.create()
    with _raw(locked, device, b"", length=1_000_000) as connection:
        assert connection.recv(64).startswith(b"HTTP/1.1 401 ")
    assert _bytes_on_disk(locked) == 0


def test_a_device_may_send_to_its_scene_only(locked: Any, photograph: Callable[..., bytes]) -> None:
    owner = locked.key("owner")
    scene = locked.scene(owner)
    key = locked.key("owner", scopes=frozenset({Scope.UPLOAD}), scene_id=scene)
    device = Device(locked.client, scene, photograph(1), key)
    device.create()
    assert device.patch(0).status_code == 204
    assert Device(locked.client, locked.scene(owner), photograph(1), key).create().status_code == 404


def test_uploads_of_two_tenants_have_nothing_in_common(locked: Any, photograph: Callable[..., bytes]) -> None:
    content, urls = photograph(1), set()
    for tenant in ("one", "two"):
        key = locked.key(tenant)
        device = Device(locked.client, locked.scene(key), content, key)
        assert device.create(content[:50]).headers["upload-offset"] == "50"
        urls.add(device.url)
    assert len(urls) == 2


def test_an_upload_that_is_sent_is_not_deleted_meanwhile(
    serve: Any, photograph: Callable[..., bytes]
) -> None:
    gateway = serve(
        limits={"partial_uploads_per_tenant": 1}, upload_place_s=0.1, partial_upload_s=0.2, sweep_s=0.02
    )
    scene = gateway.scene()
    device, other = (Device(gateway.client, scene, photograph(seed)) for seed in range(2))
    device.create()
    with _raw(gateway, device, device.content[:300], length=len(device.content)) as connection:
        _until(lambda: _bytes_on_disk(gateway) == 300)
        time.sleep(0.5)  # longer than it is kept, and than it is spared
        assert other.create().status_code == 429
        assert _bytes_on_disk(gateway) == 300
        connection.sendall(device.content[300:])
        assert connection.recv(64).startswith(b"HTTP/1.1 204 ")
    assert device.image()["verdict"] == "accepted"
    assert other.create().status_code == 201


def test_an_upload_needs_a_place(serve: Any, photograph: Callable[..., bytes]) -> None:
    gateway = serve(limits={"open_uploads_per_tenant": 1})
    scene = gateway.scene()
    first, second = (Device(gateway.client, scene, photograph(seed)) for seed in range(2))
    for one in (first, second):
        one.create()
    with _raw(gateway, first, first.content[:300], length=len(first.content)):
        _until(lambda: first.offset == 300)
        refused = second.patch(0)
        assert (refused.status_code, refused.json()["code"]) == (429, "limit-exceeded")
    _until(lambda: second.patch(0).status_code == 204)


@pytest.mark.parametrize("chunk_bytes", [700, 2**40])
def test_tuspy_sends_an_image(gateway: Any, device: Device, chunk_bytes: int) -> None:
    client = TusClient(f"{gateway.client.base_url}/v1/uploads")
    given = {"scene": device.scene, "sha256": _sha256(device.content), "filename": "a.jpg"}

    def uploader(**options: Any) -> Any:
        file = io.BytesIO(device.content)
        return client.uploader(
            file_stream=file, chunk_size=chunk_bytes, metadata=given, upload_checksum=True, **options
        )

    first = uploader()
    first.upload(stop_at=1400)
    assert first.offset == 1400
    uploader(url=first.url).upload()
    assert device.image()["verdict"] == "accepted"
    uploader(retries=1, retry_delay=0).upload()  # the scene has it


def test_tuspy_goes_on_with_what_another_run_created(gateway: Any, device: Device) -> None:
    device.create(device.content[:1000])
    client = TusClient(f"{gateway.client.base_url}/v1/uploads")
    given = {"scene": device.scene, "sha256": _sha256(device.content)}
    file = io.BytesIO(device.content)
    client.uploader(file_stream=file, metadata=given, retries=1, retry_delay=0).upload()
    assert device.image()["verdict"] == "accepted"


def _kill(service: RunningService) -> None:
    for pid in (service.pid, *descendants(service.pid)):  # the supervisor first: it would start others
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


@pytest.mark.process
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM])
def test_an_upload_goes_on_after_the_gateway_ended(
    tmp_path: Path, photograph: Callable[..., bytes], how: signal.Signals
) -> None:
    """What was not written for half a second is lost when it is killed, and nothing when it is stopped."""
    root, content = tmp_path / "service", photograph(1, (640, 480))
    with (
        running_service(root, tmp_path / "first.log", {"FVS_DRAIN_S": "0.2"}) as service,
        httpx2.Client(base_url=service.url, timeout=60) as client,
    ):
        scene = client.post("/v1/scenes", json={"name": "a"}).json()["id"]
        device = Device(client, scene, content)
        device.create(content[:20_000])
        url = urlsplit(service.url)
        with socket.create_connection((url.hostname, url.port), 30) as connection:
            connection.sendall(
                f"PATCH {device.url} HTTP/1.1\r\nHost: localhost\r\nTus-Resumable: 1.0.0\r\n"
                "Upload-Offset: 20000\r\nContent-Type: application/offset+octet-stream\r\n"
                f"Content-Length: {len(content) - 20_000}\r\n\r\n".encode()
            )
            sent = 20_000
            deadline = time.monotonic() + 30
            while device.offset < 30_000:  # what is written while the request goes on
                assert time.monotonic() < deadline
                connection.sendall(content[sent : sent + 1000])
                sent += 1000
                time.sleep(0.05)
            reached = device.offset
            if how is signal.SIGKILL:
                _kill(service)
            else:
                os.kill(service.pid, how)
                assert connection.recv(64)
                reached = sent
    with (
        running_service(root, tmp_path / "second.log") as service,
        httpx2.Client(base_url=service.url, timeout=60) as client,
    ):
        again = Device(client, scene, content)
        again.url = device.url
        assert reached <= again.offset <= sent
        assert again.patch(again.offset).status_code == 204
        assert again.image()["verdict"] == "accepted"


def test_locks_are_given_to_one_after_the_other() -> None:
    async def run() -> list[str]:
        locks, order = UploadLocks(), []

        async def use(name: str) -> None:
            async with locks.locked("upl_a"):
                order.append(f"{name} begins")
                await asyncio.sleep(0.01)
                order.append(f"{name} ends")

        await asyncio.gather(use("one"), use("two"))
        async with locks.locked("upl_a"), locks.locked("upl_b"):
            pass
        return order

    assert asyncio.run(run()) == ["one begins", "one ends", "two begins", "two ends"]
