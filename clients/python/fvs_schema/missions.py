"""Requests for missions, and the files that they become."""

from dataclasses import dataclass
from typing import Annotated, Self

from pydantic import ConfigDict, Field, field_validator, model_validator

from fvs_schema.base import Input
from fvs_schema.checks import of_fields, within
from fvs_schema.fence import MOST_CORNERS, Fence, Place
from fvs_schema.names import CandidateId, Digest
from fvs_schema.plans import Stop
from fvs_schema.poses import Pose
from fvs_schema.quantities import WHOLE, Altitude, AsText, Latitude, Longitude, Number, Tilt
from fvs_schema.rankings import RankedCandidate
from fvs_schema.scenes import AltitudeDatum
from fvs_schema.terrain import AnyTerrain
from fvs_schema.words import Word

_MOST_VIA = 200
_Digests = Annotated[
    tuple[Digest, ...], Field(min_length=1, fail_fast=True), within("candidates_per_ranking")
]
_Height = Annotated[Number, Field(ge=-10_000, le=10_000)]
_Geoid = Annotated[Number, Field(ge=-150, le=150)]
_Speed = Annotated[Number, Field(ge=0.1, le=50)]
_Radius = Annotated[Number, Field(ge=0.05, le=100)]
_Battery = Annotated[Number, Field(ge=10, le=100_000)]
_Share = Annotated[Number, Field(ge=0, le=0.9)]
_Hold = Annotated[Number, Field(ge=0, le=600)]


class MissionFormat(Word):
    """What a mission is written for."""

    QGC_PLAN = "qgc-plan"
    """QGroundControl's `.plan`."""
    QGC_WPL = "qgc-wpl"
    """MAVLink waypoints as text, `QGC WPL 110`: Mission Planner, QGroundControl, MAVProxy."""
    DJI_KMZ = "dji-kmz"
    """DJI's WPML in a KMZ: Pilot 2, FlightHub 2, docks."""
    LITCHI_CSV = "litchi-csv"
    """A mission of Litchi, as CSV."""
    MAVSDK = "mavsdk"
    """Items of MAVSDK's plugin `mission`, as JSON: for PX4."""
    KML = "kml"
    """KML 2.2: for Google Earth, with the camera of each view."""
    BRIEFING = "briefing"
    """A picture of the flight, as SVG: to brief a pilot."""
    GEOJSON = "geojson"
    """RFC 7946: for maps."""
    CSV = "csv"
    """A table."""
    ROS_POSEARRAY = "ros-posearray"
    """ROS 2 `geometry_msgs/PoseArray` as JSON: ENU, bodies that look forward (FLU)."""
    ROS_POSESTAMPED = "ros-posestamped"
    """ROS 2 `geometry_msgs/PoseStamped`, a list as JSON."""
    NERFSTUDIO = "nerfstudio"
    """nerfstudio's `transforms.json`."""

    @property
    def of_gimbals(self) -> bool:
        """Whether its missions turn a gimbal, which keeps level: roll cannot be flown."""
        return self in (
            MissionFormat.QGC_PLAN,
            MissionFormat.QGC_WPL,
            MissionFormat.DJI_KMZ,
            MissionFormat.LITCHI_CSV,
            MissionFormat.MAVSDK,
            MissionFormat.KML,
            MissionFormat.BRIEFING,
        )


class Autopilot(Word):
    """The firmware that reads MAVLink commands; the two differ in how they turn and take photographs."""

    ARDUPILOT = "ardupilot"
    PX4 = "px4"


class Drone(Word):
    """An aircraft of DJI with its camera; a Matrice 300 or 350 RTK carries it on the port side."""

    M30 = "m30"
    M30T = "m30t"
    M3E = "m3e"
    M3T = "m3t"
    M3M = "m3m"
    M3D = "m3d"
    M3TD = "m3td"
    M4E = "m4e"
    M4T = "m4t"
    M4D = "m4d"
    M4TD = "m4td"
    M300_H20 = "m300-h20"
    M300_H20T = "m300-h20t"
    M300_H20N = "m300-h20n"
    M300_H30 = "m300-h30"
    M300_H30T = "m300-h30t"
    M350_H20 = "m350-h20"
    M350_H20T = "m350-h20t"
    M350_H20N = "m350-h20n"
    M350_H30 = "m350-h30"
    M350_H30T = "m350-h30t"


class Finish(Word):
    """What a vehicle does after the last view."""

    RETURN = "return"
    """It returns to where it took off."""
    HOLD = "hold"
    """It stays at the last view."""


class MissionOptions(Input):
    """How a mission is flown and written. Altitudes have the scene's datum.

    Heights are above home, and above the ground where the request has a `terrain`.
    """

    format: MissionFormat = Field(description="What the mission is written for.")
    first: Annotated[int | None, WHOLE] = Field(
        default=None, ge=1, le=100_000, description="Fly only the first views, this many; by default all."
    )
    home_latitude_deg: AsText[Latitude] | None = Field(
        default=None, description="Where the vehicle takes off."
    )
    home_longitude_deg: AsText[Longitude] | None = Field(default=None, description="With the latitude.")
    home_altitude_m: AsText[Altitude] | None = Field(
        default=None,
        description="The altitude of the place of takeoff, above the datum of the scene's altitudes. Without "
        "it (or, in a scene above the ellipsoid, without `geoid_height_m`) QGroundControl's files have home "
        "at 0 m, which a vehicle replaces by its own.",
    )
    home_above_takeoff_m: AsText[_Height] | None = Field(
        default=None,
        description="How much higher home is than the place where the flight of the newest photographs took "
        "off, by their relative altitudes: 0 for the same place. Instead of `home_altitude_m`.",
    )
    altitude_datum: AltitudeDatum | None = Field(
        default=None,
        description="The datum of the file's altitudes: `takeoff` is above home. By default above home if "
        "its altitude is known, else the scene's.",
    )
    geoid_height_m: AsText[_Geoid] | None = Field(
        default=None,
        description="The height of the geoid above the ellipsoid at the site, which relates their altitudes.",
    )
    transit_height_m: AsText[_Height] | None = Field(
        default=None,
        description="Fly from view to view at this height above home (with a terrain: above the highest "
        "ground on the way), or that of the views if it is more. By default straight.",
    )
    lowest_height_m: AsText[_Height] | None = Field(
        default=None,
        description="No view is lower above home, and with a terrain nothing is flown lower above the "
        "ground; 0 by default where home's altitude, or the terrain, is known.",
    )
    highest_height_m: AsText[_Height] | None = Field(
        default=None,
        description="Nothing is flown higher above home; with a terrain: above the ground.",
    )
    above_ground: bool = Field(
        default=False,
        description="The file's altitudes are above the ground (`MAV_FRAME_GLOBAL_TERRAIN_ALT`; DJI's "
        "`aboveGroundLevel`), whose heights the vehicle must know; needs a terrain. Otherwise the terrain is "
        "in the altitudes.",
    )
    geofence: Annotated[str, Field(max_length=MOST_CORNERS * 50)] | None = Field(
        default=None,
        description="A polygon to stay inside: `latitude,longitude;latitude,longitude;…`, in degrees.",
    )
    leave_out: bool = Field(
        default=False,
        description="Leave out the views that cannot be flown: `Left-Out` names them, and "
        "`Left-Out-Reasons` says why. Otherwise they are an error.",
    )
    battery_s: AsText[_Battery] | None = Field(
        default=None,
        description="How long the vehicle flies on one battery. The views, in their order, are cut into as "
        "few parts as possible; each begins and ends at home and takes no longer than this without the "
        "reserve, with takeoff, photographs and landing. `Mission-Parts` says how many there are. Needs home "
        "and its altitude.",
    )
    battery_reserve: AsText[_Share] = Field(
        default=0.3, description="The share of the battery with which it lands; with `battery_s`."
    )
    part: Annotated[int, WHOLE] = Field(
        default=1, ge=1, le=100_000, description="The part to write, counted from 1."
    )
    speed_m_s: AsText[_Speed] = Field(default=5.0, description="The speed between views.")
    acceptance_radius_m: AsText[_Radius] = Field(
        default=1.0, description="How near to a waypoint it counts as reached."
    )
    hold_s: AsText[_Hold] = Field(
        default=4.0, description="How long to hold still at a view before the photograph."
    )
    gimbal_lowest_deg: AsText[Tilt] = Field(default=-90.0, description="The lowest pitch of the gimbal.")
    gimbal_highest_deg: AsText[Tilt] = Field(default=30.0, description="The highest pitch of the gimbal.")
    takeoff: bool = Field(
        default=True,
        description="Begin with a takeoff, if home is given; without, the vehicle is in the air.",
    )
    finish: Finish = Field(default=Finish.RETURN, description="What to do after the last view.")
    autopilot: Autopilot = Field(
        default=Autopilot.ARDUPILOT, description="The firmware of the copter that flies MAVLink commands."
    )
    drone: Drone = Field(default=Drone.M3E, description="The aircraft that flies a DJI mission.")

    @field_validator("geofence")
    @classmethod
    def _polygon(cls, value: str | None) -> str | None:
        if value is not None:
            Fence.parse(value)
        return value

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        home = ("home_latitude_deg", "home_longitude_deg")
        missing = [name for name in home if getattr(self, name) is None]
        if len(missing) == 1:
            raise of_fields("home_latitude_deg and home_longitude_deg belong together", *missing)
        if self.home_altitude_m is not None and self.home_above_takeoff_m is not None:
            raise of_fields(
                "give home_altitude_m or home_above_takeoff_m", "home_altitude_m", "home_above_takeoff_m"
            )
        if self.battery_s is not None and missing:
            raise of_fields("parts of a mission begin and end at home, which is missing", *missing)
        if self.battery_s is not None and self.finish is not Finish.RETURN:
            raise of_fields("parts of a mission end at home: the vehicle returns", "finish")
        lowest, highest = self.lowest_height_m, self.highest_height_m
        if lowest is not None and highest is not None and lowest >= highest:
            raise of_fields(
                "lowest_height_m is not below highest_height_m", "lowest_height_m", "highest_height_m"
            )
        if self.gimbal_lowest_deg >= self.gimbal_highest_deg:
            raise of_fields(
                "gimbal_lowest_deg is not below gimbal_highest_deg", "gimbal_lowest_deg", "gimbal_highest_deg"
            )
        return self

    @property
    def home(self) -> Place | None:
        """The latitude and longitude of home."""
        if self.home_latitude_deg is None or self.home_longitude_deg is None:
            return None
        return self.home_latitude_deg, self.home_longitude_deg

    @property
    def fence(self) -> Fence | None:
        """The geofence."""
        return None if self.geofence is None else Fence.parse(self.geofence)


class PlanMissionOptions(MissionOptions):
    """How the mission of a plan is flown and written, and by which vehicle."""

    vehicle: Annotated[int, WHOLE] = Field(
        default=1, ge=1, le=20, description="The vehicle of the plan, counted from 1."
    )


_OF_STOPS_AND_CANDIDATES = Stop.model_fields.keys() | RankedCandidate.model_fields.keys()


class MissionView(Input):
    """A view to photograph. A stop of a plan, or a candidate of a ranking, is one as it is.

    Their other fields, such as `score`, are not used.
    """

    id: CandidateId
    """The id of the candidate or stop."""
    pose: Pose
    """Where its camera is, and where that looks."""
    via: Annotated[tuple[Pose, ...], Field(fail_fast=True), within(_MOST_VIA)] = ()
    """Where to pass on the way to it, in order."""

    @model_validator(mode="before")
    @classmethod
    def _of_a_stop_or_candidate(cls, value: object) -> object:
        if not isinstance(value, dict):
            return value
        unused = _OF_STOPS_AND_CANDIDATES - cls.model_fields.keys()
        return {name: part for name, part in value.items() if name not in unused}


class MissionRequest(Input):
    """Views to photograph, in the order of the flight; or photographs of a snapshot to take again.

    Exactly one of `views`, `images` and `all_images` is given.
    """

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "views": [
                        {
                            "id": "north",
                            "pose": {
                                "latitude_deg": 47.3977,
                                "longitude_deg": 8.5456,
                                "altitude_m": 520.0,
                                "yaw_deg": 180.0,
                                "pitch_deg": -30.0,
                            },
                        }
                    ]
                }
            ]
        }
    )

    views: Annotated[tuple[MissionView, ...], Field(fail_fast=True), within("candidates_per_ranking")] = ()
    """Views with their poses."""
    images: _Digests | None = None
    """Registered images of the snapshot, by digest: from where they were taken, photographs are taken again.
    The digest is the id of the view."""
    all_images: bool = False
    """All registered images of the snapshot, in the order in which they were taken, or arrived where that is
    not known of all."""
    via_home: Annotated[tuple[Pose, ...], Field(fail_fast=True), within(_MOST_VIA)] = ()
    """Where to pass on the way home, in order."""
    snapshot_id: str | None = None
    """The snapshot that has the images, and whose alignment relates poses of the model frame to the world; by
    default the newest."""
    terrain: AnyTerrain | None = None
    """The ground, from which heights are measured; by default from home. Home is then required."""

    @model_validator(mode="after")
    def _different(self) -> Self:
        if len({view.id for view in self.views}) < len(self.views):
            raise of_fields("two views have the same id", "views")
        if self.images is not None and len(set(self.images)) < len(self.images):
            raise of_fields("an image is there twice", "images")
        given = [name for name in ("views", "images", "all_images") if getattr(self, name)]
        if len(given) > 1:
            raise of_fields(f"give only one of {' and '.join(given)}", *given)
        return self


@dataclass(frozen=True)
class MissionFile:
    """A mission as bytes, the ids of the views that are not in it, and why the first of those are not.

    ``parts`` is the number of files that the mission is cut into, of which this is one. ``length_m`` and
    ``duration_s`` are those of the flight, from home and back to it where that is known; None for poses.
    """

    name: str
    media_type: str
    content: bytes
    parts: int
    views: int
    length_m: float | None
    duration_s: float | None
    left_out: tuple[str, ...]
    reasons: tuple[str, ...]
