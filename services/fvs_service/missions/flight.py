"""A mission as all formats share it: where a vehicle flies, and where it takes photographs."""

from dataclasses import dataclass

from fvs_schema.fence import Place
from fvs_schema.missions import MissionOptions
from fvs_schema.scenes import AltitudeDatum


@dataclass(frozen=True)
class Waypoint:
    """A position with the camera's attitude there: ``name`` is the view to photograph, None to pass.

    The altitude is above the mission's datum; ``above_ground_m`` is the height above the terrain, if that is
    known. Yaw is clockwise from north, in [0, 360); pitch is up.
    """

    name: str | None
    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    yaw_deg: float
    pitch_deg: float
    roll_deg: float = 0.0
    above_ground_m: float | None = None

    @property
    def place(self) -> Place:
        """Its latitude and longitude."""
        return self.latitude_deg, self.longitude_deg


@dataclass(frozen=True)
class Home:
    """Where the vehicle takes off; ``sea_level_m`` is its altitude above sea level, None if not known."""

    latitude_deg: float
    longitude_deg: float
    sea_level_m: float | None


@dataclass(frozen=True)
class Mission:
    """A flight through ``waypoints``, in their order, whose altitudes are above ``datum``.

    ``climb_m`` is the altitude to take off to; None without a known home, or when the vehicle is in the air.
    ``way`` is all of the flight, from home and back to it where that is known, and ``length_m`` and
    ``duration_s`` are its.
    """

    name: str
    datum: AltitudeDatum
    waypoints: tuple[Waypoint, ...]
    home: Home | None
    climb_m: float | None
    options: MissionOptions
    way: tuple[Waypoint, ...]
    length_m: float
    duration_s: float

    @property
    def views(self) -> tuple[Waypoint, ...]:
        """The waypoints where a photograph is taken."""
        return tuple(waypoint for waypoint in self.waypoints if waypoint.name is not None)
