import io
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from fvs_engine.images.pixels import (
    UnusableImageError,
    decode,
    load_rgb,
    reduced_size,
    stored_size,
    turned_as_asked,
    upright_pixel,
)

ORIENTATION = 0x0112


def _encode(image: Image.Image, file_format: str, **options: object) -> bytes:
    buffer = io.BytesIO()
    image.save(buffer, format=file_format, **options)
    return buffer.getvalue()


@pytest.fixture
def corners() -> Image.Image:
    """48×32 px: red top left, green top right, blue bottom left, white bottom right."""
    pixels = np.zeros((32, 48, 3), dtype=np.uint8)
    pixels[:16, :24] = (255, 0, 0)
    pixels[:16, 24:] = (0, 255, 0)
    pixels[16:, :24] = (0, 0, 255)
    pixels[16:, 24:] = (255, 255, 255)
    return Image.fromarray(pixels)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_every_orientation_comes_out_upright(corners: Image.Image, orientation: int) -> None:
    upright_to_stored = {
        1: None,
        2: Image.Transpose.FLIP_LEFT_RIGHT,
        3: Image.Transpose.ROTATE_180,
        4: Image.Transpose.FLIP_TOP_BOTTOM,
        5: Image.Transpose.TRANSPOSE,
        6: Image.Transpose.ROTATE_90,
        7: Image.Transpose.TRANSVERSE,
        8: Image.Transpose.ROTATE_270,
    }
    transposition = upright_to_stored[orientation]
    stored = corners if transposition is None else corners.transpose(transposition)
    exif = Image.Exif()
    exif[ORIENTATION] = orientation
    decoded = decode(_encode(stored, "PNG", exif=exif))
    np.testing.assert_array_equal(np.asarray(decoded.rgb), np.asarray(corners))
    assert decoded.plain == (orientation == 1)


@pytest.mark.parametrize(
    ("largest", "white"), [(65_535, 65_535), (4_096, 65_535), (4_095, 4_095), (9, 4_095)]
)
def test_sixteen_bit_grey_is_scaled_to_the_nearest_of_eight(largest: int, white: int) -> None:
    values = np.array([0, 1, 128, 129, 257, 32_768, 65_535]).clip(max=largest)
    image = Image.fromarray(np.tile(values.astype(np.uint16), (40, 6)))
    for file_format in ("PNG", "TIFF"):
        decoded = decode(_encode(image, file_format))
        expected = [round(value * 255 / white) for value in values]
        assert np.asarray(decoded.rgb)[0, :7, 0].tolist() == expected
        assert not decoded.plain


def test_sixteen_bit_colour_png_is_read_but_not_passed_on_as_it_is() -> None:
    row = b"\0" + struct.pack(">3H", 65535, 32768, 0) * 40

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", 40, 40, 16, 2, 0, 0, 0)
    content = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header)
    content += chunk(b"IDAT", zlib.compress(row * 40)) + chunk(b"IEND", b"")
    decoded = decode(content)
    assert decoded.rgb.getpixel((3, 3)) == (255, 128, 0)
    assert not decoded.plain


def test_alpha_is_composited_on_black() -> None:
    rgba = Image.new("RGBA", (40, 40), (200, 100, 50, 128))
    assert decode(_encode(rgba, "PNG")).rgb.getpixel((5, 5)) == (100, 50, 25)
    hidden = Image.new("RGBA", (40, 40), (255, 255, 255, 0))
    assert decode(_encode(hidden, "PNG")).rgb.getpixel((5, 5)) == (0, 0, 0)


def test_a_transparent_colour_of_a_png_without_alpha_is_black_too(corners: Image.Image) -> None:
    decoded = decode(_encode(corners, "PNG", transparency=(255, 0, 0)))
    assert decoded.rgb.getpixel((2, 2)) == (0, 0, 0)
    assert decoded.rgb.getpixel((40, 2)) == (0, 255, 0)
    assert not decoded.plain


@pytest.mark.parametrize("mode", ["CMYK", "L", "P", "1", "LA", "YCbCr", "LAB"])
def test_every_colour_mode_becomes_rgb(corners: Image.Image, mode: str) -> None:
    source = corners.convert(mode)
    decoded = decode(_encode(source, "TIFF" if mode != "LA" else "PNG"))
    assert decoded.rgb.mode == "RGB"
    assert decoded.rgb.getpixel((40, 25)) == pytest.approx((255, 255, 255), abs=2)


def test_cmyk_jpeg_keeps_its_colours(corners: Image.Image) -> None:
    decoded = decode(_encode(corners.convert("CMYK"), "JPEG", quality=95))
    assert decoded.rgb.getpixel((5, 5)) == pytest.approx((255, 0, 0), abs=12)
    assert not decoded.plain


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "empty"),
        (b"Dear diary, today I took no photographs at all.\n" * 20, "text"),
        (bytes(range(256)) * 8, "not an image"),
        (b"\0\0\0\x18ftypheic" + bytes(500), "HEIC"),
        (b"\0\0\0\x18ftypisom" + bytes(500), "a video"),
        (b"\x1aE\xdf\xa3" + bytes(500), "a video"),
        (b"RIFF\0\1\0\0AVI LIST" + bytes(500), "a video"),
        (b"GIF89a" + bytes(500), "GIF"),
        (bytes(700), "only zero bytes"),
        (b"\x89PNG\r\n\x1a\n" + bytes(500), "PNG whose header is damaged"),
        (b"II*\0" + bytes(500), "TIFF whose header is damaged"),
    ],
)
def test_what_is_no_image_is_refused_with_a_remedy(content: bytes, reason: str) -> None:
    with pytest.raises(UnusableImageError, match=reason) as caught:
        decode(content)
    assert caught.value.hint


@pytest.mark.parametrize(("file_format", "kept"), [("JPEG", 0.6), ("PNG", 0.6), ("TIFF", 0.6), ("WEBP", 0.6)])
def test_a_truncated_file_is_refused(file_format: str, kept: float) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (100, 120, 3), dtype=np.uint8)
    content = _encode(Image.fromarray(noise), file_format)
    with pytest.raises(UnusableImageError, match=r"damaged|not an image"):
        decode(content[: int(len(content) * kept)])


def test_animations_are_refused(corners: Image.Image) -> None:
    content = _encode(corners, "WEBP", save_all=True, append_images=[corners.rotate(90)])
    with pytest.raises(UnusableImageError, match="animation"):
        decode(content)


def _with_frame(jpeg: bytes, at: int, value: int) -> bytes:
    """The JPEG with one byte of its frame header changed: 0 is the precision, 5 the number of channels."""
    start = jpeg.index(b"\xff\xc0") + 4 + at
    return jpeg[:start] + bytes([value]) + jpeg[start + 1 :]


@pytest.mark.parametrize(
    ("at", "value", "kind"), [(0, 12, "3 channels with 12 bits"), (5, 2, "2 channels with 8 bits")]
)
def test_another_kind_of_jpeg_is_refused_by_name(
    corners: Image.Image, at: int, value: int, kind: str
) -> None:
    with pytest.raises(UnusableImageError, match=f"JPEG of {kind}") as caught:
        decode(_with_frame(_encode(corners, "JPEG"), at, value))
    assert "8 bits" in (caught.value.hint or "")


@pytest.mark.parametrize("file_format", ["JPEG", "PNG", "TIFF"])
def test_zeros_before_a_photograph_are_counted(corners: Image.Image, file_format: str) -> None:
    content = bytes(512) + _encode(corners, file_format)
    with pytest.raises(UnusableImageError, match=f"{file_format} behind 512 zero bytes") as caught:
        decode(content)
    assert "tail -c +513" in (caught.value.hint or "")


def test_a_file_that_claims_terabytes_is_refused_before_it_is_decoded() -> None:
    content = bytearray(_encode(Image.new("L", (40, 40)), "PNG"))
    content[16:24] = struct.pack(">II", 200_000, 200_000)
    content[29:33] = struct.pack(">I", zlib.crc32(content[12:29]))
    with pytest.raises(UnusableImageError, match="megapixels"):
        decode(bytes(content))


def test_load_rgb_reduces_and_never_enlarges(corners: Image.Image, tmp_path: Path) -> None:
    path = tmp_path / "corners.png"
    corners.save(path)
    assert load_rgb(path).shape == (32, 48, 3)
    assert load_rgb(path, long_side_px=24).shape == (16, 24, 3)
    assert load_rgb(path, long_side_px=4800).shape == (32, 48, 3)


def test_load_rgb_names_the_file(tmp_path: Path) -> None:
    (tmp_path / "bad.jpg").write_text("hello")
    for name in ("bad.jpg", "missing.jpg"):
        with pytest.raises(UnusableImageError, match=name):
            load_rgb(tmp_path / name)


def test_reduced_size_is_never_zero() -> None:
    assert reduced_size(10_000, 1, 100) == (100, 1)


def test_the_first_picture_of_an_mpo_is_the_photograph(corners: Image.Image) -> None:
    content = _encode(corners, "MPO", save_all=True, append_images=[corners.rotate(180)], quality=95)
    decoded = decode(content)
    assert decoded.format == "MPO"
    assert decoded.rgb.getpixel((5, 5)) == pytest.approx((255, 0, 0), abs=12)


@pytest.mark.parametrize("suffix", ["png", "tif"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_stored_pixels_are_those_before_any_turn(orientation: int, suffix: str, tmp_path: Path) -> None:
    """Pillow turns TIFFs by itself."""
    pixels = np.random.default_rng(0).integers(0, 255, (48, 64, 3), dtype=np.uint8)
    exif = Image.Exif()
    exif[0x0112] = orientation
    path = tmp_path / f"a.{suffix}"
    Image.fromarray(pixels).save(path, exif=exif)
    np.testing.assert_array_equal(load_rgb(path), pixels)
    assert stored_size(path) == (64, 48)
    decoded = decode(path.read_bytes())
    assert decoded.turned is (orientation != 1)
    assert decoded.rgb.size == ((48, 64) if orientation > 4 else (64, 48))


@pytest.mark.parametrize("orientation", range(1, 9))
def test_points_are_turned_as_pixels_are(orientation: int) -> None:
    stored = Image.new("L", (7, 4))
    stored.putpixel((5, 1), 255)
    x, y = upright_pixel(np.array([5.5, 1.5]), stored.size, orientation)
    upright = turned_as_asked(stored, orientation, is_upright=False, turn=True)
    assert upright.getpixel((int(x), int(y))) == 255
    assert (x % 1, y % 1) == (0.5, 0.5)


def test_the_size_of_what_is_no_photograph(tmp_path: Path) -> None:
    huge = bytearray(_encode(Image.new("L", (16, 16)), "PNG"))
    huge[16:24] = (60_000).to_bytes(4) * 2
    huge[29:33] = zlib.crc32(huge[12:29]).to_bytes(4)
    for name, content in (("huge.png", huge), ("a.gif", _encode(Image.new("L", (16, 16)), "GIF"))):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(UnusableImageError, match=f"{name} cannot be read as an image"):
            stored_size(tmp_path / name)
