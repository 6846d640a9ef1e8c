import os
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from fvs_engine.errors import InvalidInputError
from fvs_engine.images.catalog import ImageCatalog, catalog_images
from fvs_engine.images.limits import UnusableImageError
from fvs_engine.images.masks import read_mask, reduced_mask
from fvs_engine.images.normalise import normalise_images
from fvs_engine.images.pixels import load_rgb
from fvs_schema.masks import find_mask

SIZE = (64, 48)
LEFT = np.tile(np.arange(64) < 20, (48, 1))
"""A mask whose left part counts."""


def _photograph(path: Path, seed: int = 0, **options: object) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    pixels = np.random.default_rng(seed).integers(0, 256, (SIZE[1], SIZE[0], 3), dtype=np.uint8)
    Image.fromarray(pixels).save(path, **options)
    return path


def _mask(path: Path, counts: np.ndarray = LEFT, **options: object) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(counts.astype(np.uint8) * 255).save(path, **options)
    return path


@pytest.mark.parametrize(
    ("photograph", "mask"),
    [
        ("a.jpg", "masks/a.png"),
        ("a.jpg", "masks/a.jpg.png"),
        ("a.png", "masks/a.png"),
        ("left/a.jpg", "masks/left/a.png"),
        ("left/a.jpg", "left/masks/a.png"),
        ("images/left/a.jpg", "masks/left/a.jpg.png"),
    ],
)
def test_where_masks_are(tmp_path: Path, photograph: str, mask: str) -> None:
    folder = tmp_path / "images"
    _photograph(folder / photograph)
    assert find_mask(folder, photograph) is None
    file = _mask(folder / mask)
    assert find_mask(folder, photograph) == file
    np.testing.assert_array_equal(read_mask(folder, photograph), LEFT)
    catalog = catalog_images(folder)
    assert [(found.name, found.mask, found.masked) for found in catalog.photographs] == [
        (photograph, file, True)
    ]
    assert not catalog.rejected


def test_masks_beside_a_folder_of_images(tmp_path: Path) -> None:
    _photograph(tmp_path / "images" / "left" / "a.jpg")
    file = _mask(tmp_path / "masks" / "left" / "a.jpg.png")
    assert find_mask(tmp_path / "images", "left/a.jpg") == file
    (tmp_path / "images").rename(tmp_path / "photographs")
    assert find_mask(tmp_path / "photographs", "left/a.jpg") is None


def test_the_whole_name_of_one_photograph_is_not_the_stem_of_another(tmp_path: Path) -> None:
    for name in ("a.jpg", "a.jpg.png"):
        _photograph(tmp_path / name)
    file = _mask(tmp_path / "masks" / "a.jpg.png")
    assert find_mask(tmp_path, "a.jpg") == file
    assert find_mask(tmp_path, "a.jpg.png") is None


def test_black_is_left_out_and_grey_is_not(tmp_path: Path) -> None:
    _photograph(tmp_path / "a.jpg")
    (tmp_path / "masks").mkdir()
    labels = Image.fromarray(LEFT.astype(np.uint8) * 3)
    for mode in ("L", "RGB", "1"):
        image = labels.point(lambda value: 255 * (value > 0)) if mode == "1" else labels
        image.convert(mode).save(tmp_path / "masks" / "a.png")
        np.testing.assert_array_equal(read_mask(tmp_path, "a.jpg"), LEFT)
    _mask(tmp_path / "masks" / "a.png", np.ones_like(LEFT))
    assert read_mask(tmp_path, "a.jpg") is None


@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_mask_is_turned_with_its_photograph(tmp_path: Path, orientation: int) -> None:
    exif = Image.Exif()
    exif[0x0112] = orientation
    pixels = np.repeat(LEFT[..., None] * np.uint8(255), 3, axis=2)
    Image.fromarray(pixels).save(tmp_path / "a.png", exif=exif)
    _mask(tmp_path / "masks" / "a.png")
    (photograph,) = catalog_images(tmp_path).photographs
    paths = normalise_images([photograph], tmp_path / "out" / "images")
    upright = np.asarray(Image.open(paths["a.png"]))[..., 0] > 0
    np.testing.assert_array_equal(read_mask(tmp_path / "out" / "images", "a.png"), upright)
    normalise_images([photograph], tmp_path / "stored" / "images", as_stored={"a.png"})
    np.testing.assert_array_equal(read_mask(tmp_path / "stored" / "images", "a.png"), LEFT)
    if orientation > 4:  # one of the upright photograph
        _mask(tmp_path / "masks" / "a.png", upright)
    np.testing.assert_array_equal(read_mask(tmp_path, "a.png", turn=True), upright)
    np.testing.assert_array_equal(read_mask(tmp_path, "a.png"), LEFT)


@pytest.mark.parametrize("suffix", ["png", "tif"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_what_is_transparent_is_turned_with_its_photograph(
    tmp_path: Path, orientation: int, suffix: str
) -> None:
    exif = Image.Exif()
    exif[0x0112] = orientation
    shown = LEFT * np.uint8(255)
    Image.fromarray(np.dstack([shown] * 4)).save(tmp_path / f"a.{suffix}", exif=exif)
    upright = load_rgb(tmp_path / f"a.{suffix}")[..., 0] > 0
    np.testing.assert_array_equal(read_mask(tmp_path, f"a.{suffix}"), upright)
    _mask(tmp_path / "masks" / "a.png")
    np.testing.assert_array_equal(read_mask(tmp_path, f"a.{suffix}"), upright)


def test_what_is_transparent_is_left_out_too(tmp_path: Path) -> None:
    rgba = np.dstack([np.full((48, 64, 3), 200, np.uint8), LEFT * np.uint8(255)])
    rgba[0, 0, 3] = 254
    Image.fromarray(rgba).save(tmp_path / "a.png")
    expected = LEFT.copy()
    expected[0, 0] = False
    np.testing.assert_array_equal(read_mask(tmp_path, "a.png"), expected)
    top = np.zeros_like(LEFT)
    top[:10] = True
    _mask(tmp_path / "masks" / "a.png", top)
    np.testing.assert_array_equal(read_mask(tmp_path, "a.png"), expected & top)
    rgba[..., 3] = 255
    Image.fromarray(rgba).save(tmp_path / "b.png")
    assert read_mask(tmp_path, "b.png") is None


def test_a_mask_belongs_to_a_name_that_is_no_text_too(tmp_path: Path) -> None:
    name = os.fsdecode(b"caf\xe9.jpg")
    _photograph(tmp_path / name)
    _mask(tmp_path / "masks" / f"{name}.png")
    catalog = catalog_images(tmp_path)
    assert not catalog.rejected
    (path,) = normalise_images(catalog.photographs, tmp_path / "out" / "images")
    assert path == "caf%E9.jpg"
    np.testing.assert_array_equal(read_mask(tmp_path / "out" / "images", path), LEFT)
    _mask(tmp_path / "masks" / f"{name}.png", LEFT[:9])
    (rejected,) = catalog_images(tmp_path).rejected
    assert "its mask masks/caf%E9.jpg.png has 64×9 px" in rejected.reason


def test_normalised_photographs_have_normalised_masks(tmp_path: Path) -> None:
    source, images = tmp_path / "source", tmp_path / "out" / "images"
    _photograph(source / "left" / "scan 1.tif", 1)
    _photograph(source / "plain.jpg", 2)
    file = _mask(source / "masks" / "left" / "scan 1.png")
    names = list(normalise_images(catalog_images(source).photographs, images))
    assert names == ["left/scan%201.tif.png", "plain.jpg"]
    written = tmp_path / "out" / "masks" / "left" / "scan%201.tif.png.png"
    assert [path for path in (tmp_path / "out" / "masks").rglob("*") if path.is_file()] == [written]
    np.testing.assert_array_equal(read_mask(images, names[0]), LEFT)
    _mask(file, ~LEFT)
    normalise_images(catalog_images(source).photographs, images)
    np.testing.assert_array_equal(read_mask(images, names[0]), ~LEFT)
    file.unlink()
    normalise_images(catalog_images(source).photographs, images)
    assert not written.exists()


def test_masks_that_are_given_count_where_the_folder_has_none(tmp_path: Path) -> None:
    folder, elsewhere = tmp_path / "images", tmp_path / "segments" / "1.png"
    for seed, name in enumerate("abcd"):
        _photograph(folder / f"{name}.jpg", seed)
    _mask(elsewhere)
    own, inside = _mask(folder / "masks" / "b.png", ~LEFT), _mask(folder / "segments" / "c.png")
    masks = {"images/a.jpg": elsewhere, "images/b.jpg": elsewhere, "images/c.jpg": inside, "d.jpg": None}
    catalog = catalog_images(folder, masks=masks)
    assert not catalog.rejected
    assert [(found.name, found.mask) for found in catalog.photographs] == [
        ("a.jpg", elsewhere),
        ("b.jpg", own),
        ("c.jpg", inside),
        ("d.jpg", None),
    ]
    normalised = tmp_path / "out" / "images"
    normalise_images(catalog.photographs, normalised)
    np.testing.assert_array_equal(read_mask(normalised, "a.jpg"), LEFT)
    np.testing.assert_array_equal(read_mask(normalised, "b.jpg"), ~LEFT)
    np.testing.assert_array_equal(read_mask(normalised, "c.jpg"), LEFT)
    assert read_mask(normalised, "d.jpg") is None


def test_the_mask_of_another_cameras_image_of_the_same_name_is_not_taken(tmp_path: Path) -> None:
    _photograph(tmp_path / "images" / "left" / "a.jpg")
    mask = _mask(tmp_path / "right.png")
    with pytest.raises(InvalidInputError, match=r"right/a\.jpg may mean left/a\.jpg"):
        catalog_images(tmp_path / "images", masks={"left/a.jpg": None, "right/a.jpg": mask})


def _rejected(catalog: ImageCatalog) -> dict[str, str]:
    assert all(image.hint for image in catalog.rejected)
    return {image.name: image.reason for image in catalog.rejected}


def test_masks_that_cannot_be_used(tmp_path: Path) -> None:
    for seed, name in enumerate("abcde"):
        _photograph(tmp_path / f"{name}.jpg", seed)
    _mask(tmp_path / "masks" / "a.png", LEFT[:10, :10])
    _mask(tmp_path / "masks" / "b.png", np.zeros_like(LEFT))
    (tmp_path / "masks" / "c.png").write_bytes(b"\x89PNG\r\n\x1a\n and no more")
    _mask(tmp_path / "masks" / "d.png", LEFT.T)
    header = struct.pack(">4s2I5B", b"IHDR", 30_000, 30_000, 8, 0, 0, 0, 0)  # a mask of 30,000 × 30,000 px
    png = b"\x89PNG\r\n\x1a\n\0\0\0\x0d" + header + struct.pack(">I", zlib.crc32(header))
    (tmp_path / "masks" / "e.png").write_bytes(png + bytes(4) + b"IDAT")
    _mask(tmp_path / "masks" / "nobody.png")
    _mask(tmp_path / "masks" / "d.jpg")
    (tmp_path / "masks" / "classes.txt").touch()
    catalog = catalog_images(tmp_path)
    assert not catalog.photographs
    assert catalog.ignored == ("masks/classes.txt",)
    reasons = _rejected(catalog)
    assert reasons.pop("a.jpg") == "its mask masks/a.png has 10×10 px, the photograph 64×48 px."
    assert reasons.pop("b.jpg") == "its mask leaves out every pixel."
    assert reasons.pop("c.jpg") == "its mask masks/c.png cannot be read as a PNG."
    assert "48×64 px" in reasons.pop("d.jpg")
    assert reasons.pop("e.jpg") == "its mask masks/e.png has more pixels than any photograph."
    assert "the mask of no photograph" in reasons.pop("masks/nobody.png")
    assert "the mask of no photograph" in reasons.pop("masks/d.jpg")
    assert not reasons
    with pytest.raises(UnusableImageError, match="every pixel"):
        read_mask(tmp_path, "b.jpg")


def test_a_reduced_pixel_counts_where_all_of_it_does() -> None:
    mask = np.ones((8, 8), dtype=bool)
    mask[3, 5] = False
    expected = np.ones((4, 4), dtype=bool)
    expected[1, 2] = False
    np.testing.assert_array_equal(reduced_mask(mask, (4, 4)), expected)
