"""Missions: views as files for autopilots, ground stations and robots."""

import os
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import Any, TypedDict

from fvs_client.models.base import Input, Word
from fvs_client.models.rankings import Pose
from fvs_client.models.scenes import AltitudeDatum


class MissionFormat(Word):
    """What a mission is written for."""

    QGC_PLAN = "qgc-plan"
    """QGroundControl's `.plan`."""
    QGC_WPL = "qgc-wpl"
    """MAVLink waypoints as text, `QGC WPL 110`."""
    DJI_KMZ = "dji-kmz"
    """DJI's WPML in a KMZ."""
    MAVSDK = "mavsdk"
    """MAVSDK's mission items, as JSON."""
    GEOJSON = "geojson"
    CSV = "csv"
    ROS_POSEARRAY = "ros-posearray"
    """ROS 2 `geometry_msgs/PoseArray` as JSON."""
    ROS_POSESTAMPED = "ros-posestamped"
    """ROS 2 `geometry_msgs/PoseStamped`, a list as JSON."""
    NERFSTUDIO = "nerfstudio"
    """nerfstudio's `transforms.json`."""


class Autopilot(Word):
    """The firmware that reads MAVLink commands."""

    ARDUPILOT = "ardupilot"
    PX4 = "px4"


class Drone(Word):
    """An aircraft of DJI, with its own camera."""

    M30 = "m30"
    M30T = "m30t"
    M3E = "m3e"
    M3T = "m3t"
    M3M = "m3m"
    M3D = "m3d"
    M3TD = "m3td"


class Finish(Word):
    """What a vehicle does after the last view."""

    RETURN = "return"
    HOLD = "hold"


class MissionSettings(TypedDict, total=False):
    """How a mission is flown. Heights are above home; altitudes have the scene's datum."""

    first: int
    """Only the first views, this many."""
    home_latitude_deg: float
    home_longitude_deg: float
    home_altitude_m: float
    altitude_datum: AltitudeDatum | str
    """The datum of the file's altitudes; `takeoff` is above home."""
    geoid_height_m: float
    """Height of the geoid above the ellipsoid at the site."""
    transit_height_m: float
    """Fly from view to view at this height."""
    lowest_height_m: float
    highest_height_m: float
    geofence: str
    """A polygon to stay inside: `latitude,longitude;latitude,longitude;…`."""
    leave_out: bool
    """Leave out views that cannot be flown, instead of raising ``InvalidRequestError``."""
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


class MissionOptions(Input):
    """A format and settings; the service has the defaults of those that are None."""

    format: MissionFormat
    first: int | None = None
    home_latitude_deg: float | None = None
    home_longitude_deg: float | None = None
    home_altitude_m: float | None = None
    altitude_datum: AltitudeDatum | None = None
    geoid_height_m: float | None = None
    transit_height_m: float | None = None
    lowest_height_m: float | None = None
    highest_height_m: float | None = None
    geofence: str | None = None
    leave_out: bool | None = None
    speed_m_s: float | None = None
    acceptance_radius_m: float | None = None
    hold_s: float | None = None
    gimbal_lowest_deg: float | None = None
    gimbal_highest_deg: float | None = None
    takeoff: bool | None = None
    finish: Finish | None = None
    autopilot: Autopilot | None = None
    drone: Drone | None = None


def mission_options(format: MissionFormat | str, settings: MissionSettings) -> MissionOptions:  # noqa: A002
    """The options of a mission, whose words may be strings. Raises ``ValueError`` for what does not fit."""
    given: dict[str, Any] = {"format": format, **settings}
    return MissionOptions(**given)


class MissionView(Input):
    """A view to photograph, and where to pass on the way to it."""

    id: str
    pose: Pose
    via: tuple[Pose, ...] = ()


class MissionRequest(Input):
    """Views to photograph, in the order of the flight."""

    views: tuple[MissionView, ...]
    via_home: tuple[Pose, ...] = ()
    snapshot_id: str | None = None


@dataclass(frozen=True)
class MissionFile:
    """A mission as a file, and the ids of the views that are not in it.

    ``reasons`` says why, in the order of ``left_out``; of the first views, if there are many.
    """

    name: str
    media_type: str
    content: bytes
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
