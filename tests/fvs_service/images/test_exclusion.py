import hashlib
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from fvs_service.images.exclusion import quarantine
from fvs_service.images.repository import register, usable_images
from fvs_service.principal import Scope
from fvs_service.storage.tables import EventRow
from sqlalchemy import select

from fvs_schema.findings import Finding, FindingCode

Photograph = Callable[..., bytes]


def _path(scene: str, content: bytes, what: str = "") -> str:
    return f"/v1/scenes/{scene}/images/sha256:{hashlib.sha256(content).hexdigest()}{what}"


def _blobs(gateway: Any, scene: str) -> list[str]:
    folder: Path = gateway.settings.root / "blobs" / "scenes" / scene / "images"
    return sorted(file.name for file in folder.iterdir()) if folder.exists() else []


def _kinds(gateway: Any, scene: str) -> list[str]:
    with gateway.application.storage.database.reading() as session:
        rows = session.scalars(select(EventRow).where(EventRow.scene_id == scene).order_by(EventRow.number))
        return [row.kind for row in rows]


def _usable(gateway: Any, scene: str) -> list[str]:
    with gateway.application.storage.database.reading() as session:
        return [image.name for image in usable_images(session, scene)]


def test_an_image_is_excluded_and_included_again(gateway: Any, photograph: Photograph) -> None:
    scene, contents = gateway.scene(), [photograph(1), photograph(2)]
    for number, content in enumerate(contents):
        gateway.put(scene, content, name=f"{number}.jpg")
    for _ in range(2):  # twice has the effect of once
        answer = gateway.client.post(_path(scene, contents[0], ":exclude"))
        assert answer.status_code == 200
        assert answer.json()["registration"] == "excluded"
        assert answer.json()["reason"]
    assert _usable(gateway, scene) == ["1.jpg"]
    counts = gateway.client.get(f"/v1/scenes/{scene}").json()["image_counts"]
    assert (counts["accepted"], counts["pending"], counts["excluded"]) == (2, 1, 1)

    # A job that ran meanwhile does not bring it back.
    digest = f"sha256:{hashlib.sha256(contents[0]).hexdigest()}"
    with gateway.application.storage.database.writing() as session:
        register(session, scene, [digest], {})
    assert gateway.client.get(_path(scene, contents[0])).json()["registration"] == "excluded"

    for _ in range(2):
        answer = gateway.client.post(_path(scene, contents[0], ":include"))
        assert (answer.json()["registration"], answer.json()["reason"]) == ("pending", "")
    assert _usable(gateway, scene) == ["0.jpg", "1.jpg"]
    assert [kind for kind in _kinds(gateway, scene) if "cluded" in kind] == [
        "image.excluded",
        "image.included",
    ]


def test_a_quarantined_image_says_why_and_can_be_tried_again(gateway: Any, photograph: Photograph) -> None:
    scene, content = gateway.scene(), photograph()
    digest = gateway.put(scene, content).json()["digest"]
    lease = gateway.lease(scene)
    database = gateway.application.storage.database
    for how in ("signal SIGSEGV", "signal SIGABRT"):
        reason = Finding.of(FindingCode.QUARANTINED, stage="match", how=how)
        with database.writing() as session:
            quarantine(session, lease, {digest: reason, f"sha256:{'0' * 64}": reason})
    image = gateway.client.get(_path(scene, content)).json()
    assert (image["verdict"], image["registration"], image["reason"]) == (
        "accepted",
        "quarantined",
        f"{image['name']} is quarantined: it crashes the stage match whenever that gets it (signal SIGSEGV).",
    )
    assert image["finding"] == "quarantined"
    assert image["hint"]
    assert gateway.client.get(f"/v1/scenes/{scene}").json()["image_counts"]["quarantined"] == 1
    assert _usable(gateway, scene) == []
    included = gateway.client.post(_path(scene, content, ":include")).json()
    assert (included["registration"], included["reason"], included["finding"]) == ("pending", "", None)
    assert _kinds(gateway, scene).count("image.quarantined") == 1


def test_what_is_no_image_of_the_scene_cannot_be_excluded(gateway: Any, photograph: Photograph) -> None:
    scene, other = gateway.scene(), gateway.scene()
    gateway.put(other, photograph())
    for verb in (":exclude", ":include"):
        assert gateway.client.post(_path(scene, photograph(), verb)).status_code == 404
    gateway.put(scene, b"no image")
    refused = gateway.client.post(_path(scene, b"no image", ":exclude"))
    assert (refused.status_code, refused.json()["code"]) == (409, "conflict")
    assert "unreadable" in refused.json()["detail"]


@pytest.mark.parametrize("removed", [True, False], ids=["after its removal", "before its removal"])
def test_a_deleted_image_is_gone_with_its_bytes_and_can_be_sent_again(
    gateway: Any, photograph: Photograph, removed: bool
) -> None:
    scene, contents = gateway.scene(), [photograph(1), photograph(2)]
    first = [gateway.put(scene, content).json() for content in contents]
    assert gateway.client.delete(_path(scene, contents[1])).status_code == 204
    assert gateway.client.delete(_path(scene, contents[1])).status_code == 404
    assert gateway.client.get(_path(scene, contents[1])).status_code == 404
    assert gateway.client.get(_path(scene, contents[1], "/content")).status_code == 404
    if removed:
        gateway.application.storage.removals.run()
        assert _blobs(gateway, scene) == [hashlib.sha256(contents[0]).hexdigest()]
    again = gateway.put(scene, contents[1])
    assert again.status_code == 201
    assert again.json()["number"] == first[1]["number"] + 1  # no number is given twice
    gateway.application.storage.removals.run()
    assert len(_blobs(gateway, scene)) == 2
    assert gateway.client.get(_path(scene, contents[1], "/content")).content == contents[1]


def test_deleting_and_sending_at_once_leaves_a_whole_image_or_none(
    gateway: Any, photograph: Photograph
) -> None:
    scene, content = gateway.scene(), photograph(7)
    statuses: list[int] = []

    def send() -> None:
        statuses.append(gateway.put(scene, content).status_code)

    def delete() -> None:
        statuses.append(gateway.client.delete(_path(scene, content)).status_code)
        gateway.application.storage.removals.run()

    for _ in range(4):
        threads = [threading.Thread(target=act) for act in (send, delete, delete, send)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert set(statuses) <= {200, 201, 204, 404, 503}
    gateway.application.storage.removals.run()
    there = gateway.client.get(_path(scene, content)).status_code == 200
    assert len(_blobs(gateway, scene)) == there
    assert gateway.client.get(_path(scene, content, "/content")).status_code == (200 if there else 404)


def test_bytes_that_were_sent_twice_at_once_go_with_their_image(
    gateway: Any, photograph: Photograph, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second upload, over another way, finds the image of the first when its bytes are stored already."""
    scene, content = gateway.scene(), photograph(7)
    images = gateway.application.images
    has_twin, first = images._has_twin, []

    def while_the_first_arrives(*args: Any) -> bool:
        found: bool = has_twin(*args)
        if not first:
            first.append(None)
            sent = gateway.client.post(f"/v1/scenes/{scene}/images", files={"file": ("a.jpg", content)})
            first.append(sent.json()["items"][0]["created"])
        return found

    monkeypatch.setattr(images, "_has_twin", while_the_first_arrives)
    assert gateway.put(scene, content).status_code == 200
    assert first == [None, True]
    assert len(_blobs(gateway, scene)) == 1
    assert gateway.client.delete(_path(scene, content)).status_code == 204
    gateway.application.storage.removals.run()
    assert _blobs(gateway, scene) == []


def test_duplicates_go_with_the_image_whose_pixels_they_share(gateway: Any, photograph: Photograph) -> None:
    scene, content = gateway.scene(), photograph(image_format="PNG")
    twin = content.replace(b"IEND", b"IEND", 1) + b"\0"
    gateway.put(scene, content)
    assert gateway.put(scene, twin).json()["verdict"] == "duplicate"
    missing = gateway.client.get(_path(scene, twin, "/content"))
    assert missing.status_code == 404
    assert hashlib.sha256(content).hexdigest() in missing.json()["hint"]
    gateway.client.delete(_path(scene, content))
    assert gateway.client.get(f"/v1/scenes/{scene}/images").json()["items"] == []
    assert gateway.put(scene, twin).json()["verdict"] == "accepted"


def test_the_original_is_downloaded_whole_in_parts_and_only_if_it_changed(
    gateway: Any, photograph: Photograph
) -> None:
    scene, content = gateway.scene(), photograph()
    gateway.put(scene, content, name='Küste "1".jpg')
    whole = gateway.client.get(_path(scene, content, "/content"))
    assert whole.content == content
    assert whole.headers["content-type"] == "image/jpeg"
    assert whole.headers["etag"] == f'"{hashlib.sha256(content).hexdigest()}"'
    assert whole.headers["content-disposition"] == (
        "attachment; filename=\"K_ste _1_.jpg\"; filename*=UTF-8''K%C3%BCste%20%221%22.jpg"
    )
    part = gateway.client.get(_path(scene, content, "/content"), headers={"Range": "bytes=10-19"})
    assert (part.status_code, part.content) == (206, content[10:20])
    tag = {"If-None-Match": whole.headers["etag"]}
    assert gateway.client.get(_path(scene, content, "/content"), headers=tag).status_code == 304
    gateway.put(scene, b"no image")
    assert gateway.client.get(_path(scene, b"no image", "/content")).status_code == 404


@pytest.mark.parametrize(
    ("method", "what", "scope"),
    [
        ("POST", ":exclude", "operate"),
        ("POST", ":include", "operate"),
        ("DELETE", "", "operate"),
        ("GET", "/content", "read"),
    ],
)
def test_each_operation_needs_its_scope(
    open_gateway: Any, photograph: Photograph, method: str, what: str, scope: str
) -> None:
    gateway = open_gateway(require_keys=True)
    every = gateway.key("a", scopes=list(Scope))
    others = gateway.key("a", scopes=[one for one in Scope if one.value != scope])
    stranger = gateway.key("b", scopes=list(Scope))
    scene, content = gateway.scene(every), photograph()
    gateway.put(scene, content, headers=every)
    path = _path(scene, content, what)
    assert gateway.client.request(method, path, headers=others).status_code == 403
    assert gateway.client.request(method, path, headers=stranger).status_code == 404
    assert gateway.client.request(method, path, headers=every).is_success
