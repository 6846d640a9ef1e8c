"""The first photographs of a scene, of which its first model is made: a circle around the object."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from fvs_client.fly.dialects import Dialect
from fvs_client.fly.errors import VehicleError
from fvs_client.fly.ground import Ground
from fvs_client.fly.items import Command, Frame, MissionItem

_EARTH_RADIUS_M = 6_371_000.0
_TARGETING = 2.0
"""``MAV_MOUNT_MODE_MAVLINK_TARGETING``."""
_STILL_S = 2.0
"""Time for which a vehicle holds still before and after a photograph."""
_TURN_S = 4.0
"""An ArduCopter turns by up to 180° in this time, at its 60°/s by default."""
_FEWEST = 3


@dataclass(frozen=True)
class Survey:
    """``count`` photographs on a circle of ``radius_m`` at ``height_m`` above home, or above the ground.

    They look at a point ``target_height_m`` above home, or the ground, in the middle of the circle.
    ``arc_deg`` is the part of the circle that is flown, from ``start_deg``: a direction from the middle,
    clockwise from north.
    """

    latitude_deg: float
    longitude_deg: float
    radius_m: float
    height_m: float
    target_height_m: float = 0.0
    count: int = 8
    start_deg: float = 0.0
    arc_deg: float = 360.0

    def __post_init__(self) -> None:
        if self.count < _FEWEST or self.radius_m <= 0 or self.height_m <= 0:
            raise VehicleError(
                f"A survey needs {_FEWEST} photographs, a radius and a height above zero.",
                hint="Structure from motion works well with eight photographs that overlap.",
            )

    @property
    def places(self) -> list[tuple[float, float]]:
        """Latitude and longitude of each photograph, in degrees."""
        around_m = _EARTH_RADIUS_M * math.cos(math.radians(self.latitude_deg))
        places = []
        for number in range(self.count):
            direction = math.radians(self._direction_deg(number))
            north_m, east_m = self.radius_m * math.cos(direction), self.radius_m * math.sin(direction)
            latitude_deg = self.latitude_deg + math.degrees(north_m / _EARTH_RADIUS_M)
            longitude_deg = self.longitude_deg + math.degrees(east_m / around_m)
            places.append((latitude_deg, (longitude_deg + 180.0) % 360.0 - 180.0))
        return places

    def heights_m(self, ground: Ground | None = None) -> list[float]:
        """The height of each photograph above home; they are above the ``ground`` where that is known."""
        return [self.height_m + (ground.height_m(place) if ground else 0.0) for place in self.places]

    def climb_m(self, ground: Ground | None = None) -> float:
        """The height above home to take off to."""
        return max(self.height_m, self.heights_m(ground)[0])

    def items(
        self, dialect: Dialect, begins: tuple[float, float] | None = None, ground: Ground | None = None
    ) -> list[MissionItem]:
        """The mission: home as a placeholder, a takeoff, the photographs, and the return home.

        It takes off at the latitude and longitude ``begins``, by default those of the middle: PX4 flies there
        after the climb. Heights are above home, or above the ``ground``.
        """
        home = MissionItem(
            Command.WAYPOINT, Frame.GLOBAL, x=self.latitude_deg, y=self.longitude_deg
        )  # an autopilot has its own
        begins = begins or (self.latitude_deg, self.longitude_deg)
        place = {"x": begins[0], "y": begins[1], "z": self.climb_m(ground)}
        yaw_deg = math.nan if dialect.turns_at_waypoints else 0.0
        takeoff = MissionItem(Command.TAKEOFF, Frame.RELATIVE, (0.0, 0.0, 0.0, yaw_deg), **place)
        target_m = self.target_height_m
        if ground is not None:
            target_m += ground.height_m((self.latitude_deg, self.longitude_deg))
        photographs = (
            item
            for number, (place, height_m) in enumerate(zip(self.places, self.heights_m(ground), strict=True))
            for item in self._photograph(number, (*place, height_m), target_m, dialect)
        )
        return [home, takeoff, *photographs, MissionItem(Command.RETURN_TO_LAUNCH, Frame.MISSION)]

    def _direction_deg(self, number: int) -> float:
        closed = self.arc_deg >= 360.0
        return self.start_deg + number * self.arc_deg / (self.count if closed else self.count - 1)

    def _photograph(
        self, number: int, at: tuple[float, float, float], target_m: float, dialect: Dialect
    ) -> Iterator[MissionItem]:
        yaw_deg = (self._direction_deg(number) + 180.0) % 360.0
        pitch_deg = math.degrees(math.atan2(target_m - at[2], self.radius_m))
        place = {"x": at[0], "y": at[1], "z": at[2]}
        yield MissionItem(Command.MOUNT_CONTROL, Frame.MISSION, (pitch_deg, 0.0, 0.0, 0.0), z=_TARGETING)
        yield MissionItem(Command.WAYPOINT, Frame.RELATIVE, (0.0, 1.0, 0.0, yaw_deg), **place)
        if dialect.turns_at_waypoints:
            # PX4 counts a waypoint's hold while it turns, and goes on when it has turned to within 12°.
            yield _delay(_STILL_S)
            yield MissionItem(Command.IMAGE_START_CAPTURE, Frame.MISSION, (0.0, 0.0, 1.0, float(number + 1)))
        else:
            yield MissionItem(Command.CONDITION_YAW, Frame.MISSION, (yaw_deg, 0.0, 0.0, 0.0))
            yield _delay(_TURN_S + _STILL_S)
            yield MissionItem(Command.DIGICAM_CONTROL, Frame.MISSION, x=1.0)
        yield _delay(_STILL_S)


def _delay(seconds: float) -> MissionItem:
    return MissionItem(Command.DELAY, Frame.MISSION, (seconds, -1.0, -1.0, -1.0))
