"""Who may write to an upload, and read its offset."""

from collections.abc import Callable
from typing import Any

from fvs_service.principal import Scope
from tus_device import Device, bytes_on_disk, descriptions, send_raw


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
        assert bytes_on_disk(locked) == 100
        assert len(descriptions(locked)) == 1
    unknown = locked.client.patch("/v1/uploads/upl_none", headers=locked.key("stranger")).json()
    foreign = locked.client.patch(device.url, headers=locked.key("stranger")).json()
    assert unknown["detail"] == foreign["detail"]
    assert device.patch(100).status_code == 204


def test_an_unauthenticated_body_is_not_even_read(locked: Any, photograph: Callable[..., bytes]) -> None:
    owner = locked.key("owner")
    device = Device(locked.client, locked.scene(owner), photograph(1), owner)
    device.create()
    with send_raw(locked, device, b"", length=1_000_000) as connection:
        assert connection.recv(64).startswith(b"HTTP/1.1 401 ")
    assert bytes_on_disk(locked) == 0


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
