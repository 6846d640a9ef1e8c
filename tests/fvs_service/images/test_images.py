import base64
import hashlib
import io
import json
import shutil
import socket
import struct
import time
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from PIL import Image, ImageFilter

Photograph = Callable[..., bytes]


def _digest(content: bytes) -> str:
    return f"sha256:{hashlib.sha256(content).hexdigest()}"


def test_an_image_is_stored_once_and_judged(gateway: Any, photograph: Photograph) -> None:
    scene, content = gateway.scene(), photograph()
    first = gateway.put(scene, content, name="IMG 1.jpg")
    assert first.status_code == 201
    image = first.json()
    assert image["verdict"] == "accepted"
    assert image["registration"] == "pending"
    assert (image["width_px"], image["height_px"], image["format"]) == (96, 64, "JPEG")
    assert image["name"] == "IMG 1.jpg"
    again = gateway.put(scene, content)
    assert again.status_code == 200
    assert again.json() == image
    assert gateway.client.get(first.headers["location"]).json() == image
    assert gateway.client.get(f"/v1/scenes/{scene}").json()["image_counts"]["accepted"] == 1
    folder = gateway.settings.root / "blobs" / "scenes" / scene / "images"
    assert [file.read_bytes() for file in folder.iterdir()] == [content]
    assert list(gateway.settings.uploads.rglob("*.part")) == []


def test_what_is_known_need_not_be_sent(gateway: Any, photograph: Photograph) -> None:
    scene, known, missing = gateway.scene(), photograph(1), photograph(2)
    gateway.put(scene, known)
    answer = gateway.client.post(
        f"/v1/scenes/{scene}/images:check", json={"digests": [_digest(missing), _digest(known)]}
    )
    assert answer.json() == {
        "known": [_digest(known)],
        "missing": [_digest(missing)],
        "images": [{"digest": _digest(known), "verdict": "accepted", "reason": "", "hint": "", "mask": None}],
    }


def test_a_check_tells_the_verdicts_of_images_that_are_not_kept(gateway: Any, photograph: Photograph) -> None:
    scene, twin, broken = gateway.scene(), photograph(1, image_format="PNG"), b"no image"
    for content in (photograph(1, image_format="BMP"), twin, broken):
        gateway.put(scene, content)
    digests = [_digest(broken), _digest(twin)]
    answer = gateway.client.post(f"/v1/scenes/{scene}/images:check", json={"digests": digests}).json()
    assert answer["known"] == [image["digest"] for image in answer["images"]] == digests
    assert [image["verdict"] for image in answer["images"]] == ["unreadable", "duplicate"]
    assert all(image["reason"] and image["hint"] for image in answer["images"])


def test_bytes_that_are_not_what_was_promised_are_refused(gateway: Any, photograph: Photograph) -> None:
    scene, content = gateway.scene(), photograph()
    path = f"/v1/scenes/{scene}/images/{_digest(b'another')}"
    damaged = gateway.client.put(path, content=content)
    assert damaged.status_code == 422
    assert damaged.json()["code"] == "digest-mismatch"
    promise = base64.b64encode(hashlib.sha256(b"a third").digest()).decode()
    for header in ("Repr-Digest", "Content-Digest"):
        for told in (f"sha-256=:{promise}:", f"sha-512=:AAAA:, sha-256=:{promise}:"):
            contradiction = gateway.client.put(path, content=b"another", headers={header: told})
            assert contradiction.json()["code"] == "digest-mismatch"
        for told in ("sha-256=:QUJD:", "sha-256=QUJD", "sha-256=:A:, sha-512=:AAAA:", "sha-256="):
            malformed = gateway.client.put(path, content=b"another", headers={header: told})
            assert malformed.status_code == 400, told
    assert gateway.client.get(f"/v1/scenes/{scene}/images").json()["items"] == []


def test_a_form_takes_many_files(gateway: Any, photograph: Photograph) -> None:
    scene = gateway.scene()
    contents = [photograph(seed, (200, 150)) for seed in range(3)]
    files = [("file", (f"{number}.jpg", content)) for number, content in enumerate([*contents, contents[0]])]
    answer = gateway.client.post(f"/v1/scenes/{scene}/images", files=files)
    assert answer.status_code == 200
    items = answer.json()["items"]
    assert [item["created"] for item in items] == [True, True, True, False]
    assert [item["image"]["digest"] for item in items] == [_digest(c) for c in [*contents, contents[0]]]
    assert [item["name"] for item in items] == ["0.jpg", "1.jpg", "2.jpg", "3.jpg"]


@pytest.mark.parametrize("name", ["../../etc/passwd", "a/b.jpg", "a\\b.jpg", "..", "a\x00b", "x" * 256, ""])
def test_names_are_not_paths(gateway: Any, photograph: Photograph, name: str) -> None:
    scene, content = gateway.scene(), photograph()
    answer = gateway.put(scene, content, name=name)
    assert answer.status_code == 422
    assert answer.json()["errors"][0]["field"] == "name"
    assert gateway.client.get(f"/v1/scenes/{scene}").json()["image_counts"]["received"] == 0


def test_names_in_a_form_are_not_paths_and_cost_no_file(gateway: Any, photograph: Photograph) -> None:
    scene = gateway.scene()
    names = ["../../passwd", "flight 1/a.jpg", "C:\\photos\\b.jpg", "..", "x" * 300]
    contents = [photograph(seed) for seed in range(len(names))]
    files = [("file", (name, content)) for name, content in zip(names, contents, strict=True)]
    answer = gateway.client.post(f"/v1/scenes/{scene}/images", files=files)
    assert answer.status_code == 200
    kept = [item["image"]["name"] for item in answer.json()["items"]]
    digests = [_digest(content).removeprefix("sha256:")[:12] for content in contents[3:]]
    assert kept == ["passwd", "a.jpg", "b.jpg", *digests]


def test_the_same_pixels_in_another_file_are_a_duplicate(gateway: Any, photograph: Photograph) -> None:
    scene, content = gateway.scene(), photograph(image_format="PNG")
    out = io.BytesIO()
    Image.open(io.BytesIO(content)).save(out, "PNG", compress_level=1)
    assert out.getvalue() != content
    gateway.put(scene, content, name="first.png")
    image = gateway.put(scene, out.getvalue(), name="second.png").json()
    assert image["verdict"] == "duplicate"
    assert image["duplicate_of"] == _digest(content)
    assert image["registration"] == "unused"
    folder = gateway.settings.root / "blobs" / "scenes" / scene / "images"
    assert len(list(folder.iterdir())) == 1


def _png_of(width: int, height: int) -> bytes:
    """A PNG of a few bytes that claims to be huge."""

    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    data = zlib.compress(b"\0" * 100_000)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


@pytest.mark.parametrize(
    ("content", "verdict"),
    [
        (b"", "unreadable"),
        (b"not an image", "unreadable"),
        (b"\xff\xd8\xff\xe0" + b"\0" * 64, "unreadable"),
        (b"GIF89a" + b"\0" * 64, "unreadable"),
        (b"<svg xmlns='http://www.w3.org/2000/svg'/>", "unreadable"),
        (_png_of(50_000, 50_000), "too-large"),
        (_png_of(2_000, 900), "unreadable"),
        (_png_of(32, 1_000_000), "too-large"),
        (_png_of(40, 900), "too-narrow"),
    ],
)
def test_what_is_no_photograph_gets_a_verdict(gateway: Any, content: bytes, verdict: str) -> None:
    scene = gateway.scene()
    answer = gateway.put(scene, content)
    assert answer.status_code == 201
    assert answer.json()["verdict"] == verdict
    assert answer.json()["reason"].endswith(".")
    assert answer.json()["hint"]
    counts = gateway.client.get(f"/v1/scenes/{scene}").json()["image_counts"]
    assert (counts["received"], counts["accepted"]) == (1, 0)
    assert not (gateway.settings.root / "blobs" / "scenes" / scene / "images").exists()


def test_a_photograph_cut_off_or_too_small_is_not_used(gateway: Any, photograph: Photograph) -> None:
    scene, content = gateway.scene(), photograph(size=(400, 300))
    assert gateway.put(scene, content[: len(content) // 2]).json()["verdict"] == "unreadable"
    assert gateway.put(scene, photograph(size=(40, 20))).json()["verdict"] == "too-small"


@pytest.mark.system
def test_a_decoder_that_takes_too_much_ends_alone(
    open_gateway: Any, photograph: Photograph, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A child with no memory for 200 megapixels: the image is refused, and the next one is judged as ever."""
    monkeypatch.setattr("fvs_service.images.inspector._MEMORY_PER_DECODING", 0.35)
    gateway = open_gateway(limits={"image_pixels": 250_000_000, "image_decoding_bytes": 2_000_000_000})
    scene = gateway.scene()
    out = io.BytesIO()
    Image.new("1", (15_000, 15_000)).save(out, "PNG", compress_level=1)
    assert gateway.put(scene, out.getvalue()).json()["verdict"] == "unreadable"
    assert gateway.put(scene, photograph()).json()["verdict"] == "accepted"


def test_a_blurred_photograph_is_accepted_with_a_warning(gateway: Any, kermit_dir: Any) -> None:
    scene = gateway.scene()
    file = sorted(kermit_dir.iterdir())[0]
    sharp = gateway.put(scene, file.read_bytes()).json()
    assert (sharp["verdict"], sharp["warnings"]) == ("accepted", [])
    out = io.BytesIO()
    Image.open(file).convert("RGB").filter(ImageFilter.GaussianBlur(4)).save(out, "JPEG", quality=95)
    blurred = gateway.put(scene, out.getvalue()).json()
    assert (blurred["verdict"], blurred["warnings"]) == ("accepted", ["blurred"])
    assert blurred["sharpness"] < sharp["sharpness"]


def test_types_that_are_no_images_are_refused(gateway: Any, photograph: Photograph) -> None:
    scene, content = gateway.scene(), photograph()
    path = f"/v1/scenes/{scene}/images/{_digest(content)}"
    assert gateway.client.put(path, content=content, headers={"Content-Type": "text/html"}).status_code == 415
    assert (
        gateway.client.put(path, content=content, headers={"Content-Type": "image/jpeg"}).status_code == 201
    )
    assert gateway.client.post(f"/v1/scenes/{scene}/images", json={}).status_code == 415


def test_bodies_larger_than_the_limit_are_refused(open_gateway: Any, photograph: Photograph) -> None:
    gateway = open_gateway(limits={"image_bytes": 10_000, "multipart_bytes": 15_000, "json_bytes": 2_000})
    scene, content = gateway.scene(), photograph(size=(300, 300))
    assert len(content) > 15_000
    path = f"/v1/scenes/{scene}/images/{_digest(content)}"
    declared = gateway.client.put(path, content=content)
    undeclared = gateway.client.put(path, content=iter([content[:9_000], content[9_000:]]))
    form = gateway.client.post(f"/v1/scenes/{scene}/images", files={"file": ("a.jpg", content)})
    document = gateway.client.post("/v1/scenes", json={"name": "a" * 2_000})
    for answer in (declared, undeclared, form, document):
        assert answer.status_code == 413, answer.text
        assert answer.json()["code"] == "payload-too-large"
    assert list(gateway.settings.uploads.rglob("*.part")) == []


def test_a_full_disk_takes_no_bytes_and_loses_none(
    gateway: Any, photograph: Photograph, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, content = gateway.scene(), photograph()
    usage = shutil.disk_usage(gateway.settings.root)
    with monkeypatch.context() as patch:
        patch.setattr(shutil, "disk_usage", lambda _path: usage._replace(free=10))
        refused = gateway.put(scene, content)
        form = gateway.client.post(f"/v1/scenes/{scene}/images", files={"file": ("a.jpg", content)})
    for answer in (refused, form):
        assert answer.status_code == 507
        assert answer.json()["code"] == "out-of-space"
        assert answer.json()["retryable"] is True
    assert gateway.put(scene, content).status_code == 201


def test_a_disk_that_fills_while_bytes_arrive(
    gateway: Any, photograph: Photograph, monkeypatch: pytest.MonkeyPatch
) -> None:
    import errno

    from fvs_service.images.upload_files import Writer

    scene, content = gateway.scene(), photograph()

    def write(_writer: Writer, _content: bytes) -> None:
        from fvs_service.storage.blobs import full_disk_as_error

        with full_disk_as_error():
            raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(Writer, "write", write)
        assert gateway.put(scene, content).status_code == 507
    assert list(gateway.settings.uploads.rglob("*.part")) == []


def test_a_client_that_stops_sending_is_let_go(serve: Any) -> None:
    server = serve(upload_idle_s=0.3)
    scene = server.scene()
    with socket.create_connection((server.client.base_url.host, server.client.base_url.port)) as connection:
        path = f"/v1/scenes/{scene}/images/{_digest(b'never')}"
        head = f"PUT {path} HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1000\r\n\r\n"
        connection.sendall(head.encode() + b"only this")
        began = time.monotonic()
        connection.settimeout(10)
        answer = connection.recv(4096)
    assert b" 408 " in answer.split(b"\r\n")[0]
    assert time.monotonic() - began < 5
    (part,) = server.settings.uploads.rglob("*.part")
    assert part.read_bytes() == b"only this", "it can be continued"


def test_a_broken_form_keeps_what_has_arrived(gateway: Any, photograph: Photograph) -> None:
    scene, content = gateway.scene(), photograph()
    part = b'--x\r\nContent-Disposition: form-data; name="file"; filename="%s"\r\n\r\n%s\r\n'
    body = part % (b"a.jpg", content) + part % (b"b.jpg", b"half of it")
    answer = gateway.client.post(
        f"/v1/scenes/{scene}/images",
        content=iter([body]),
        headers={"Content-Type": "multipart/form-data; boundary=x"},
    )
    assert answer.status_code == 400
    items = gateway.client.get(f"/v1/scenes/{scene}/images").json()["items"]
    assert [item["name"] for item in items] == ["a.jpg"]


def test_a_full_scene_takes_no_more(open_gateway: Any, photograph: Photograph) -> None:
    gateway = open_gateway(limits={"images_per_scene": 1})
    scene = gateway.scene()
    gateway.put(scene, photograph(1))
    assert gateway.put(scene, photograph(1)).status_code == 200
    assert gateway.put(scene, photograph(2)).status_code == 409


def test_what_the_engine_says_is_told_with_the_names_of_the_senders(
    gateway: Any, photograph: Photograph
) -> None:
    from fvs_service.images.files import file_name, notice_of, with_original_names

    from fvs_schema.findings import Finding, FindingCode
    from fvs_schema.images import Image as SceneImage

    scene = gateway.scene()
    sent = [gateway.put(scene, photograph(seed), name=f"IMG {seed}.jpg").json() for seed in range(2)]
    images = [SceneImage.model_validate_json(json.dumps(image)) for image in sent]
    first, second = map(file_name, images)
    said = f"{first}, {second}.png and 000009-0123456789ab.jpg show nothing. 000001-4."
    told = "IMG 0.jpg, IMG 1.jpg and 000009-0123456789ab.jpg show nothing. 000001-4."
    assert with_original_names(said, images) == told
    found = Finding.of(FindingCode.UNMATCHED, [f"{first}.png", "000009-0123456789ab.jpg"])
    shown = notice_of(found, images, Path("/srv"))
    assert shown.images == (images[0].digest, "000009-0123456789ab.jpg")
    assert shown.message == "Not registered, as no other image matches: IMG 0.jpg, 000009-0123456789ab.jpg."
    crash = Finding.of(FindingCode.QUARANTINED, [second], stage="match", how="no /srv/scenes/x.jpg")
    shown = notice_of(crash, images, Path("/srv"))
    assert shown.message.startswith("IMG 1.jpg is quarantined")
    assert (shown.texts["how"], "/srv" in shown.message) == ("no scenes/x.jpg", False)
