"""Pose priors in an image's metadata: EXIF GPS with its compass, and XMP gimbal angles.

Nothing here raises: metadata is often damaged, and the photograph is still good. Implausible positions are
left out and reported as ``doubtful``: fixes at (0, 0), which receivers write before they have one;
coordinates without their hemisphere; numbers that are not on earth.
"""

import contextlib
import io
import logging
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta, timezone
from typing import Any
from xml.etree.ElementTree import Element, ParseError

import exifread
from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring

_XMP_LIMIT_BYTES = 1 << 20
_XMP_BEGIN, _XMP_END = b"<x:xmpmeta", b"</x:xmpmeta>"
_OFFSET = re.compile(r"^([+-])(\d\d):(\d\d)$")
_NO_FIX_DEG = 1e-6

logging.getLogger("exifread").setLevel(logging.CRITICAL)  # damaged files are expected


@dataclass(frozen=True)
class PhotographPriors:
    """The pose priors of one photograph; every part may be missing.

    ``altitude_m`` is above sea level, as EXIF has it. Angles are the camera's (the gimbal's): yaw
    clockwise from true north, pitch up, roll with the right side down. ``captured_at`` always has a time
    zone; without one in the metadata UTC is assumed. ``doubtful``: the metadata has a position, but an
    implausible one.
    """

    latitude_deg: float | None = None
    longitude_deg: float | None = None
    altitude_m: float | None = None
    yaw_deg: float | None = None
    pitch_deg: float | None = None
    roll_deg: float | None = None
    captured_at: datetime | None = None
    doubtful: bool = False


def read_priors(content: bytes) -> PhotographPriors:
    """Read the metadata of an image file's bytes."""
    exif = _exif(content)
    xmp = _xmp(content)
    fix, exif_doubtful = _position(
        _degrees(exif, "GPS GPSLatitude", "NS"), _degrees(exif, "GPS GPSLongitude", "EW")
    )
    doubtful = exif_doubtful
    if fix is None:
        # DJI writes both spellings, by model and firmware.
        longitude = _number(xmp.get("GpsLongitude", xmp.get("GpsLongtitude")))
        fix, xmp_doubtful = _position(_number(xmp.get("GpsLatitude")), longitude)
        doubtful = fix is None and (exif_doubtful or xmp_doubtful)
    altitude = _altitude(exif)
    if altitude is None:
        altitude = _bounded(_number(xmp.get("AbsoluteAltitude")), -12_000.0, 100_000.0)
    yaw = _bounded(_number(xmp.get("GimbalYawDegree")), -360.0, 360.0)
    return PhotographPriors(
        latitude_deg=fix[0] if fix else None,
        longitude_deg=fix[1] if fix else None,
        altitude_m=altitude if fix else None,
        yaw_deg=_true_direction(exif) if yaw is None else yaw,
        pitch_deg=_bounded(_number(xmp.get("GimbalPitchDegree")), -180.0, 180.0),
        roll_deg=_bounded(_number(xmp.get("GimbalRollDegree")), -180.0, 180.0),
        captured_at=_captured_at(exif),
        doubtful=doubtful,
    )


def _exif(content: bytes) -> Mapping[str, Any]:
    try:
        return dict(exifread.process_file(io.BytesIO(content), details=False, extract_thumbnail=False))
    except Exception:  # damaged bytes can make the parser raise anything
        return {}


def _xmp(content: bytes) -> Mapping[str, str]:
    """Local names of XMP properties → their text, of the first packet."""
    begin = content.find(_XMP_BEGIN)
    end = content.find(_XMP_END, begin)
    if begin < 0 or end < 0 or end - begin > _XMP_LIMIT_BYTES:
        return {}
    try:
        root: Element = fromstring(content[begin : end + len(_XMP_END)], forbid_dtd=True)
    except (ParseError, DefusedXmlException, ValueError):
        return {}
    found: dict[str, str] = {}
    for element in root.iter():
        for name, value in element.attrib.items():
            found.setdefault(name.rpartition("}")[2], value)
        if element.text and element.text.strip():
            found.setdefault(element.tag.rpartition("}")[2], element.text.strip())
    return found


def _degrees(exif: Mapping[str, Any], tag: str, hemispheres: str) -> float | None:
    """Signed degrees; NaN for a coordinate that cannot be used, None for a missing one."""
    if tag not in exif:
        return None
    reference = str(exif.get(f"{tag}Ref", "")).strip().upper()[:1]
    parts = [_ratio(part) for part in getattr(exif[tag], "values", [])]
    if (
        len(parts) != 3
        or any(part is None for part in parts)
        or not reference
        or reference not in hemispheres
    ):
        return math.nan
    degrees, minutes, seconds = (part or 0.0 for part in parts)
    value = degrees + minutes / 60.0 + seconds / 3600.0
    return -value if reference == hemispheres[1] else value


def _position(latitude: float | None, longitude: float | None) -> tuple[tuple[float, float] | None, bool]:
    """The fix, and whether there was an implausible one."""
    if latitude is None and longitude is None:
        return None, False
    if latitude is None or longitude is None or math.isnan(latitude) or math.isnan(longitude):
        return None, True
    if abs(latitude) > 90.0 or abs(longitude) > 180.0:
        return None, True
    if abs(latitude) < _NO_FIX_DEG and abs(longitude) < _NO_FIX_DEG:
        return None, True
    return (latitude, longitude), False


def _altitude(exif: Mapping[str, Any]) -> float | None:
    if "GPS GPSAltitude" not in exif:
        return None
    values = getattr(exif["GPS GPSAltitude"], "values", [])
    altitude = _ratio(values[0]) if values else None
    if altitude is None:
        return None
    reference = getattr(exif.get("GPS GPSAltitudeRef"), "values", [0])
    below = bool(reference) and str(reference[0]) == "1"
    return _bounded(-altitude if below else altitude, -12_000.0, 100_000.0)


def _true_direction(exif: Mapping[str, Any]) -> float | None:
    """The direction of the photograph, clockwise from true north.

    One from magnetic north is left out: it is off by the declination, which may be twenty degrees.
    """
    if str(exif.get("GPS GPSImgDirectionRef", "")).strip().upper()[:1] != "T":
        return None
    values = getattr(exif.get("GPS GPSImgDirection"), "values", [])
    return _bounded(_ratio(values[0]) if values else None, 0.0, 360.0)


def _captured_at(exif: Mapping[str, Any]) -> datetime | None:
    text = str(exif.get("EXIF DateTimeOriginal", "")).strip()
    with contextlib.suppress(ValueError, OverflowError):
        moment = datetime.strptime(text, "%Y:%m:%d %H:%M:%S")
        fraction = str(exif.get("EXIF SubSecTimeOriginal", "")).strip()
        if fraction.isdigit():
            moment += timedelta(seconds=float(f"0.{fraction}"))
        zone: timezone = UTC
        offset = _OFFSET.match(str(exif.get("EXIF OffsetTimeOriginal", "")).strip())
        if offset:
            away = timedelta(hours=int(offset[2]), minutes=int(offset[3]))
            zone = timezone(-away if offset[1] == "-" else away)
        return moment.replace(tzinfo=zone)
    return None


def _ratio(value: Any) -> float | None:
    try:
        number = float(value.num) / float(value.den) if hasattr(value, "num") else float(value)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if math.isfinite(number) else None


def _number(text: str | None) -> float | None:
    """DJI writes ``+47.3`` and, in some models, ``47.3°``-like suffixes; those are not numbers."""
    if text is None:
        return None
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _bounded(value: float | None, lower: float, upper: float) -> float | None:
    return value if value is not None and lower <= value <= upper else None
