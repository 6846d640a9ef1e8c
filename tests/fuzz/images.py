"""Fuzz inspection, EXIF and XMP: ``python tests/fuzz/images.py [--minutes M] [--first N] [TARGET ...]``.

``M`` is processor time per target. The report of each is a line of JSON on stdout; the exit status is 1 when
something was found.
"""

import io
import math
import sys
import zlib
from pathlib import Path

import numpy as np
import piexif
from fvs_service.images.inspection import image_limits, inspect
from PIL import Image

from fvs_schema.service import Limits

sys.path.insert(0, str(Path(__file__).parent))  # for the children, which import this file by its path
from fuzzing import Files, Target, run

from fvs_engine.images.metadata import read_priors

_LIMITS = image_limits(Limits(image_pixels=1_000_000, image_decoding_bytes=20_000_000))
_XMP = b"""<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">
<rdf:Description xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/" drone-dji:GpsLatitude="+48.1234"
drone-dji:GpsLongtitude="+7.5" drone-dji:AbsoluteAltitude="+412.5" drone-dji:GimbalYawDegree="-91.2"
drone-dji:GimbalPitchDegree="-45.0" drone-dji:GimbalRollDegree="+0.0"/></rdf:RDF></x:xmpmeta>"""
_EXIF = piexif.dump(
    {
        "0th": {piexif.ImageIFD.Make: b"DJI", piexif.ImageIFD.Orientation: 6},
        "Exif": {
            piexif.ExifIFD.DateTimeOriginal: b"2026:05:01 12:30:05",
            piexif.ExifIFD.SubSecTimeOriginal: b"12",
            piexif.ExifIFD.OffsetTimeOriginal: b"+02:00",
            piexif.ExifIFD.FocalLength: (88, 10),
            piexif.ExifIFD.FocalLengthIn35mmFilm: 24,
        },
        "GPS": {
            piexif.GPSIFD.GPSLatitudeRef: b"N",
            piexif.GPSIFD.GPSLatitude: ((48, 1), (18, 1), (3051, 100)),
            piexif.GPSIFD.GPSLongitudeRef: b"E",
            piexif.GPSIFD.GPSLongitude: ((7, 1), (15, 1), (0, 1)),
            piexif.GPSIFD.GPSAltitudeRef: 0,
            piexif.GPSIFD.GPSAltitude: (4125, 10),
        },
    }
)


def _image_seeds(_folder: Path) -> list[Files]:
    pixels = np.random.default_rng(1).integers(0, 256, (40, 48, 3), dtype=np.uint8)
    seeds = []
    for image_format, mode, options in (
        ("JPEG", "RGB", {"exif": _EXIF, "xmp": _XMP}),
        ("JPEG", "L", {"progressive": True}),
        ("JPEG", "CMYK", {}),
        ("PNG", "RGB", {"exif": _EXIF}),
        ("PNG", "RGBA", {}),
        ("PNG", "P", {"transparency": 3}),
        ("TIFF", "RGB", {"compression": "tiff_adobe_deflate"}),
        ("TIFF", "L", {}),
        ("WEBP", "RGB", {"exif": _EXIF}),
        ("BMP", "RGB", {}),
    ):
        out = io.BytesIO()
        Image.fromarray(pixels).convert(mode).save(out, image_format, **options)
        seeds.append({"image": out.getvalue()})
    return seeds


def _metadata_seeds(_folder: Path) -> list[Files]:
    """Metadata without pixels, so that most mutations hit it."""
    header = b"\xff\xd8\xff\xe1" + (len(_EXIF) + 2).to_bytes(2, "big") + _EXIF
    named = b"http://ns.adobe.com/xap/1.0/\0" + _XMP
    packet = b"\xff\xe1" + (len(named) + 2).to_bytes(2, "big") + named
    text = b"XML:com.adobe.xmp\0\1\0\0\0" + zlib.compress(_XMP)
    png = b"\x89PNG\r\n\x1a\n" + b"".join(
        len(chunk).to_bytes(4, "big") + name + chunk + bytes(4)
        for name, chunk in ((b"eXIf", _EXIF.removeprefix(b"Exif\0\0")), (b"iTXt", text))
    )
    chunks = (b"EXIF" + len(_EXIF).to_bytes(4, "little") + _EXIF).ljust(
        len(_EXIF) + len(_EXIF) % 2 + 8, b"\0"
    )
    webp = b"RIFF\0\0\0\0WEBP" + chunks + b"XMP " + len(_XMP).to_bytes(4, "little") + _XMP
    jpeg = header + packet + b"\xff\xd9"
    return [{"image": content} for content in (jpeg, b"\xff\xd8" + packet, png, webp)]


def _inspect(folder: Path) -> object:
    found = inspect(folder / "image", _LIMITS)
    _require_finite(found.priors)
    return found


def _read_metadata(folder: Path) -> object:
    found = read_priors(io.BytesIO((folder / "image").read_bytes()))
    _require_finite(found)
    return found


def _require_finite(priors: object) -> None:
    for name, value in vars(priors).items():
        if isinstance(value, float) and not math.isfinite(value):
            raise AssertionError(f"{name} is {value}")


TARGETS = (
    Target("image", _image_seeds, _inspect),
    Target("metadata", _metadata_seeds, _read_metadata),
)


if __name__ == "__main__":
    sys.exit(run(TARGETS, __doc__))
