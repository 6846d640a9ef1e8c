"""Missions: views as files for autopilots, ground stations and robots."""

import os
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import Any, TypedDict

from fvs_schema.missions import Autopilot, Drone, Finish, MissionFormat, MissionOptions
from fvs_schema.scenes import AltitudeDatum


class MissionSettings(TypedDict, total=False):
    """How a mission is flown. Altitudes have the scene's datum; heights are above home, or the terrain."""

    first: int
    """Only the first views, this many."""
    home_latitude_deg: float
    home_longitude_deg: float
    home_altitude_m: float
    home_above_takeoff_m: float
    """How much higher home is than where the newest photographs' flight took off; not with an altitude."""
    altitude_datum: AltitudeDatum | str
    """The datum of the file's altitudes; `takeoff` is above home."""
    geoid_height_m: float
    """Height of the geoid above the ellipsoid at the site."""
    transit_height_m: float
    """Fly from view to view at this height."""
    lowest_height_m: float
    highest_height_m: float
    above_ground: bool
    """The file's altitudes are above the ground, whose heights the vehicle must know; needs a terrain."""
    geofence: str
    """A polygon to stay inside: `latitude,longitude;latitude,longitude;…`."""
    leave_out: bool
    """Leave out views that cannot be flown, instead of raising ``InvalidRequestError``."""
    battery_s: float
    """How long the vehicle flies on one battery: cut the mission into parts that begin and end at home."""
    battery_reserve: float
    """The share of the battery with which it lands."""
    part: int
    """The part to write, counted from 1."""
    speed_m_s: float
    acceptance_radius_m: float
    hold_s: float
    """How long to hold still before a photograph."""
    gimbal_lowest_deg: float
    gimbal_highest_deg: float
    takeoff: bool
    finish: Finish | str
    autopilot: Autopilot | str
    drone: Drone | str


def mission_options(format: MissionFormat | str, settings: MissionSettings) -> MissionOptions:  # noqa: A002
    """The options of a mission, whose words may be strings. Raises ``ValueError`` for what does not fit."""
    given: dict[str, Any] = {"format": format, **settings}
    return MissionOptions(**given)


@dataclass(frozen=True)
class MissionFile:
    """A mission as a file, and the ids of the views that are not in it.

    ``reasons`` says why, in the order of ``left_out``; of the first views, if there are many. ``parts`` is
    the number of files that the mission is cut into, of which this is one, with ``views``. ``length_m`` and
    ``duration_s`` are those of the flight, from home and back to it where that is known; None for poses.
    """

    name: str
    media_type: str
    content: bytes
    parts: int = 1
    views: int = 0
    length_m: float | None = None
    duration_s: float | None = None
    left_out: tuple[str, ...] = ()
    reasons: tuple[str, ...] = ()

    def save(self, path: str | PathLike[str] = ".") -> Path:
        """Write the file to ``path``, or under its own name into that folder. Return its path.

        A path that ends with a slash is a folder, which is made if it is missing. Raises ``OSError``.
        """
        text = fspath(path)
        target = Path(text)
        if text.endswith(("/", os.sep)):
            target.mkdir(parents=True, exist_ok=True)
        if target.is_dir():
            target /= self.name
        target.write_bytes(self.content)
        return target
