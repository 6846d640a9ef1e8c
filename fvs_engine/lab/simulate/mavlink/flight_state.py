"""The state of a simulated autopilot that its parts share."""

from dataclasses import dataclass, field
from enum import Enum, auto

import numpy as np

from fvs_engine.geometry.geodetic import GeodeticPosition, geodetic_from_enu
from fvs_engine.lab.simulate.vehicle import Array, Vehicle

LANDED_M = 0.15
"""It stands on the ground below this height."""


class Mode(Enum):
    """Flight modes of an autopilot; each firmware has its own numbers and names for them."""

    MISSION = auto()
    GUIDED = auto()
    """It stays where it is, and waits for targets."""
    LOITER = auto()
    BRAKE = auto()
    """It stops at once, and stays."""
    RETURN = auto()
    LAND = auto()
    STABILIZE = auto()
    ALT_HOLD = auto()
    POSHOLD = auto()
    ACRO = auto()
    SPORT = auto()
    DRIFT = auto()
    CIRCLE = auto()


@dataclass
class FlightState:
    """The state of an autopilot."""

    mode: Mode
    armed: bool = False
    home: Array | None = None
    """Home by its own estimate [3], ENU; None before the first fix."""
    fixed: bool = False
    """Whether it knows its position."""
    failsafe: bool = False
    """Whether a failsafe acts."""
    station_lost: bool = False
    """Whether PX4 hears no ground station."""
    time_s: float = 0.0
    """Simulated time since it was switched on."""
    photographs: int = 0
    """Number of photographs that were tried."""

    @property
    def clock_ms(self) -> int:
        """The time as messages have it."""
        return round(self.time_s * 1e3)


@dataclass
class Faults:
    """Injected faults, and missing parts."""

    failing_photographs: set[int] = field(default_factory=set)
    """Numbers of photographs, from 0, that fail."""
    refuses_missions: bool = False
    silent: bool = False
    """It receives and sends nothing."""
    no_camera: bool = False
    no_gimbal: bool = False
    """Its camera looks ahead, level."""
    no_fix: bool = False
    """The GPS receiver has no fix."""


@dataclass(frozen=True)
class Place:
    """The vehicle on Earth by its own estimate; ``origin`` is that of its ENU positions."""

    vehicle: Vehicle
    origin: GeodeticPosition
    state: FlightState

    @property
    def home_height_m(self) -> float:
        """Home's height above the origin; 0 before it is known."""
        return 0.0 if self.state.home is None else float(self.state.home[2])

    def home(self) -> GeodeticPosition:
        """Home."""
        home = np.zeros(3) if self.state.home is None else self.state.home
        return geodetic_from_enu(home, self.origin)

    def encoded(self) -> tuple[int, int, int, int]:
        """Its position: degrees times 1e7, mm above sea level, mm above home."""
        believed = self.vehicle.believed
        here = geodetic_from_enu(believed, self.origin)
        above_home_mm = round((float(believed[2]) - self.home_height_m) * 1e3)
        return (
            round(here.latitude_deg * 1e7),
            round(here.longitude_deg * 1e7),
            round(here.altitude_m * 1e3),
            above_home_mm,
        )
