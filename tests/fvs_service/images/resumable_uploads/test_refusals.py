"""Creations that cannot be read, and the limits on size, number, age and disk."""

import os
import time
from collections.abc import Callable
from typing import Any

import pytest
from fvs_service.storage import blobs
from tus_device import VERSION, Device, bytes_on_disk, descriptions, sha256_of, tus_metadata


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
    assert not descriptions(gateway)


def test_what_clients_add_to_metadata_is_ignored(device: Device) -> None:
    added = {"filetype": "image/jpeg", "type": "image/jpeg", "relativePath": "null", "size": "5"}
    added |= {"lastModified": "1777864921000", "lastModifiedDate": "", "webkitRelativePath": ""}
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
    usual = {**VERSION, "Upload-Length": "5"}
    usual["Upload-Metadata"] = tus_metadata(scene=device.scene, sha256="0" * 64)
    sent = {name: value for name, value in {**usual, **headers}.items() if value is not None}
    answer = device.client.post("/v1/uploads", headers=sent)
    assert (answer.status_code, answer.json()["code"]) == (400, "malformed-request")
    assert answer.json()["hint"]
    assert not descriptions(gateway)


def test_an_upload_has_the_limits_of_images(serve: Any, photograph: Callable[..., bytes]) -> None:
    gateway = serve(limits={"image_bytes": 2000, "images_per_scene": 1})
    device = Device(gateway.client, gateway.scene(), photograph(1, (320, 240)))
    refused = device.create()
    assert (refused.status_code, refused.json()["code"]) == (413, "payload-too-large")
    assert not descriptions(gateway)
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


@pytest.mark.system
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
    for part in gateway.settings.uploads.rglob("*.part"):
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
    for file in gateway.settings.uploads.rglob(f"{old.url.rpartition('/')[2]}.*"):
        os.utime(file, (time.time() - 101,) * 2)
    assert old.head().status_code == 404
    assert old.patch(100).status_code == 404
    deadline = time.monotonic() + 20
    while bytes_on_disk(gateway) > 100:
        assert time.monotonic() < deadline
        time.sleep(0.02)
    assert fresh.offset == 100
    assert len(descriptions(gateway)) == 1


def test_a_full_disk_refuses_an_upload_before_its_bytes(serve: Any, photograph: Callable[..., bytes]) -> None:
    gateway = serve(reserve_bytes=10**15)
    device = Device(gateway.client, gateway.scene(), photograph(1))
    refused = device.create(device.content)
    assert (refused.status_code, refused.json()["code"]) == (507, "out-of-space")
    assert not descriptions(gateway)


def test_a_disk_that_fills_up_refuses_the_rest(
    serve: Any, photograph: Callable[..., bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    gateway = serve()
    device = Device(gateway.client, gateway.scene(), photograph(1))
    device.create(device.content[:100])
    monkeypatch.setattr(blobs, "free_bytes", lambda _: len(device.content) - 101)
    refused = device.patch(100)
    assert (refused.status_code, refused.json()["code"]) == (507, "out-of-space")
    assert device.offset == bytes_on_disk(gateway) == 100
    monkeypatch.undo()
    assert device.patch(100).status_code == 204


def test_an_empty_file_is_an_upload_without_bytes(gateway: Any) -> None:
    device = Device(gateway.client, gateway.scene(), b"")
    made = device.create()
    assert (made.status_code, made.headers["upload-offset"]) == (201, "0")
    assert device.image()["verdict"] == "unreadable"


def test_an_upload_whose_image_was_deleted_is_gone(gateway: Any, device: Device) -> None:
    device.create(device.content)
    gateway.client.delete(f"/v1/scenes/{device.scene}/images/sha256:{sha256_of(device.content)}")
    assert device.head().status_code == 404
    assert device.patch(0).status_code == 404
    assert device.create(device.content).status_code == 201
    assert device.image()["verdict"] == "accepted"


def test_an_image_that_arrives_another_way_ends_its_upload(gateway: Any, device: Device) -> None:
    device.create(device.content[:100])
    gateway.put(device.scene, device.content)
    assert device.offset == len(device.content)
    assert bytes_on_disk(gateway) == 0
