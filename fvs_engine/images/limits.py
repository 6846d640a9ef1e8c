"""Limits of an image, checked on what its header declares before any pixel is decoded.

Two sizes matter. *Shape*: pycolmap crashes on images that are much longer than wide, because its reduced
copy of them has no width. *Memory*: a file of one megabyte can declare a gigabyte of pixels.
"""

import io

from PIL import Image
from PIL.TiffImagePlugin import BITSPERSAMPLE, TILELENGTH, TILEWIDTH

from fvs_engine.errors import InvalidInputError
from fvs_engine.images.jpeg import keeps_coefficients
from fvs_engine.records import Record
from fvs_schema.quantities import MAX_ASPECT_RATIO, MAX_PIXELS, MAX_SIDE_PX

_STORED_BYTES = {"1": 1, "L": 1, "P": 1, "I;16": 2, "I;16L": 2, "I;16B": 2}
"""Bytes per pixel in Pillow's memory; all other modes take 4, RGB too."""
_RGB_BYTES = 4
_COEFFICIENT_BYTES = 2
_WEBP_BYTES = 16
"""Bytes per pixel that the WebP decoder may take besides the image: an estimate of its frames."""


class UnusableImageError(InvalidInputError):
    """One image cannot be used; ``message`` is the reason, ``hint`` the remedy."""


class TooLargeError(UnusableImageError):
    """It has too many pixels, or would take too much memory."""


class TooSmallError(UnusableImageError):
    """It has too few pixels."""


class TooNarrowError(UnusableImageError):
    """One side is too long for the other."""


class ImageLimits(Record):
    """The largest and the smallest image that is decoded.

    ``max_decoding_bytes`` bounds ``decoding_bytes``.
    """

    max_pixels: int = MAX_PIXELS
    min_side_px: int = 1
    max_decoding_bytes: int = 10 * MAX_PIXELS

    def require(self, width_px: int, height_px: int, needed_bytes: int) -> None:
        """Raise ``UnusableImageError`` if an image of this size and memory exceeds a limit."""
        size = f"{width_px}×{height_px} px"
        short, long = sorted((width_px, height_px))
        if short < self.min_side_px:
            raise TooSmallError(
                f"it has {size}; the shorter side needs {self.min_side_px} px.",
                hint="Use the original photograph.",
            )
        if long > MAX_SIDE_PX:
            raise TooLargeError(
                f"it has {size}; no side may be longer than {MAX_SIDE_PX} px.",
                hint="Scale it down, or cut it into parts that overlap.",
            )
        if long > MAX_ASPECT_RATIO * short:
            raise TooNarrowError(
                f"it has {size}; the longer side may be {MAX_ASPECT_RATIO:g} times the shorter one.",
                hint="Use the photographs that it was made of, or cut it into parts that overlap.",
            )
        if width_px * height_px > self.max_pixels:
            raise TooLargeError(
                f"it has {size}, {width_px * height_px / 1e6:.4g} megapixels; "
                f"{self.max_pixels / 1e6:g} are allowed.",
                hint="Scale it down first.",
            )
        if needed_bytes > self.max_decoding_bytes:
            raise TooLargeError(
                f"it has {size} and would take {needed_bytes / 1e6:.0f} MB of memory to decode; "
                f"{self.max_decoding_bytes / 1e6:.0f} MB are allowed.",
                hint="Save it as a JPEG that is not progressive, or scale it down.",
            )


DEFAULT_LIMITS = ImageLimits()


def decoding_bytes(image: Image.Image, content: bytes, *, turned: bool, converted: bool) -> int:
    """Memory that ``pixels.decode`` takes at its peak, apart from the file's ``content``.

    ``image`` is open and not decoded yet; ``converted``: its pixels are converted to RGB; ``turned``: they
    are then turned upright.
    """
    pixels = image.width * image.height
    stored = _STORED_BYTES.get(image.mode, 4) * pixels
    loading = _decoder_bytes(image, content) + stored
    converting = stored + _RGB_BYTES * pixels if converted else 0
    turning = 2 * _RGB_BYTES * pixels if turned else 0
    return max(loading, converting, turning)


def _decoder_bytes(image: Image.Image, content: bytes) -> int:
    """Bytes that the format's decoder takes besides the image."""
    pixels = image.width * image.height
    match image.format:
        case "JPEG" | "MPO" if keeps_coefficients(io.BytesIO(content)):
            return _COEFFICIENT_BYTES * len(image.getbands()) * pixels
        case "WEBP":
            return _WEBP_BYTES * pixels
        case "TIFF":  # a strip may be the whole image, as the file stores it, and a tile larger than it
            tags = getattr(image, "tag_v2", {})
            bits = sum(map(int, tags.get(BITSPERSAMPLE, (8,))))
            return max(pixels, int(tags.get(TILEWIDTH, 0)) * int(tags.get(TILELENGTH, 0))) * -(-bits // 8)
        case _:
            return 0
