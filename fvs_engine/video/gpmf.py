"""GoPro's records of a camera, GPMF: positions in nested pieces of key, type, size and value.

Format: https://github.com/gopro/gpmf-parser. Its attitudes are relative to the first one of the
video, not to north, and are not read. Until firmware 1.50 of the HERO8, altitudes are above the
ellipsoid; later ones tell what they are above (GPSA).
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

from fvs_engine.images.metadata import PhotographPriors, plausible_position
from fvs_engine.video.track import Record

_HEADER = struct.Struct(">4sBBH")
_SCALES = {"s": "h", "S": "H", "l": "i", "L": "I"}
"""Types of scales → their format in ``struct``."""
_GPS5 = struct.Struct(">5i")
_GPS9 = struct.Struct(">7i2H")
_GLPI = struct.Struct(">I4i3hH")
_SEA_LEVEL = b"MSLV"
_LARGEST_DILUTION = 5.0
"""Dilution of precision up to which a fix is good; without satellites it is 99.99."""
_YEAR_2000 = datetime(2000, 1, 1, tzinfo=UTC)


def is_gpmf(payload: bytes) -> bool:
    """Whether a packet of a data stream is GPMF."""
    return payload.startswith(b"DEVC")


def read_gpmf(payload: bytes, time_s: float, duration_s: float) -> list[Record]:
    """The positions in one packet, which are spread evenly over its duration.

    Altitudes are as the camera writes them. What is damaged or cut short is left out.
    """
    records = []
    for stream in _streams(payload):
        fixes = [*_gps9(stream), *_gps5(stream), *_karma(stream)]
        for number, fix in enumerate(fixes):
            after_s = duration_s * number / len(fixes)
            position, _ = plausible_position(fix.latitude_deg, fix.longitude_deg)
            if position is not None and fix.dilution <= _LARGEST_DILUTION:
                taken = fix.taken_at
                if taken is not None and b"GPS5" in stream:  # whose time is that of the packet
                    taken += timedelta(seconds=after_s)
                priors = PhotographPriors(*position, fix.altitude_m, captured_at=taken)
                records.append(Record(time_s + after_s, priors, above_ellipsoid=_is_above_ellipsoid(stream)))
    return records


@dataclass(frozen=True)
class _Piece:
    """A value: ``kind`` is the letter of its type, ``size`` the bytes of each of its samples."""

    kind: str
    size: int
    content: bytes


@dataclass(frozen=True)
class _Fix:
    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    dilution: float
    taken_at: datetime | None


def _pieces(content: bytes) -> Iterator[tuple[bytes, _Piece]]:
    offset = 0
    while offset + _HEADER.size <= len(content):
        key, kind, size, repeat = _HEADER.unpack_from(content, offset)
        begin = offset + _HEADER.size
        end = begin + size * repeat
        if end > len(content):
            return
        yield key, _Piece(chr(kind), size, content[begin:end])
        offset = begin + (size * repeat + 3) // 4 * 4


def _streams(content: bytes) -> Iterator[dict[bytes, _Piece]]:
    """The streams of all devices, each as its pieces by key."""
    for device_key, device in _pieces(content):
        for key, stream in _pieces(device.content if device_key == b"DEVC" else b""):
            if key == b"STRM":
                yield dict(_pieces(stream.content))


def _scales(stream: dict[bytes, _Piece], count: int) -> list[float] | None:
    piece = stream.get(b"SCAL")
    if piece is None or piece.kind not in _SCALES:
        return None
    form = struct.Struct(f">{_SCALES[piece.kind]}")
    if piece.size != form.size:
        return None
    scales = [float(scale) for (scale,) in form.iter_unpack(piece.content)]
    scales = scales * count if len(scales) == 1 else scales
    return scales if len(scales) == count and all(scales) else None


def _samples(stream: dict[bytes, _Piece], key: bytes, form: struct.Struct) -> Iterator[list[float]]:
    piece, scales = stream.get(key), _scales(stream, len(form.unpack(bytes(form.size))))
    if piece is None or scales is None or piece.size != form.size:
        return
    for numbers in form.iter_unpack(piece.content):
        yield [number / scale for number, scale in zip(numbers, scales, strict=True)]


def _gps5(stream: dict[bytes, _Piece]) -> Iterator[_Fix]:
    """Latitude, longitude, altitude and two speeds; fix, dilution and time are those of the packet."""
    lock, dilution = _number(stream, b"GPSF", "L"), _number(stream, b"GPSP", "S")
    if lock == 0:
        return
    for latitude, longitude, altitude, _, _ in _samples(stream, b"GPS5", _GPS5):
        yield _Fix(latitude, longitude, altitude, (dilution or 0) / 100.0, _utc(stream.get(b"GPSU")))


def _gps9(stream: dict[bytes, _Piece]) -> Iterator[_Fix]:
    """The same, and days since 2000, seconds since midnight, dilution and fix of each sample."""
    for latitude, longitude, altitude, _, _, days, seconds, dilution, lock in _samples(
        stream, b"GPS9", _GPS9
    ):
        if lock:
            yield _Fix(latitude, longitude, altitude, dilution, _after_2000(days, seconds))


def _karma(stream: dict[bytes, _Piece]) -> Iterator[_Fix]:
    """The positions of GoPro's drone: time, latitude, longitude, altitude above sea level, and others."""
    for _, latitude, longitude, altitude, *_ in _samples(stream, b"GLPI", _GLPI):
        yield _Fix(latitude, longitude, altitude, 0.0, None)


def _is_above_ellipsoid(stream: dict[bytes, _Piece]) -> bool:
    datum = stream.get(b"GPSA")
    return b"GLPI" not in stream and (datum is None or datum.content != _SEA_LEVEL)


def _after_2000(days: float, seconds: float) -> datetime | None:
    try:
        return _YEAR_2000 + timedelta(days=days, seconds=seconds)
    except OverflowError:  # of damaged days
        return None


def _number(stream: dict[bytes, _Piece], key: bytes, kind: str) -> int | None:
    piece, form = stream.get(key), struct.Struct(f">{_SCALES[kind]}")
    if piece is None or piece.kind != kind or len(piece.content) < form.size:
        return None
    number: int = form.unpack_from(piece.content)[0]
    return number


def _utc(piece: _Piece | None) -> datetime | None:
    if piece is None:
        return None
    try:
        return datetime.strptime(piece.content.decode(), "%y%m%d%H%M%S.%f").replace(tzinfo=UTC)
    except ValueError:
        return None
