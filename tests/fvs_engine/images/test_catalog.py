import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from fvs_engine.errors import Cancelled, InvalidInputError
from fvs_engine.images.catalog import catalog_images
from fvs_engine.monitor import Monitor, Progress


def _photograph(path: Path, seed: int, size: tuple[int, int] = (64, 48), **options: object) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    pixels = np.random.default_rng(seed).integers(0, 256, (size[1], size[0], 3), dtype=np.uint8)
    Image.fromarray(pixels).save(path, **options)


def test_names_with_spaces_unicode_and_subfolders(tmp_path: Path) -> None:
    names = ["a b.jpg", "flight 1/Überflug 北.png", "z/y/x.JPG"]
    for seed, name in enumerate(names):
        _photograph(tmp_path / name, seed)
    catalog = catalog_images(tmp_path)
    assert [photograph.name for photograph in catalog.photographs] == names
    assert all(photograph.path.is_file() for photograph in catalog.photographs)
    assert not catalog.rejected


def test_names_that_are_not_utf_8_can_be_printed_and_stored(tmp_path: Path) -> None:
    def named(name: bytes) -> Path:
        return tmp_path / os.fsdecode(name)

    for seed, name in enumerate((b"DCIM\xe9/caf\xe9.jpg", b"\xcd\xbc1.jpg", b"caf\xe8.jpg", b"caf%E9.jpg")):
        _photograph(named(name), seed)
    named(b"cut\xe9.jpg").write_bytes(b"\xff\xd8\xff")
    _photograph(named(b"caf\xe9.jpg"), 9)
    catalog = catalog_images(tmp_path)
    assert {photograph.name: os.fsencode(photograph.path.name) for photograph in catalog.photographs} == {
        "DCIM%E9/caf%E9.jpg": b"caf\xe9.jpg",
        "ͼ1.jpg": b"\xcd\xbc1.jpg",
        "caf%E8.jpg": b"caf\xe8.jpg",
        "caf%E9.jpg": b"caf%E9.jpg",
    }
    assert [image.name for image in catalog.rejected] == ["caf%E9.jpg", "cut%E9.jpg"]
    assert "another file has this name" in catalog.rejected[0].reason


def test_one_bad_file_of_each_kind_among_good_ones(tmp_path: Path) -> None:
    for seed in range(3):
        _photograph(tmp_path / f"good{seed}.jpg", seed)
    shutil.copyfile(tmp_path / "good0.jpg", tmp_path / "good0 copy.jpg")
    content = (tmp_path / "good1.jpg").read_bytes()
    (tmp_path / "cut.jpg").write_bytes(content[: len(content) // 2])
    (tmp_path / "letter.jpg").write_text("not a photograph")
    (tmp_path / "empty.png").touch()
    (tmp_path / "phone.HEIC").write_bytes(b"\0\0\0\x18ftypheic")
    (tmp_path / "gone.jpg").symlink_to(tmp_path / "nowhere.jpg")
    _photograph(tmp_path / "thumb.jpg", 9, size=(16, 12))
    Image.new("RGB", (32, 9_000)).save(tmp_path / "ribbon.png")
    (tmp_path / "notes.txt").write_text("not shown")
    (tmp_path / ".hidden.jpg").write_text("not shown")
    (tmp_path / ".thumbnails").mkdir()
    _photograph(tmp_path / ".thumbnails" / "good0.jpg", 0)

    catalog = catalog_images(tmp_path)
    reasons = {image.name: image.reason for image in catalog.rejected}
    assert [photograph.name for photograph in catalog.photographs] == [
        "good0 copy.jpg",
        "good1.jpg",
        "good2.jpg",
    ]
    assert "same file as good0 copy.jpg" in reasons.pop("good0.jpg")
    assert "damaged or cut off" in reasons.pop("cut.jpg")
    assert "text" in reasons.pop("letter.jpg")
    assert "empty" in reasons.pop("empty.png")
    assert "HEIC" in reasons.pop("phone.HEIC")
    assert "No such file" in reasons.pop("gone.jpg")
    assert "16×12 px; the shorter side needs 32 px" in reasons.pop("thumb.jpg")
    assert "32×9000 px; the longer side may be 20 times" in reasons.pop("ribbon.png")
    assert not reasons
    assert all(image.hint for image in catalog.rejected)
    assert catalog.ignored == ("notes.txt",)


def test_size_is_that_of_the_upright_image(tmp_path: Path) -> None:
    exif = Image.Exif()
    exif[0x0112] = 6
    _photograph(tmp_path / "held upright.jpg", 0, size=(64, 48), exif=exif)
    (photograph,) = catalog_images(tmp_path).photographs
    assert (photograph.width_px, photograph.height_px) == (48, 64)
    assert not photograph.plain


@pytest.mark.parametrize(
    ("tags", "expected"),
    [
        ({0xA405: 36}, 36 * 80 / 43.2666),
        ({0x920A: 4.0, 0xA20E: 400.0, 0xA210: 3}, 4.0 * 40.0),
        ({0x920A: 4.0, 0xA20E: 4000.0, 0xA210: 3, 0xA002: 640, 0xA003: 480}, 4.0 * 400.0 / 10),
        ({0x920A: 4.0}, None),
        ({0xA405: 0}, None),
        ({0xA405: 60000}, None),
        ({}, None),
    ],
)
def test_focal_length_in_pixels(tmp_path: Path, tags: dict[int, float], expected: float | None) -> None:
    exif = Image.Exif()
    exif.get_ifd(0x8769).update(tags)
    _photograph(tmp_path / "a.jpg", 0, exif=exif)
    (photograph,) = catalog_images(tmp_path).photographs
    assert photograph.focal_px == (None if expected is None else pytest.approx(expected, rel=1e-4))


def test_a_real_camera_tells_its_focal_length(kermit_dir: Path) -> None:
    catalog = catalog_images(kermit_dir)
    assert len(catalog.photographs) == 11
    # 5.40625 mm at 3106.796 px per inch, from exiftool
    assert catalog.photographs[0].focal_px == pytest.approx(661.26, abs=0.01)


@pytest.mark.parametrize("name", ["missing", "file.jpg"])
def test_what_is_not_a_folder(tmp_path: Path, name: str) -> None:
    _photograph(tmp_path / "file.jpg", 0)
    with pytest.raises(InvalidInputError, match=name):
        catalog_images(tmp_path / name)


def test_progress_and_cancellation(tmp_path: Path) -> None:
    for seed in range(6):
        _photograph(tmp_path / f"{seed}.png", seed)
    seen: list[Progress] = []
    catalog_images(tmp_path, monitor=Monitor(seen.append))
    assert [report.done for report in seen] == [1, 2, 3, 4, 5, 6]
    assert {report.total for report in seen} == {6}

    monitor = Monitor(lambda report: monitor.cancel() if report.done == 2 else None)
    with pytest.raises(Cancelled):
        catalog_images(tmp_path, monitor=monitor)


def test_a_folder_inside_can_be_left_out(tmp_path: Path) -> None:
    _photograph(tmp_path / "a.jpg", 0)
    _photograph(tmp_path / "out" / "images" / "b.jpg", 1)
    catalog = catalog_images(tmp_path, leave_out=tmp_path / "out")
    assert [photograph.name for photograph in catalog.photographs] == ["a.jpg"]
