"""Thumbnails of accepted images."""

import io
from collections.abc import Callable
from typing import Any

import numpy as np
import piexif
import pytest
from PIL import Image

BLUE, RED = (20, 20, 220), (220, 20, 20)


def _file(size: tuple[int, int], kind: str = "JPEG", **options: Any) -> bytes:
    """A red image whose left half is blue."""
    image = Image.new("RGB", size, RED)
    image.paste(BLUE, (0, 0, size[0] // 2, size[1]))
    out = io.BytesIO()
    image.save(out, kind, **options)
    return out.getvalue()


def _path(gateway: Any, content: bytes, scene: str | None = None) -> str:
    answer = gateway.put(scene or gateway.scene(), content)
    return f"{answer.headers['location']}/thumbnail"


def _thumbnail(gateway: Any, path: str) -> Image.Image:
    answer = gateway.client.get(path)
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"] == "image/jpeg"
    image = Image.open(io.BytesIO(answer.content))
    assert image.format == "JPEG"
    return image


@pytest.mark.parametrize(
    ("kind", "size", "small"),
    [
        ("JPEG", (960, 640), (320, 213)),
        ("PNG", (400, 800), (160, 320)),
        ("TIFF", (96, 64), (96, 64)),
        ("PNG", (1200, 64), (320, 17)),
    ],
)
def test_the_long_side_is_reduced(
    gateway: Any, kind: str, size: tuple[int, int], small: tuple[int, int]
) -> None:
    image = _thumbnail(gateway, _path(gateway, _file(size, kind)))
    assert image.size == small
    pixels = np.asarray(image, dtype=float)
    assert np.abs(pixels[:, : small[0] // 2 - 4] - BLUE).mean() < 8
    assert np.abs(pixels[:, small[0] // 2 + 4 :] - RED).mean() < 8


def test_it_is_upright_and_without_metadata(gateway: Any) -> None:
    exif = piexif.dump({"0th": {piexif.ImageIFD.Orientation: 6, piexif.ImageIFD.Model: b"secret"}})
    content = _file((640, 480), exif=exif, comment=b"secret" * 1000)
    path = _path(gateway, content)
    image = _thumbnail(gateway, path)
    assert image.size == (240, 320)
    assert np.abs(np.asarray(image)[:150].astype(float) - BLUE).mean() < 8
    assert not image.getexif()
    assert b"secret" not in gateway.client.get(path).content


def test_who_has_it_is_told_so(gateway: Any) -> None:
    path = _path(gateway, _file((640, 480)))
    tag = gateway.client.get(path).headers["etag"]
    again = gateway.client.get(path, headers={"If-None-Match": tag})
    assert (again.status_code, again.content, again.headers["etag"]) == (304, b"", tag)
    assert gateway.client.get(path, headers={"If-None-Match": '"another"'}).status_code == 200
    assert gateway.client.head(path).status_code == 200


def test_only_accepted_images_have_one(gateway: Any, photograph: Callable[..., bytes]) -> None:
    scene = gateway.scene()
    first = _path(gateway, photograph(1, image_format="PNG"), scene)
    twin = gateway.client.get(_path(gateway, photograph(1, image_format="BMP"), scene))
    assert (twin.status_code, twin.json()["code"]) == (404, "not-found")
    assert first.split("/")[-2] in twin.json()["hint"]
    assert gateway.client.get(_path(gateway, b"no image", scene)).status_code == 404
    folder = gateway.settings.root / "blobs" / "scenes" / scene / "thumbnails"
    assert len([*folder.iterdir()]) == 1


def test_it_is_deleted_with_its_image(gateway: Any) -> None:
    scene, content = gateway.scene(), _file((640, 480))
    path = _path(gateway, content, scene)
    folder = gateway.settings.root / "blobs" / "scenes" / scene / "thumbnails"
    assert gateway.client.delete(path.removesuffix("/thumbnail")).status_code == 204
    assert gateway.client.get(path).status_code == 404
    gateway.application.storage.removals.run()
    assert [*folder.iterdir()] == []
    assert _path(gateway, content, scene) == path
    gateway.application.storage.removals.run()
    assert _thumbnail(gateway, path).size == (320, 240)
