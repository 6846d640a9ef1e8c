"""The state of a simulated autopilot that its telemetry tells."""

from dataclasses import dataclass
from enum import IntEnum


class Mode(IntEnum):
    """ArduCopter's flight modes that a mission needs."""

    AUTO = 3
    GUIDED = 4
    LOITER = 5
    RTL = 6
    LAND = 9
    BRAKE = 17


@dataclass
class FlightState:
    """What an autopilot does."""

    mode: Mode = Mode.LOITER
    armed: bool = False
    item: int = 0
    """Of the mission, which is flown."""
    time_s: float = 0.0
    """Since it was switched on."""
    photographs: int = 0
    """How many were tried."""

    @property
    def clock_ms(self) -> int:
        """The time as messages have it."""
        return round(self.time_s * 1e3)
