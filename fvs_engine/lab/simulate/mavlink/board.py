"""What the parts of a simulated autopilot share."""

from collections.abc import Callable
from dataclasses import dataclass

from fvs_engine.lab.simulate.mavlink.dialect import mavlink
from fvs_engine.lab.simulate.mavlink.firmware import Firmware
from fvs_engine.lab.simulate.mavlink.flight_state import LANDED_M, Faults, FlightState, Place
from fvs_engine.lab.simulate.mavlink.parameters import Parameters
from fvs_engine.lab.simulate.vehicle import Vehicle

_TEXT_BYTES = 50


@dataclass(frozen=True)
class Board:
    """The vehicle, its state and parameters, and ``emit``, which sends a message by its name and fields."""

    vehicle: Vehicle
    place: Place
    firmware: Firmware
    state: FlightState
    faults: Faults
    parameters: Parameters
    emit: Callable[..., None]
    say: Callable[[str], None]

    @property
    def landed(self) -> bool:
        """Whether it is on the ground."""
        return bool(self.vehicle.position[2] <= LANDED_M)

    def text(self, text: str, severity: int = mavlink.MAV_SEVERITY_INFO) -> None:
        """Tell people."""
        self.say(text)
        self.emit("statustext", severity, text.encode()[:_TEXT_BYTES])
