"""DJI's records of a flight, which its drones write as subtitles: beside a video as .SRT, or inside it.

They have three forms: fields in brackets, ``[latitude: 47.1] [rel_alt: 3.0 abs_alt: 412.0]``, in newer drones
with the angles of the gimbal; ``GPS(longitude,latitude,satellites) BAROMETER:3.0`` with four decimals
(11 m), in the Matrice 300 in another order, ``GPS(latitude,longitude,0.0M)``; and ``RTK (longitude, latitude,
satellites), HOME (…, 103.5m), H 3.0m, G.PRY (pitch, roll, yaw)``.
"""

import re
from collections.abc import Mapping
from datetime import UTC, datetime

from fvs_engine.images.metadata import PhotographPriors, plausible_position
from fvs_engine.video.track import Record

# Names and numbers have limits, so that no text takes time by the square of its length. A number that goes
# on, as one with a decimal comma, is none: its beginning would be a place 100 km away.
_CUE = re.compile(r"(\d{1,3}):(\d\d):(\d\d)[,.](\d{1,3})\s*-->")
_NUMBER = r"[+-]?\d{1,9}(?:\.\d{1,30})?(?![.,]?\d)"
_FIELD = re.compile(rf"\b([a-z_]{{1,20}})\s*:\s*({_NUMBER})")
_TUPLE = re.compile(r"\b(GPS|RTK|HOME|G\.PRY)\s*\(([^()]*)\)")
_HEIGHT_OVER_HOME = re.compile(rf"\bH\s+({_NUMBER})m")
_DATE = re.compile(r"(\d{4})[-.](\d\d)[-.](\d\d)\s+(\d\d):(\d\d):(\d\d)(?:[.,](\d{3}))?")


def read_subtitles(text: str) -> list[Record]:
    """The records in the text of an SRT file; subtitles of other kinds have none."""
    cues = list(_CUE.finditer(text))
    bounds = [*(cue.start() for cue in cues), len(text)]
    records = []
    for cue, end in zip(cues, bounds[1:], strict=True):
        hours, minutes, seconds, fraction = cue.groups()
        time_s = int(hours) * 3600.0 + int(minutes) * 60.0 + int(seconds) + float(f"0.{fraction}")
        priors = read_subtitle(text[cue.end() : end])
        if priors is not None:
            records.append(Record(time_s, priors))
    return records


def read_subtitle(text: str) -> PhotographPriors | None:
    """The priors in one subtitle; None when it has neither a position nor angles.

    The time of day is the drone's own, without a zone.
    """
    fields = {name: float(number) for name, number in reversed(_FIELD.findall(text))}
    tuples = dict(_TUPLE.findall(text))
    latitude, longitude = _coordinates(fields, tuples)
    fix, _ = plausible_position(latitude, longitude)
    pitch, roll, yaw = _angles(fields, tuples)
    if fix is None and pitch is None and yaw is None:
        return None
    return PhotographPriors(
        latitude_deg=fix[0] if fix else None,
        longitude_deg=fix[1] if fix else None,
        altitude_m=_altitude(text, fields, tuples) if fix else None,
        yaw_deg=yaw,
        pitch_deg=pitch,
        roll_deg=roll,
        captured_at=_time_of_day(text),
        height_above_takeoff_m=_height(text, fields),
    )


def _coordinates(fields: Mapping[str, float], tuples: Mapping[str, str]) -> tuple[float | None, float | None]:
    if "latitude" in fields:
        return fields["latitude"], fields.get("longitude", fields.get("longtitude"))  # early firmware's
    parts = tuples.get("RTK", tuples.get("GPS", ""))
    first, second = _numbers(parts, 2)
    return (first, second) if parts.rstrip().endswith("M") else (second, first)


def _altitude(text: str, fields: Mapping[str, float], tuples: Mapping[str, str]) -> float | None:
    if "abs_alt" in fields or "altitude" in fields:
        return fields.get("abs_alt", fields.get("altitude"))
    home, over_home = tuples.get("HOME", "").rstrip(), _HEIGHT_OVER_HOME.search(text)
    _, _, altitude = _numbers(home, 3)
    if altitude is None or over_home is None or not home.endswith("m"):
        return None
    return altitude + float(over_home[1])


def _height(text: str, fields: Mapping[str, float]) -> float | None:
    over_home = _HEIGHT_OVER_HOME.search(text)
    return float(over_home[1]) if over_home else fields.get("rel_alt")


def _angles(fields: Mapping[str, float], tuples: Mapping[str, str]) -> list[float | None]:
    """Pitch, roll and yaw of the gimbal."""
    if "gb_pitch" in fields:
        return [fields.get(f"gb_{name}") for name in ("pitch", "roll", "yaw")]
    return _numbers(tuples.get("G.PRY", ""), 3)


def _numbers(parts: str, count: int) -> list[float | None]:
    """The first numbers in the parts between commas, without their units; all None when some are missing."""
    numbers = [re.match(rf"\s*({_NUMBER})", part) for part in parts.split(",")][:count]
    found = [float(number[1]) for number in numbers if number is not None]
    return [*found] if len(found) == count else [None] * count


def _time_of_day(text: str) -> datetime | None:
    date = _DATE.search(text)
    if date is None:
        return None
    *whole, milliseconds = date.groups()
    try:
        return datetime(*map(int, whole), int(milliseconds or 0) * 1000, tzinfo=UTC)  # type: ignore[arg-type, misc]
    except ValueError:
        return None
