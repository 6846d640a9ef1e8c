import hashlib
import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fvs_service.images.repository import register, usable_images
from PIL import Image

Photograph = Callable[..., bytes]


def png(counts: np.ndarray | None = None, size: tuple[int, int] = (96, 64)) -> bytes:
    """A mask; by default of the right half."""
    if counts is None:
        counts = np.tile(np.arange(size[0]) >= size[0] // 2, (size[1], 1))
    out = io.BytesIO()
    Image.fromarray(counts).save(out, "PNG")
    return out.getvalue()


def digest_of(content: bytes) -> str:
    return f"sha256:{hashlib.sha256(content).hexdigest()}"


def path_of(scene: str, content: bytes, what: str = "/mask") -> str:
    return f"/v1/scenes/{scene}/images/{digest_of(content)}{what}"


def blobs(gateway: Any, scene: str) -> list[str]:
    gateway.application.storage.removals.run()
    folder: Path = gateway.settings.root / "blobs" / "scenes" / scene / "masks"
    return sorted(file.name for file in folder.iterdir()) if folder.exists() else []


def test_a_mask_is_set_once_changed_and_removed(gateway: Any, photograph: Photograph) -> None:
    scene, content, other = gateway.scene(), photograph(1), photograph(2)
    first = gateway.put(scene, content).json()
    gateway.put(scene, other)
    assert first["mask"] is None
    for _ in range(2):  # twice has the effect of once
        answer = gateway.client.put(path_of(scene, content), content=png())
        assert answer.status_code == 200, answer.text
        image = answer.json()
        assert (image["mask"], image["number"], image["registration"]) == (digest_of(png()), 3, "pending")
    stored = f"{digest_of(content)[7:]}-{digest_of(png())[7:]}"
    assert blobs(gateway, scene) == [stored]

    # The next update registers it anew, and one that ran meanwhile does not count.
    database = gateway.application.storage.database
    with database.writing() as session:
        register(session, scene, [digest_of(content), digest_of(other)], {}, last_number=2)
    assert gateway.client.get(path_of(scene, content, "")).json()["registration"] == "pending"
    with database.writing() as session:
        register(session, scene, [digest_of(content), digest_of(other)], {}, last_number=3)
    assert gateway.client.get(path_of(scene, content, "")).json()["registration"] == "registered"

    turned = png(np.tile(np.arange(96) < 20, (64, 1)))
    changed = gateway.client.put(path_of(scene, content), content=turned).json()
    assert (changed["mask"], changed["number"], changed["registration"]) == (digest_of(turned), 4, "pending")
    assert blobs(gateway, scene) == [f"{digest_of(content)[7:]}-{digest_of(turned)[7:]}"]
    with database.reading() as session:
        assert [image.mask for image in usable_images(session, scene)] == [None, digest_of(turned)]
    for _ in range(2):
        removed = gateway.client.delete(path_of(scene, content)).json()
        assert (removed["mask"], removed["number"]) == (None, 5)
    assert blobs(gateway, scene) == []


def test_a_mask_goes_with_its_image(gateway: Any, photograph: Photograph) -> None:
    scene, content = gateway.scene(), photograph(1)
    gateway.put(scene, content)
    gateway.client.put(path_of(scene, content), content=png())
    assert gateway.client.post(path_of(scene, content, ":exclude")).json()["mask"] == digest_of(png())
    masked = gateway.client.put(path_of(scene, content), content=png(np.eye(64, 96, dtype=bool))).json()
    assert masked["registration"] == "excluded"
    assert gateway.client.delete(path_of(scene, content, "")).status_code == 204
    assert blobs(gateway, scene) == []


@pytest.mark.parametrize(
    ("mask", "reason"),
    [
        (png(size=(48, 32)), "it has 48×32 px, the photograph 96×64 px."),
        (png(np.zeros((64, 96), dtype=bool)), "it leaves out every pixel."),
        (b"no PNG", "it cannot be read as a PNG."),
    ],
    ids=["another size", "everything", "no PNG"],
)
def test_masks_that_cannot_be_used(gateway: Any, photograph: Photograph, mask: bytes, reason: str) -> None:
    scene, content = gateway.scene(), photograph(1)
    before = gateway.put(scene, content).json()
    refused = gateway.client.put(path_of(scene, content), content=mask)
    assert (refused.status_code, refused.json()["code"]) == (422, "invalid-request")
    assert refused.json()["detail"].endswith(f" cannot be used: {reason}")
    assert refused.json()["errors"] == [{"field": "mask", "message": reason}]
    assert "masks/" not in refused.text
    assert refused.json()["hint"]
    assert gateway.client.get(path_of(scene, content, "")).json() == before
    assert blobs(gateway, scene) == []


def test_a_form_has_masks_in_any_order(gateway: Any, photograph: Photograph) -> None:
    scene, contents = gateway.scene(), [photograph(seed) for seed in range(4)]
    halves = [png(np.tile(np.arange(96) < edge, (64, 1))) for edge in (20, 40, 60)]
    files = [
        ("mask", ("a.png", halves[0])),
        ("file", ("a.jpg", contents[0])),
        ("file", ("flight 1/b.tif", contents[1])),
        ("file", ("flight 1/masks/b.tif.png", halves[1])),
        ("file", ("c.png", contents[2])),
        ("file", ("d.png", contents[3])),
        ("mask", ("masks\\c.png", halves[2])),
    ]
    for created in (True, False):
        answer = gateway.client.post(f"/v1/scenes/{scene}/images", files=files).json()
        assert not answer["refused_masks"]
        assert [item["created"] for item in answer["items"]] == [created] * 4
        images = [item["image"] for item in answer["items"]]
        assert [image["mask"] for image in images] == [*map(digest_of, halves), None]
        for image in images:
            assert (
                gateway.client.get(
                    path_of(scene, contents[0], "").replace(digest_of(contents[0]), image["digest"])
                ).json()
                == image
            )
    assert len(blobs(gateway, scene)) == 3
    assert not list(gateway.settings.uploads.rglob("*.part"))


def test_masks_of_a_form_that_are_refused_cost_no_image(gateway: Any, photograph: Photograph) -> None:
    scene, contents = gateway.scene(), [photograph(seed) for seed in range(4)]
    names = ["small.jpg", "twice.jpg", "left/both.jpg", "right/both.jpg"]
    files = [("file", (name, content)) for name, content in zip(names, contents, strict=True)]
    masks = [
        ("small.png", png(size=(48, 32))),
        ("twice.jpg.png", png()),
        ("twice.png", png()),
        ("both.png", png()),
        ("none.png", png()),
    ]
    files += [("mask", mask) for mask in masks]
    answer = gateway.client.post(f"/v1/scenes/{scene}/images", files=files)
    assert answer.status_code == 200
    assert [item["image"]["name"] for item in answer.json()["items"]] == [
        "small.jpg",
        "twice.jpg",
        "both.jpg",
        "both.jpg",
    ]
    refused = {mask["name"]: mask["reason"] for mask in answer.json()["refused_masks"]}
    assert refused == {
        "small.png": "The mask of small.jpg cannot be used: it has 48×32 px, the photograph 96×64 px.",
        "twice.png": "twice.jpg has another mask in the form.",
        "both.png": "It could be the mask of left/both.jpg or right/both.jpg.",
        "none.png": "It is the mask of no image in the form.",
    }
    assert all(mask["hint"] for mask in answer.json()["refused_masks"])
    assert len(blobs(gateway, scene)) == 1
    alone = gateway.client.post(f"/v1/scenes/{scene}/images", files=[("mask", masks[0])])
    assert (alone.status_code, alone.json()["detail"]) == (422, "The form has no image.")


def test_what_has_no_mask(gateway: Any, photograph: Photograph) -> None:
    scene = gateway.scene()
    unknown = gateway.client.put(path_of(scene, photograph(1)), content=png())
    assert (unknown.status_code, unknown.json()["code"]) == (404, "not-found")
    gateway.put(scene, b"no image")
    refused = gateway.client.put(path_of(scene, b"no image"), content=png())
    assert (refused.status_code, refused.json()["code"]) == (409, "conflict")
    assert gateway.client.delete(path_of(scene, photograph(1))).status_code == 404
