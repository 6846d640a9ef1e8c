"""Telling structure from motion what the scene knows of its camera: in the EXIF of images that have none."""

import math
import struct
from pathlib import Path

from PIL import Image

from fvs_engine.atomic_file import replacing
from fvs_engine.images.focal import focal_length_px
from fvs_service.scenes.model import CameraPrior

_EXIF_IFD, _FOCAL_LENGTH_35MM = 0x8769, 0xA405
_FULL_FRAME_DIAGONAL_MM = math.hypot(36.0, 24.0)
_SOI, _SOS, _APP1 = b"\xff\xd8", b"\xff\xda", b"\xff\xe1"
_EXIF = b"Exif\0\0"
_LENGTH = struct.Struct(">H")


def tell_focal_length(file: Path, prior: CameraPrior) -> None:
    """Write the prior's focal length into the EXIF of a JPEG whose own does not tell it; pixels stay.

    It is written as the 35 mm equivalent, a whole number of mm: the first guess of an estimate needs no more.
    """
    with Image.open(file) as image:
        exif = image.getexif()
        width, height, kind = image.width, image.height, image.format
    if kind not in ("JPEG", "MPO") or focal_length_px(exif, width, height) is not None:
        return
    focal_px = prior.focal_length_px * width / prior.width_px
    equivalent_mm = max(1, round(focal_px * _FULL_FRAME_DIAGONAL_MM / math.hypot(width, height)))
    exif.get_ifd(_EXIF_IFD)[_FOCAL_LENGTH_35MM] = equivalent_mm
    content = with_exif(file.read_bytes(), exif.tobytes())
    with replacing(file) as temporary:  # not in place: the bytes are shared with what was uploaded
        temporary.write_bytes(content)


def with_exif(jpeg: bytes, exif: bytes) -> bytes:
    """The same JPEG with other EXIF; ``exif`` begins with its ``Exif`` header."""
    rest, position = [], len(_SOI)
    while jpeg[position : position + 2] != _SOS:
        (length,) = _LENGTH.unpack_from(jpeg, position + 2)
        segment = jpeg[position : position + 2 + length]
        if not (segment.startswith(_APP1) and segment[4:].startswith(_EXIF)):
            rest.append(segment)
        position += len(segment)
    return b"".join((_SOI, _APP1, _LENGTH.pack(len(exif) + 2), exif, *rest, jpeg[position:]))
