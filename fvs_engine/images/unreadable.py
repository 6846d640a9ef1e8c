"""What a file is that cannot be decoded as a photograph, and what to do about it."""

import io
from typing import Any, NamedTuple

from PIL import Image
from PIL.TiffImagePlugin import (
    BITSPERSAMPLE,
    COMPRESSION,
    COMPRESSION_INFO,
    IMAGELENGTH,
    IMAGEWIDTH,
    SAMPLEFORMAT,
    SAMPLESPERPIXEL,
)

from fvs_engine.images.jpeg import START, read_frame

FORMATS = ("JPEG", "PNG", "TIFF", "WEBP", "BMP")
"""MPO, which phones and 3D cameras write, opens as JPEG; its first image is the photograph."""

_BEGINNINGS = {
    START + b"\xff": "JPEG",
    b"\x89PNG\r\n\x1a\n": "PNG",
    b"II*\0": "TIFF",
    b"MM\0*": "TIFF",
    b"II+\0": "TIFF",
    b"MM\0+": "TIFF",
    b"RIFF": "WebP",
    b"BM": "BMP",
}
_NUMBERS = {1: "integers", 2: "signed integers", 3: "floating-point numbers"}

_CONVERT_HINT = f"Convert it to JPEG or PNG, or remove it (formats that work: {', '.join(FORMATS)})."
_COPY_HINT = "Copy it from the camera again, or delete it."
_FRAMES_HINT = (
    "Take frames from it: fvs frames VIDEO. A service takes it under the name of a video, such as a.mp4, "
    "once this image is deleted."
)
_PHOTOGRAPHIC_BRANDS = (b"hei", b"hev", b"mif", b"msf", b"avi")
"""How the brands of HEIC and AVIF begin; other files of their container are videos."""


class Unreadable(NamedTuple):
    """Why a file is not decoded, and the remedy."""

    reason: str
    hint: str


def explain(content: bytes) -> Unreadable:
    """Why the ``content`` of a file, which no decoder took, is not a photograph."""
    zeros = len(content) - len(content.lstrip(b"\0"))
    if zeros == len(content):
        return Unreadable("it has only zero bytes.", _COPY_HINT)
    if _is_video(content[:12]):
        return Unreadable("it is a video.", _FRAMES_HINT)
    kind = _format(content[zeros : zeros + 16])
    if zeros and kind is not None:
        return Unreadable(
            f"it is a {kind} behind {zeros} zero bytes.",
            f"Copy it from the camera again, or remove these bytes: tail -c +{zeros + 1} FILE > NEW_FILE.",
        )
    if kind == "JPEG":
        return _kind_of_jpeg(content)
    if kind == "TIFF":
        return _kind_of_tiff(content)
    if kind is not None:
        return Unreadable(f"it is not an image, or a {kind} whose header is damaged.", _COPY_HINT)
    return Unreadable(_other_format(content[:512]), _CONVERT_HINT)


def _format(head: bytes) -> str | None:
    return next((name for beginning, name in _BEGINNINGS.items() if head.startswith(beginning)), None)


def _is_video(head: bytes) -> bool:
    if head[4:8] == b"ftyp":
        return not head[8:12].startswith(_PHOTOGRAPHIC_BRANDS)
    return head.startswith(b"\x1aE\xdf\xa3") or (head.startswith(b"RIFF") and head[8:12] == b"AVI ")


def _kind_of_jpeg(content: bytes) -> Unreadable:
    frame = read_frame(io.BytesIO(content))
    if frame is None or (frame.bits == 8 and frame.channels in (1, 3, 4)):
        return Unreadable("it is a JPEG whose header is damaged.", _COPY_HINT)
    return Unreadable(
        f"it is a JPEG of {_channels(frame.channels)} with {frame.bits} bits, which is not read here.",
        "Export it with 8 bits per channel, in colour or grey.",
    )


def _kind_of_tiff(content: bytes) -> Unreadable:
    tags = Image.Exif()
    try:
        tags.load(content)
        damaged = IMAGEWIDTH not in tags or IMAGELENGTH not in tags
        channels, compression = tags.get(SAMPLESPERPIXEL, 1), tags.get(COMPRESSION, 1)
        bits, numbers = (_of_all(tags.get(tag, 1)) for tag in (BITSPERSAMPLE, SAMPLEFORMAT))
    except Exception:  # damaged bytes can make the parser raise anything
        damaged = True
    if damaged:
        return Unreadable("it is a TIFF whose header is damaged.", _COPY_HINT)
    if compression not in COMPRESSION_INFO:
        reason = f"it is a TIFF with compression {compression}, which is not read here."
    else:
        kind = f"{_channels(channels)} of {bits}-bit {_NUMBERS.get(numbers, 'other values')}"
        reason = f"it is a TIFF of {kind}, which is not read here."
    return Unreadable(reason, "Export it in colour or grey, with 8 or 16 bits per channel, or as JPEG.")


def _of_all(value: Any) -> int:
    """The value of all channels, which may have one each."""
    return int(max(value) if isinstance(value, tuple) else value)


def _channels(number: int) -> str:
    return f"{number} channel" if number == 1 else f"{number} channels"


def _other_format(head: bytes) -> str:
    if head.startswith((b"GIF87a", b"GIF89a")):
        return "it is a GIF, which is not read here."
    if head[4:8] == b"ftyp":
        return "it is HEIC or AVIF, which is not read here."
    if b"\0" not in head:
        try:
            head[:256].decode("utf-8", errors="strict" if len(head) <= 256 else "ignore")
        except UnicodeDecodeError:
            return "it is not an image."
        if all(byte >= 9 for byte in head):
            return "it is not an image but text."
    return "it is not an image."
