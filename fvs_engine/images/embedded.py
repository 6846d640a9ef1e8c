"""EXIF and XMP in image files, where each format has them; pixels are not decoded."""

import warnings
import zlib
from dataclasses import dataclass
from typing import BinaryIO

from PIL import Image

from fvs_engine.images.jpeg import APP1, segments

_EXIF_IN_JPEG = b"Exif\0\0"
_XMP_IN_JPEG = b"http://ns.adobe.com/xap/1.0/\0"
_XMP_IN_PNG = b"XML:com.adobe.xmp\0"
_PNG = b"\x89PNG\r\n\x1a\n"
_TIFF = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
_XMP_LIMIT_BYTES = 1 << 20
"""The longest packet that is decompressed."""

warnings.filterwarnings("ignore", module="PIL.TiffImagePlugin")  # damaged tags are expected


@dataclass(frozen=True, eq=False)
class EmbeddedMetadata:
    """The EXIF tags of a file, which are read from it when they are asked for, and its packets of XMP."""

    exif: Image.Exif
    xmp: tuple[bytes, ...]


def read_embedded(file: BinaryIO) -> EmbeddedMetadata:
    """The metadata in an image file; what is damaged counts as missing."""
    file.seek(0)
    head = file.read(12)
    exif = Image.Exif()
    try:
        if head.startswith(_TIFF):
            return _in_tiff(file)
        if head.startswith(_PNG):
            block, xmp = _in_png(file)
        elif head.startswith(b"RIFF") and head.endswith(b"WEBP"):
            block, xmp = _in_webp(file)
        else:
            block, xmp = _in_jpeg(file)
    except Exception:  # damaged bytes can make the parsers raise anything
        return EmbeddedMetadata(exif, ())
    try:
        exif.load(block)
    except Exception:
        exif = Image.Exif()
    return EmbeddedMetadata(exif, tuple(xmp))


def _in_jpeg(file: BinaryIO) -> tuple[bytes, list[bytes]]:
    """The EXIF, which is in several segments where it is long, and all packets of XMP."""
    found = [segment.content for segment in segments(file) if segment.marker == APP1]
    exif = [content.removeprefix(_EXIF_IN_JPEG) for content in found if content.startswith(_EXIF_IN_JPEG)]
    xmp = [content.removeprefix(_XMP_IN_JPEG) for content in found if content.startswith(_XMP_IN_JPEG)]
    return b"".join(exif), xmp


def _in_tiff(file: BinaryIO) -> EmbeddedMetadata:
    image = Image.open(file, formats=("TIFF",))
    xmp = image.info.get("xmp")
    return EmbeddedMetadata(image.getexif(), (xmp,) if isinstance(xmp, bytes) else ())


def _in_png(file: BinaryIO) -> tuple[bytes, list[bytes]]:
    exif, xmp = b"", []
    at = len(_PNG)
    while len(head := _read(file, at, 8)) == 8:
        size, name = int.from_bytes(head[:4]), head[4:]
        if name == b"eXIf":
            exif = exif or file.read(size)
        elif name == b"iTXt" and (text := file.read(size)).startswith(_XMP_IN_PNG):
            xmp.append(_text_in_png(text.removeprefix(_XMP_IN_PNG)))
        at += 12 + size
    return exif, xmp


def _text_in_png(chunk: bytes) -> bytes:
    """The text of an ``iTXt`` chunk behind its keyword: two flags, and two strings that end with 0."""
    text = chunk[2:].partition(b"\0")[2].partition(b"\0")[2]
    if chunk[:1] != b"\1":
        return text
    try:
        return zlib.decompressobj().decompress(text, _XMP_LIMIT_BYTES)
    except zlib.error:
        return b""


def _in_webp(file: BinaryIO) -> tuple[bytes, list[bytes]]:
    exif, xmp = b"", []
    at = 12
    while len(head := _read(file, at, 8)) == 8:
        name, size = head[:4], int.from_bytes(head[4:], "little")
        if name == b"EXIF":
            exif = exif or file.read(size)
        elif name == b"XMP ":
            xmp.append(file.read(size))
        at += 8 + size + size % 2
    return exif, xmp


def _read(file: BinaryIO, at: int, size: int) -> bytes:
    file.seek(at)
    return file.read(size)
