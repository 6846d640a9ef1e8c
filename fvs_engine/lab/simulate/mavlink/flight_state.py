"""The state of a simulated autopilot that its telemetry reports."""

from dataclasses import dataclass, field
from enum import Enum, auto


class Mode(Enum):
    """Flight modes of an autopilot; each firmware has its own numbers and names for them."""

    MISSION = auto()
    GUIDED = auto()
    """It stays where it is, and waits for targets."""
    LOITER = auto()
    """It stays where it is."""
    BRAKE = auto()
    """It stops at once, and stays."""
    RETURN = auto()
    LAND = auto()


HOLDING = frozenset({Mode.GUIDED, Mode.LOITER, Mode.BRAKE})
"""Modes in which it stays where it is."""


@dataclass
class FlightState:
    """The state of an autopilot."""

    mode: Mode = Mode.LOITER
    armed: bool = False
    item: int = 0
    """The item of the mission that is flown."""
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
