"""Telling structure from motion what the scene knows of its camera: in the EXIF of images that have none."""

import math
import struct
import zlib
from pathlib import Path

from PIL import Image

from fvs_engine.files.atomic import replacing
from fvs_engine.images.focal import focal_length_px
from fvs_service.scenes.model import CameraPrior

_EXIF_IFD, _FOCAL_LENGTH_35MM = 0x8769, 0xA405
_FULL_FRAME_DIAGONAL_MM = math.hypot(36.0, 24.0)
_EXIF = b"Exif\0\0"

_SOI, _SOS, _APP1 = b"\xff\xd8", b"\xff\xda", b"\xff\xe1"
_LENGTH = struct.Struct(">H")

_PNG_SIGNATURE, _HEADER, _EXIF_CHUNK = b"\x89PNG\r\n\x1a\n", b"IHDR", b"eXIf"
_WORD = struct.Struct(">I")
_AROUND_DATA_BYTES = 12


def tell_focal_length(file: Path, prior: CameraPrior) -> None:
    """Write the prior's focal length into the EXIF of a JPEG or PNG that does not tell its own.

    Pixels stay. It is written as the 35 mm equivalent, a whole number of mm: the first guess of an estimate
    needs no more.
    """
    with Image.open(file) as image:
        exif = image.getexif()
        width, height, kind = image.width, image.height, image.format
    if focal_length_px(exif, width, height) is not None:
        return
    focal_px = prior.focal_length_px * width / prior.width_px
    equivalent_mm = max(1, round(focal_px * _FULL_FRAME_DIAGONAL_MM / math.hypot(width, height)))
    exif.get_ifd(_EXIF_IFD)[_FOCAL_LENGTH_35MM] = equivalent_mm
    with_exif = _png_with_exif if kind == "PNG" else _jpeg_with_exif
    content = with_exif(file.read_bytes(), exif.tobytes())
    with replacing(file) as temporary:  # not in place: the bytes are shared with what was uploaded
        temporary.write_bytes(content)


def _jpeg_with_exif(jpeg: bytes, exif: bytes) -> bytes:
    """The same JPEG with other EXIF; ``exif`` begins with its ``Exif`` header."""
    rest, position = [], len(_SOI)
    while jpeg[position : position + 2] != _SOS:
        (length,) = _LENGTH.unpack_from(jpeg, position + 2)
        segment = jpeg[position : position + 2 + length]
        if not (segment.startswith(_APP1) and segment[4:].startswith(_EXIF)):
            rest.append(segment)
        position += len(segment)
    return b"".join((_SOI, _APP1, _LENGTH.pack(len(exif) + 2), exif, *rest, jpeg[position:]))


def _png_with_exif(png: bytes, exif: bytes) -> bytes:
    """The same PNG with other EXIF, in the chunk that PNG has for it (third edition, section 11.3.3.6)."""
    data = exif.removeprefix(_EXIF)
    chunk = _WORD.pack(len(data)) + _EXIF_CHUNK + data + _WORD.pack(zlib.crc32(_EXIF_CHUNK + data))
    parts, position = [_PNG_SIGNATURE], len(_PNG_SIGNATURE)
    while position < len(png):
        (length,) = _WORD.unpack_from(png, position)
        kind = png[position + 4 : position + 8]
        if kind != _EXIF_CHUNK:
            parts.append(png[position : position + length + _AROUND_DATA_BYTES])
        if kind == _HEADER:
            parts.append(chunk)
        position += length + _AROUND_DATA_BYTES
    return b"".join(parts)
