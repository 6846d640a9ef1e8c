"""Decoding of photographs to upright 8-bit RGB pixels, for the whole engine.

* Formats: an explicit list; Pillow tries no other.
* Orientation: from EXIF; pixels are turned upright, unless the stored ones are asked for; the tag is dropped.
* 16-bit greyscale is scaled by 255/65535 and rounded, the same for every image, so that exposures stay
  comparable. Where no value is above 4095 it is scaled by 255/4095: cameras of 12 bits write their values
  like this. 16-bit colour is reduced to 8 bits by the decoder, so such 12 bits in it are rejected. 32-bit and
  float images have no white level that all images share: they are rejected.
* Transparency is composited on black, because the rasterisers render on black.
* CMYK, palette, greyscale and bilevel images become RGB.
"""

import io
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, TiffImagePlugin, UnidentifiedImageError
from PIL.ExifTags import Base

from fvs_engine.images.limits import (
    DEFAULT_LIMITS,
    ImageLimits,
    TooLargeError,
    UnusableImageError,
    decoding_bytes,
)
from fvs_engine.images.unreadable import FORMATS, explain
from fvs_schema.quantities import MAX_PIXELS

_TRANSPOSITIONS = {
    2: Image.Transpose.FLIP_LEFT_RIGHT,
    3: Image.Transpose.ROTATE_180,
    4: Image.Transpose.FLIP_TOP_BOTTOM,
    5: Image.Transpose.TRANSPOSE,
    6: Image.Transpose.ROTATE_270,
    7: Image.Transpose.TRANSVERSE,
    8: Image.Transpose.ROTATE_90,
}
LAST_OF_SAME_SIDES = 4
"""The orientations after it exchange width and height."""
_REVERSE = {6: 8, 8: 6}
"""The orientations that are not their own reverse."""
_BAND_ROWS = 256
"""Rows that are converted at a time, so that a conversion needs no second copy of the image."""
_WHITE, _WHITE_OF_12_BITS = 65_535, 4_095
_DARK = _WHITE_OF_12_BITS >> 8
_MIN_IS_WHITE = 0
"""A photometric interpretation of TIFF, and its default in Pillow; the other one of grey is 1."""

# Pillow warns at this size and raises at twice it. Ours raises at once, so the warning is redundant.
Image.MAX_IMAGE_PIXELS = MAX_PIXELS
warnings.filterwarnings("ignore", category=Image.DecompressionBombWarning)
# Pillow's own reader of TIFF without compression takes planes of 16 bits for planes of 8.
TiffImagePlugin.READ_LIBTIFF = True
# It knows this greyscale in the other byte order only.
TiffImagePlugin.OPEN_INFO[TiffImagePlugin.MM, _MIN_IS_WHITE, (1,), 1, (16,), ()] = ("I;16B", "I;16B")


@dataclass(frozen=True, eq=False)
class DecodedImage:
    """A photograph, fully decoded, upright, 8-bit RGB.

    ``plain``: the original file has these very pixels; nothing was converted. ``turned``: its EXIF says that
    the stored pixels are not upright.
    """

    rgb: Image.Image
    format: str
    plain: bool
    turned: bool
    exif: Image.Exif


class _UnreadablePixelsError(Exception):
    """Pillow opens the file, but its pixels are not those of a photograph."""


def decode(content: bytes, limits: ImageLimits = DEFAULT_LIMITS, *, turn: bool = True) -> DecodedImage:
    """Decode the bytes of one image file to the last pixel; ``turn``: upright, as its EXIF says.

    Raises ``UnusableImageError`` when they are not an image of a known format, are damaged or cut off,
    hold an animation, or have no 8- or 16-bit pixels; a subclass of it, before anything is decoded, when
    the header declares what is beyond ``limits``.
    """
    if not content:
        raise UnusableImageError("it is empty (0 bytes).", hint="Copy it from the camera again.")
    try:
        with Image.open(io.BytesIO(content), formats=FORMATS) as image:
            return _decode_opened(image, content, limits, turn)
    except (UnidentifiedImageError, _UnreadablePixelsError) as error:
        reason, hint = explain(content)
        raise UnusableImageError(reason, hint=hint) from error
    except (Image.DecompressionBombError, Image.DecompressionBombWarning) as error:
        raise TooLargeError(
            f"it has more than {limits.max_pixels / 1e6:g} megapixels.", hint="Scale it down first."
        ) from error
    except MemoryError as error:
        raise UnusableImageError(
            "there is not enough memory to decode it.", hint="Scale it down first."
        ) from error
    except UnusableImageError:
        raise
    except Exception as error:  # damaged bytes can make the decoder raise anything
        detail = str(error).rstrip(".") or type(error).__name__
        raise UnusableImageError(
            f"it is damaged or cut off ({detail}).", hint="Copy it from the camera again, or delete it."
        ) from error


def load_rgb(path: Path, long_side_px: int | None = None) -> NDArray[np.uint8]:
    """Read the stored pixels of a photograph, to which its camera belongs: RGB, uint8 [H, W, 3].

    With ``long_side_px`` the longer side is reduced to it (never enlarged), low-pass filtered.
    Raises ``UnusableImageError``, naming the file.
    """
    try:
        image = decode(path.read_bytes(), turn=False).rgb
    except OSError as error:
        raise UnusableImageError(f"{path} cannot be read: {error.strerror}.", path=path) from error
    except UnusableImageError as error:
        raise UnusableImageError(
            f"{path} cannot be used: {error.message}", hint=error.hint, path=path
        ) from error
    if long_side_px is not None:
        size = reduced_size(image.width, image.height, long_side_px)
        if size != image.size:
            image = image.resize(size, Image.Resampling.LANCZOS)
    return np.array(image, dtype=np.uint8)


def stored_size(path: Path) -> tuple[int, int]:
    """Width and height of the stored pixels of an image; raises ``UnusableImageError``, naming the file."""
    try:
        with Image.open(path, formats=FORMATS) as image:
            return size_as_stored(image)
    # Pillow's error for a file that is not an image derives from OSError, but not that for too many pixels.
    except (OSError, Image.DecompressionBombError) as error:
        raise UnusableImageError(
            f"{path} cannot be read as an image.", hint="Replace it, or leave it out of the model.", path=path
        ) from error


def reduced_rgb(image: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    """The image [H, W, 3] at a smaller ``size`` (width, height), low-pass filtered."""
    return np.array(Image.fromarray(image).resize(size, Image.Resampling.LANCZOS), dtype=np.uint8)


def reduced_size(width: int, height: int, long_side_px: int) -> tuple[int, int]:
    """Width and height of an image whose longer side is reduced to ``long_side_px``; never enlarged."""
    scale = min(1.0, long_side_px / max(width, height))
    return max(1, round(width * scale)), max(1, round(height * scale))


def _decode_opened(image: Image.Image, content: bytes, limits: ImageLimits, turn: bool) -> DecodedImage:
    image_format = image.format or ""
    converted = image.mode != "RGB" or image.has_transparency_data
    # Pillow decodes a PNG to read its EXIF, which may follow the pixels.
    orientation = 1 if image_format == "PNG" else orientation_of(image)
    turned = image_format == "PNG" or orientation != 1
    needed = decoding_bytes(image, content, turned=turned, converted=converted)
    limits.require(image.width, image.height, needed)
    if image_format in ("PNG", "WEBP") and getattr(image, "is_animated", False):
        raise UnusableImageError(
            "it is an animation.", hint="Save the frames you want as separate photographs."
        )
    if image.mode in ("I", "F"):
        raise _UnreadablePixelsError
    image.load()
    exif = _exif(image)
    sixteen_bits = _has_sixteen_bits(image, content)
    if image_format != "TIFF":  # which Pillow has turned
        orientation = _orientation(exif)
    plain = (
        image_format in ("JPEG", "MPO", "PNG")
        and image.mode in ("RGB", "L")
        and orientation == 1
        and not image.has_transparency_data
        and not sixteen_bits
    )
    rgb = _to_rgb(image)
    if sixteen_bits:
        _require_range(image, rgb)
    if rgb is not image:
        image.close()
    rgb = turned_as_asked(rgb, orientation, is_upright=image_format == "TIFF", turn=turn)
    return DecodedImage(rgb, image_format, plain, orientation != 1, exif)


def orientation_of(image: Image.Image) -> int:
    """The EXIF orientation of an open image: 1, upright, where it has none."""
    return _orientation(_exif(image))


def size_as_stored(image: Image.Image) -> tuple[int, int]:
    """Width and height of an open image before Pillow turns it, as it turns a TIFF."""
    turned = image.format == "TIFF" and orientation_of(image) > LAST_OF_SAME_SIDES
    return image.size[::-1] if turned else image.size


def turned_as_asked(image: Image.Image, orientation: int, *, is_upright: bool, turn: bool) -> Image.Image:
    """The image upright, as its EXIF ``orientation`` says, if ``turn``; else as it is stored."""
    if orientation == 1 or is_upright == turn:
        return image
    return image.transpose(_TRANSPOSITIONS[orientation if turn else _REVERSE.get(orientation, orientation)])


def _has_sixteen_bits(image: Image.Image, content: bytes) -> bool:
    """Whether a channel has 16 bits in the file, by its header."""
    if image.format == "PNG":
        return content[24] == 16
    return 16 in _tiff_tags(image).get(TiffImagePlugin.BITSPERSAMPLE, ())


def _tiff_tags(image: Image.Image) -> Mapping[int, Any]:
    """The tags of a TIFF; none of another format."""
    return image.tag_v2 if isinstance(image, TiffImagePlugin.TiffImageFile) else {}


def upright_pixel(
    pixel: NDArray[np.float64], stored_size: tuple[int, int], orientation: int
) -> NDArray[np.float64]:
    """Where a point [2] of the stored image of ``stored_size`` (width, height) is in the upright one."""
    (x, y), (width, height) = pixel, stored_size
    right, down = width - x, height - y
    turned = {
        2: (right, y),
        3: (right, down),
        4: (x, down),
        5: (y, x),
        6: (down, x),
        7: (down, right),
        8: (y, right),
    }
    return np.array(turned.get(orientation, (x, y)))


def _orientation(exif: Image.Exif) -> int:
    found = exif.get(Base.Orientation, 1)
    return found if found in _TRANSPOSITIONS else 1


def _exif(image: Image.Image) -> Image.Exif:
    try:
        exif = image.getexif()
        exif.get(Base.Orientation)
    except Exception:  # damaged metadata counts as none; the pixels are still good
        return Image.Exif()
    return exif


def _to_rgb(image: Image.Image) -> Image.Image:
    if image.mode == "RGB" and not image.has_transparency_data:
        return image
    convert = _sixteen_bits_to_rgb(image) if image.mode.startswith("I;16") else _band_to_rgb
    rgb = Image.new("RGB", image.size)
    for top in _bands(image):
        rgb.paste(convert(_band(image, top)), (0, top))
    return rgb


def _bands(image: Image.Image) -> range:
    return range(0, image.height, _BAND_ROWS)


def _band(image: Image.Image, top: int) -> Image.Image:
    return image.crop((0, top, image.width, min(top + _BAND_ROWS, image.height)))


def _sixteen_bits_to_rgb(image: Image.Image) -> Callable[[Image.Image], Image.Image]:
    """What converts bands of a 16-bit greyscale image."""
    largest = max(int(np.asarray(_band(image, top)).max()) for top in _bands(image))
    white = _WHITE if largest > _WHITE_OF_12_BITS else _WHITE_OF_12_BITS
    scaled = (np.minimum(np.arange(_WHITE + 1), white) * 255 + white // 2) // white
    tags = _tiff_tags(image)
    inverted = bool(tags) and not tags.get(TiffImagePlugin.PHOTOMETRIC_INTERPRETATION, _MIN_IS_WHITE)
    grey = (255 - scaled if inverted else scaled).astype(np.uint8)
    return lambda band: Image.fromarray(grey[np.asarray(band, dtype=np.uint16)]).convert("RGB")


def _band_to_rgb(band: Image.Image) -> Image.Image:
    if band.has_transparency_data:
        rgba = band.convert("RGBA")
        return Image.alpha_composite(Image.new("RGBA", rgba.size, (0, 0, 0, 255)), rgba).convert("RGB")
    return band.convert("RGB")


def _require_range(image: Image.Image, rgb: Image.Image) -> None:
    """Raise ``UnusableImageError`` for colours of 12 bits in 16: 4 of them are left, and almost black."""
    if not image.mode.startswith("I;16") and np.asarray(rgb.getextrema()).max() <= _DARK:
        raise UnusableImageError(
            f"its 16-bit colours are below {_WHITE_OF_12_BITS + 1}, as those of 12 bits: almost black.",
            hint="Export it with 8 bits per channel, or with colours up to 65535.",
        )
