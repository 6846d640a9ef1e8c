import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from fvs_engine.errors import Cancelled
from fvs_engine.images.catalog import catalog_images
from fvs_engine.images.metadata import read_priors
from fvs_engine.images.normalise import normalise_images
from fvs_engine.images.pixels import decode, load_rgb
from fvs_engine.monitor import Monitor


def _pixels(seed: int, height: int = 48, width: int = 64) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)


def test_a_plain_photograph_is_linked_not_written_anew(kermit_dir: Path, tmp_path: Path) -> None:
    catalog = catalog_images(kermit_dir)
    paths = normalise_images(catalog.photographs, tmp_path / "images")
    assert list(paths) == [photograph.name for photograph in catalog.photographs]
    for photograph in catalog.photographs:
        assert paths[photograph.name].read_bytes() == photograph.path.read_bytes()


def test_every_other_kind_becomes_upright_eight_bit(tmp_path: Path) -> None:
    source = tmp_path / "source"
    source.mkdir()
    exif = Image.Exif()
    exif[0x0112] = 6
    exif.get_ifd(0x8769)[0xA405] = 28
    packet = b'<rdf:Description drone-dji:GimbalYawDegree="-12.5"/>'
    Image.fromarray(_pixels(0)).save(source / "held.jpg", exif=exif, xmp=packet)
    Image.fromarray(_pixels(1)).convert("CMYK").save(source / "print.jpg")
    Image.fromarray(_pixels(2)).convert("RGBA").save(source / "scan.tif", tiffinfo={700: packet})
    Image.fromarray(_pixels(3)).save(source / "scan.png")
    Image.fromarray(_pixels(4)[..., 0].astype(np.uint16) * 257).save(source / "deep.png")
    Image.fromarray(_pixels(5)).save(source / "wrong suffix.jpg", format="PNG")

    catalog = catalog_images(source)
    paths = normalise_images(catalog.photographs, tmp_path / "images")
    assert set(paths) == {
        "deep.png",
        "held.jpg",
        "print.jpg",
        "scan.png",
        "scan.tif.png",
        "wrong%20suffix.jpg.png",
    }
    for photograph, path in zip(catalog.photographs, paths.values(), strict=True):
        expected = np.asarray(decode(photograph.path.read_bytes()).rgb)
        with Image.open(path) as image:
            assert image.format == {".jpg": "JPEG", ".png": "PNG"}[path.suffix]
            assert image.mode == "RGB"
            assert image.size == (photograph.width_px, photograph.height_px)
            assert image.getexif().get(0x0112, 1) == 1
            error = np.abs(np.asarray(image).astype(int) - expected.astype(int)).mean()
        assert error == 0 if path.suffix == ".png" else error < 3
    with Image.open(paths["held.jpg"]) as image:
        assert image.getexif().get_ifd(0x8769)[0xA405] == 28
    for name in ("held.jpg", "scan.tif.png"):
        with paths[name].open("rb") as file:
            assert read_priors(file).yaw_deg == -12.5


def test_names_that_colmap_could_not_write_in_a_list_are_escaped(tmp_path: Path) -> None:
    source = tmp_path / "source"
    (source / "day 1").mkdir(parents=True)
    names = ["#1.png", "a b.png", "a%20b.png", "day 1/DJI (2).png"]
    for seed, name in enumerate(names):
        Image.fromarray(_pixels(seed)).save(source / name)
    photographs = catalog_images(source).photographs
    assert [photograph.name for photograph in photographs] == names
    paths = normalise_images(photographs, tmp_path / "images")
    assert list(paths) == ["%231.png", "a%20b.png", "a%2520b.png", "day%201/DJI%20(2).png"]
    for seed, path in enumerate(paths.values()):
        np.testing.assert_array_equal(load_rgb(path), _pixels(seed))


def test_bytes_that_are_not_utf_8_are_escaped_once(tmp_path: Path) -> None:
    names = [b"caf\xe9 1.png", b"caf%E8.png", b"\xcd\xbc.png", b"DCIM\xe9/a.png"]
    for seed, name in enumerate(names):
        file = tmp_path / os.fsdecode(name)
        file.parent.mkdir(exist_ok=True)
        Image.new("RGB", (40, 40), (seed, 0, 0)).save(file)
    paths = normalise_images(catalog_images(tmp_path).photographs, tmp_path / "out")
    assert set(paths) == {"caf%E9%201.png", "caf%25E8.png", "\u037c.png", "DCIM%E9/a.png"}
    assert all(path.is_file() for path in paths.values())


def test_an_interrupted_call_can_be_repeated(tmp_path: Path) -> None:
    source = tmp_path / "source"
    source.mkdir()
    for seed in range(5):
        Image.fromarray(_pixels(seed)).convert("RGBA").save(source / f"{seed}.png")
    catalog = catalog_images(source)
    monitor = Monitor(lambda report: monitor.cancel() if report.done == 2 else None)
    with pytest.raises(Cancelled):
        normalise_images(catalog.photographs, tmp_path / "images", monitor=monitor, threads=1)
    paths = normalise_images(catalog.photographs, tmp_path / "images")
    assert sorted(path.name for path in (tmp_path / "images").iterdir()) == sorted(paths)
    assert all(load_rgb(path).shape == (48, 64, 3) for path in paths.values())


def test_photographs_whose_cameras_are_given_keep_their_stored_pixels(tmp_path: Path) -> None:
    exif = Image.Exif()
    exif[0x0112] = 6
    for seed, name in enumerate(("stored.png", "upright.png")):
        Image.fromarray(_pixels(seed)).save(tmp_path / name, exif=exif)
    photographs = catalog_images(tmp_path).photographs
    assert [(each.turned, each.plain) for each in photographs] == [(True, False)] * 2
    paths = normalise_images(photographs, tmp_path / "images", as_stored={"stored.png"})
    np.testing.assert_array_equal(load_rgb(paths["stored.png"]), _pixels(0))
    np.testing.assert_array_equal(load_rgb(paths["upright.png"]), np.rot90(_pixels(1), -1))
    for path in paths.values():
        with Image.open(path) as image:
            assert image.getexif().get(0x0112, 1) == 1
