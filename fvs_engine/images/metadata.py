"""Pose priors in an image's metadata: EXIF GPS with its compass, and XMP gimbal angles.

Nothing here raises: metadata is often damaged, and the photograph is still good. Implausible positions are
left out and reported as ``doubtful``: fixes at (0, 0), which receivers write before they have one;
coordinates without their hemisphere; numbers that are not on earth.
"""

import contextlib
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta, timezone
from typing import Any, BinaryIO

from PIL import Image
from PIL.ExifTags import GPS, IFD, Base
from PIL.TiffImagePlugin import IFDRational

from fvs_engine.images.embedded import read_embedded

_XMP_PROPERTY = re.compile(
    rb"[\s:<](GpsLatitude|GpsLongt?itude|(?:Absolute|Relative)Altitude|Gimbal(?:Yaw|Pitch|Roll)Degree)"
    rb"(?:\s*=\s*(?:\"([^\"<]{0,99})\"|'([^'<]{0,99})')|\s*>([^<]{0,99})(?=<))"
)
"""A property as an attribute or an element, with any prefix.

It is searched for: DJI's packets and those of programs that change them are often not valid XML, with a bare
``&``, bytes in Latin-1, or roots of all kinds. Values have a bounded length, so that no packet takes long.
"""
_BELOW = frozenset({"1", "3", "\x01", "\x03"})
"""Values of GPSAltitudeRef for altitudes below the reference: 3 is EXIF 3.0's, and is from sea level, too."""
_OFFSET = re.compile(r"^([+-])(\d\d):(\d\d)$")
_NO_FIX_DEG = 1e-6


@dataclass(frozen=True)
class PhotographPriors:
    """The pose priors of one photograph; every part may be missing.

    ``altitude_m`` is above sea level, as EXIF has it. Angles are the camera's (the gimbal's): yaw
    clockwise from true north, pitch up, roll with the right side down. ``captured_at`` always has a time
    zone; without one in the metadata UTC is assumed. ``doubtful``: the metadata has a position, but an
    implausible one. ``height_above_takeoff_m`` is by the vehicle's barometer: its drift is a metre or two,
    while the altitude of the same file may be off by tens of metres.
    """

    latitude_deg: float | None = None
    longitude_deg: float | None = None
    altitude_m: float | None = None
    yaw_deg: float | None = None
    pitch_deg: float | None = None
    roll_deg: float | None = None
    captured_at: datetime | None = None
    doubtful: bool = False
    height_above_takeoff_m: float | None = None


def read_priors(file: BinaryIO) -> PhotographPriors:
    """Read the metadata of an image file."""
    embedded = read_embedded(file)
    exif, gps = _tags(embedded.exif, IFD.Exif), _tags(embedded.exif, IFD.GPSInfo)
    xmp = _xmp(embedded.xmp)
    fix, exif_doubtful = plausible_position(
        _degrees(gps, GPS.GPSLatitudeRef, GPS.GPSLatitude, "NS"),
        _degrees(gps, GPS.GPSLongitudeRef, GPS.GPSLongitude, "EW"),
    )
    doubtful = exif_doubtful
    if fix is None:
        # DJI writes both spellings, by model and firmware.
        longitude = _number(xmp.get("GpsLongitude", xmp.get("GpsLongtitude")))
        fix, xmp_doubtful = plausible_position(_number(xmp.get("GpsLatitude")), longitude)
        doubtful = fix is None and (exif_doubtful or xmp_doubtful)
    altitude = _altitude(gps)
    if altitude is None:
        altitude = _bounded(_number(xmp.get("AbsoluteAltitude")), -12_000.0, 100_000.0)
    yaw = _bounded(_number(xmp.get("GimbalYawDegree")), -360.0, 360.0)
    return PhotographPriors(
        latitude_deg=fix[0] if fix else None,
        longitude_deg=fix[1] if fix else None,
        altitude_m=altitude if fix else None,
        yaw_deg=_true_direction(gps) if yaw is None else yaw,
        pitch_deg=_bounded(_number(xmp.get("GimbalPitchDegree")), -180.0, 180.0),
        roll_deg=_bounded(_number(xmp.get("GimbalRollDegree")), -180.0, 180.0),
        captured_at=_captured_at(exif),
        doubtful=doubtful,
        height_above_takeoff_m=_bounded(_number(xmp.get("RelativeAltitude")), -10_000.0, 10_000.0),
    )


def _tags(exif: Image.Exif, ifd: IFD) -> Mapping[int, Any]:
    try:
        return exif.get_ifd(ifd)
    except Exception:  # damaged bytes can make the parser raise anything
        return {}


def _xmp(packets: Sequence[bytes]) -> Mapping[str, str]:
    """Local names of the properties in packets of XMP → their text; the first one that has text counts."""
    found: dict[str, str] = {}
    for packet in packets:
        for name, *values in _XMP_PROPERTY.findall(packet):
            value = b"".join(values).strip()
            if value:
                found.setdefault(name.decode(), value.decode("ascii", "replace"))
    return found


def _degrees(gps: Mapping[int, Any], reference: GPS, tag: GPS, hemispheres: str) -> float | None:
    """Signed degrees; NaN for a coordinate that cannot be used, None for a missing one.

    Degrees may stand alone, as a decimal number, or with (decimal) minutes, or with minutes and seconds; what
    is not used is missing or 0/0.
    """
    if tag not in gps:
        return None
    side = _text(gps.get(reference)).upper()[:1]
    parts = gps[tag] if isinstance(gps[tag], tuple) else (gps[tag],)
    numbers = [_ratio(part) if i == 0 or not _is_unknown(part) else 0.0 for i, part in enumerate(parts)]
    known = [number for number in numbers if number is not None]
    if not side or side not in hemispheres or not 1 <= len(known) <= 3 or len(known) < len(numbers):
        return math.nan
    value = sum(number / 60.0**i for i, number in enumerate(known))
    return -abs(value) if side == hemispheres[1] else value


def plausible_position(
    latitude: float | None, longitude: float | None
) -> tuple[tuple[float, float] | None, bool]:
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


def _altitude(gps: Mapping[int, Any]) -> float | None:
    altitude = _ratio(gps.get(GPS.GPSAltitude))
    if altitude is None:
        return None
    below = _text(gps.get(GPS.GPSAltitudeRef)) in _BELOW
    return _bounded(-abs(altitude) if below else altitude, -12_000.0, 100_000.0)


def _true_direction(gps: Mapping[int, Any]) -> float | None:
    """The direction of the photograph, clockwise from true north.

    One from magnetic north is left out: it is off by the declination, which may be twenty degrees.
    """
    if _text(gps.get(GPS.GPSImgDirectionRef)).upper()[:1] != "T":
        return None
    return _bounded(_ratio(gps.get(GPS.GPSImgDirection)), 0.0, 360.0)


def _captured_at(exif: Mapping[int, Any]) -> datetime | None:
    text = _text(exif.get(Base.DateTimeOriginal))
    with contextlib.suppress(ValueError, OverflowError):
        moment = datetime.strptime(text, "%Y:%m:%d %H:%M:%S")
        fraction = _text(exif.get(Base.SubsecTimeOriginal))
        if fraction.isdigit():
            moment += timedelta(seconds=float(f"0.{fraction}"))
        zone: timezone = UTC
        offset = _OFFSET.match(_text(exif.get(Base.OffsetTimeOriginal)))
        if offset:
            away = timedelta(hours=int(offset[2]), minutes=int(offset[3]))
            zone = timezone(-away if offset[1] == "-" else away)
        return moment.replace(tzinfo=zone)
    return None


def _ratio(value: Any) -> float | None:
    try:
        number = float(value)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if math.isfinite(number) else None


def _is_unknown(value: Any) -> bool:
    """Whether a rational is 0/0, which is EXIF's way to say that a number is not known."""
    return isinstance(value, IFDRational) and value.numerator == value.denominator == 0


def _text(value: Any) -> str:
    """A tag's text, or its number or byte as such; empty without one."""
    text = value.decode("latin-1") if isinstance(value, bytes) else "" if value is None else str(value)
    return text.strip(" \t\r\n\0")


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
