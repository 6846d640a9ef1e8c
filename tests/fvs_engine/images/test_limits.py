import io
import re
import struct
import subprocess
import sys
import zlib
from typing import Any

import piexif
import pytest
from PIL import Image, TiffImagePlugin

from fvs_engine.images.limits import (
    ImageLimits,
    TooLargeError,
    TooNarrowError,
    TooSmallError,
    UnusableImageError,
)
from fvs_engine.images.pixels import decode

LIMITS = ImageLimits(max_pixels=2_000_000, min_side_px=32, max_decoding_bytes=8_000_000)


def png_of(width: int, height: int, color_type: int = 2, bits: int = 8, rows: int = 1) -> bytes:
    """A PNG that declares its size, and has the first ``rows`` of its pixels."""

    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    channels = {0: 1, 2: 3, 4: 2, 6: 4}[color_type]
    packer = zlib.compressobj(1)
    row = b"\0" + b"\x55" * (channels * bits // 8 * width)
    data = b"".join(packer.compress(row) for _ in range(rows)) + packer.flush()
    header = struct.pack(">IIBBBBB", width, height, bits, color_type, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


@pytest.mark.parametrize(
    ("content", "error", "numbers"),
    [
        (png_of(32, 31), TooSmallError, ("32×31", "32 px")),
        (png_of(32, 1_000_000), TooLargeError, ("32×1000000", "32768 px")),
        (png_of(1_000_000, 32), TooLargeError, ("1000000×32", "32768 px")),
        (png_of(100, 2_001), TooNarrowError, ("100×2001", "20 times")),
        (png_of(1_500, 1_400), TooLargeError, ("1500×1400", "2.1 megapixels", "2 are")),
        (png_of(1_200, 1_000, color_type=6), TooLargeError, ("1200×1000", "10 MB", "8 MB")),
        (png_of(1_200, 1_000, color_type=6, bits=16), TooLargeError, ("10 MB", "8 MB")),
    ],
)
def test_the_header_is_refused_with_its_numbers(
    content: bytes, error: type[UnusableImageError], numbers: tuple[str, ...]
):
    with pytest.raises(error) as caught:
        decode(content, LIMITS)
    assert all(number in caught.value.message for number in numbers), caught.value.message
    assert caught.value.hint


def test_what_is_within_the_limits_is_decoded():
    assert decode(png_of(100, 2_000, rows=2_000), LIMITS).rgb.size == (100, 2_000)
    assert decode(png_of(1_000, 1_000, color_type=6, rows=1_000), LIMITS).rgb.size == (1_000, 1_000)


@pytest.mark.parametrize("image_format", ["PNG", "TIFF", "WEBP", "JPEG", "BMP"])
def test_nothing_is_decoded_before_the_limits_are_checked(image_format: str, monkeypatch: pytest.MonkeyPatch):
    out = io.BytesIO()
    Image.new("RGB", (64, 64)).save(out, image_format)

    def load(_image: Image.Image) -> None:
        raise AssertionError("decoded")

    with Image.open(io.BytesIO(out.getvalue())) as opened:
        monkeypatch.setattr(type(opened), "load", load)
    with pytest.raises(TooLargeError):
        decode(out.getvalue(), ImageLimits(max_pixels=1_000))


IN_ONE_SCAN = ImageLimits(max_decoding_bytes=9_000_000)


def jpeg_of(image: Image.Image, **options: Any) -> bytes:
    out = io.BytesIO()
    image.save(out, options.pop("format", "JPEG"), **options)
    return out.getvalue()


def test_a_progressive_jpeg_counts_its_coefficients():
    with pytest.raises(TooLargeError, match="10 MB"):
        decode(jpeg_of(Image.new("RGB", (1_000, 1_000)), progressive=True), IN_ONE_SCAN)


def test_a_jpeg_with_a_scan_of_each_channel_counts_its_coefficients():
    content = jpeg_of(Image.new("RGB", (1_000, 1_000)))
    scan = content.index(b"\xff\xda")
    alone = content[:scan] + b"\xff\xda\0\x08\1\1\0\0\x3f\0" + content[scan + 14 :]
    with pytest.raises(TooLargeError, match="10 MB"):
        decode(alone, IN_ONE_SCAN)


def test_pictures_inside_and_behind_a_jpeg_are_not_scans_of_it():
    image, small = Image.new("RGB", (1_000, 1_000)), Image.new("RGB", (160, 120))
    preview = jpeg_of(small, progressive=True)
    thumbnail = piexif.dump({"0th": {}, "1st": {}, "thumbnail": jpeg_of(small)})
    behind = jpeg_of(image) + preview
    several = jpeg_of(image, format="MPO", save_all=True, append_images=[image])
    for content in (jpeg_of(image, exif=thumbnail), jpeg_of(image, comment=preview), behind, several):
        assert content.count(b"\xff\xda") > 1
        assert decode(content, IN_ONE_SCAN).rgb.size == (1_000, 1_000)


def test_a_tile_that_is_larger_than_its_image_counts():
    out = io.BytesIO()
    Image.new("L", (64, 64)).save(out, "TIFF", compression="tiff_adobe_deflate")
    with Image.open(out) as image:
        tags = dict(image.tag_v2)
    strip = {
        TiffImagePlugin.STRIPOFFSETS: TiffImagePlugin.TILEOFFSETS,
        TiffImagePlugin.STRIPBYTECOUNTS: TiffImagePlugin.TILEBYTECOUNTS,
    }
    tiled = {strip.get(tag, tag): value for tag, value in tags.items() if tag != TiffImagePlugin.ROWSPERSTRIP}
    tiled |= {TiffImagePlugin.TILEWIDTH: 3_000, TiffImagePlugin.TILELENGTH: 3_000}
    directory = TiffImagePlugin.ImageFileDirectory_v2()
    for tag, value in tiled.items():
        directory[tag] = value
    content = out.getvalue()
    content = content[:4] + struct.pack("<I", len(content)) + content[8:]
    content += directory.tobytes(len(content))
    with pytest.raises(TooLargeError, match="64×64 px and would take 9 MB"):
        decode(content, LIMITS)


_PEAK = """
import resource, sys
from fvs_engine.images.pixels import decode
content = sys.stdin.buffer.read()
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
decode(content)
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024)
"""


@pytest.mark.process
def test_sixteen_bits_with_transparency_take_no_more_than_is_declared():
    """Eight bytes per pixel; before the conversion in bands it took sixteen."""
    content = png_of(4_000, 4_000, color_type=6, bits=16, rows=4_000)
    with pytest.raises(TooLargeError) as caught:
        decode(content, ImageLimits(max_decoding_bytes=1))
    found = re.search(r"(\d+) MB of memory", caught.value.message)
    assert found
    child = subprocess.run([sys.executable, "-c", _PEAK], input=content, capture_output=True, check=True)
    assert int(child.stdout) < 1.25e6 * int(found[1])
