"""The home of a vehicle: where it returns to, and from which heights are measured."""

import math
from dataclasses import dataclass

from fvs_client.fly.places import apart_m
from fvs_schema.fence import Place


@dataclass(frozen=True)
class Home:
    """Home as the autopilot has it (``HOME_POSITION``); the altitude is above sea level."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float

    @property
    def place(self) -> Place:
        """Latitude and longitude."""
        return self.latitude_deg, self.longitude_deg

    def moved_m(self, other: "Home") -> float:
        """The distance of another home, with that in altitude."""
        return math.hypot(apart_m(self.place, other.place), other.altitude_m - self.altitude_m)
