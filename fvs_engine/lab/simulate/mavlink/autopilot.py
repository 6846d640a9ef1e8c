"""The autopilot of a simulated vehicle: modes, missions and commands as in ArduCopter or PX4, over MAVLink.

What drives it could drive a real vehicle: https://mavlink.io/en/services/mission.html,
https://ardupilot.org/copter/docs/common-mavlink-mission-command-messages-mav_cmd.html.
"""

import contextlib
import time
from collections.abc import Callable
from typing import Any

from fvs_engine.choices import Firmware as FirmwareName
from fvs_engine.geometry.geodetic import GeodeticPosition
from fvs_engine.lab.simulate.mavlink.camera import Camera
from fvs_engine.lab.simulate.mavlink.commands import Commands
from fvs_engine.lab.simulate.mavlink.dialect import mavlink, mavutil
from fvs_engine.lab.simulate.mavlink.firmware import FIRMWARES
from fvs_engine.lab.simulate.mavlink.flight_state import Faults, FlightState, Mode
from fvs_engine.lab.simulate.mavlink.gimbal import Gimbal
from fvs_engine.lab.simulate.mavlink.mission import Item
from fvs_engine.lab.simulate.mavlink.mission_protocol import MissionProtocol
from fvs_engine.lab.simulate.mavlink.parameters import Parameters
from fvs_engine.lab.simulate.mavlink.pilot import Pilot
from fvs_engine.lab.simulate.mavlink.telemetry import Telemetry
from fvs_engine.lab.simulate.vehicle import Vehicle
from fvs_engine.lab.simulate.vehicle_camera import VehicleCamera

_TICK_S = 0.02
_SYSTEM = 1


class Autopilot:
    """Flies ``vehicle`` by commands of ground stations on the ``link``, in the way of a ``firmware``.

    ``link`` is pymavlink's name of our end, such as ``tcpin:127.0.0.1:5760``. ``origin`` is home, and the
    origin of the vehicle's ENU positions. Simulated time is ``speed_up`` times as fast as real time.
    ``faults`` says what goes wrong, and what the vehicle lacks.
    """

    def __init__(
        self,
        link: str,
        vehicle: Vehicle,
        camera: VehicleCamera,
        origin: GeodeticPosition,
        *,
        firmware: FirmwareName = "ardupilot",
        faults: Faults | None = None,
        speed_up: float = 1.0,
        say: Callable[[str], None] = lambda _line: None,
    ) -> None:
        self.vehicle, self.camera, self.origin, self.faults = vehicle, camera, origin, faults or Faults()
        self._speed_up, self._say = speed_up, say
        self._link: Any = mavutil.mavlink_connection(link, source_system=_SYSTEM, source_component=1)
        self._state, kind = FlightState(), FIRMWARES[firmware]
        parameters = Parameters(kind, self._emit)
        gimbal = Gimbal(vehicle, self._state, self._emit)
        shutter = Camera(
            vehicle, camera, self._state, self.faults, lambda: self._telemetry.place(), self._emit, say
        )
        others = {} if self.faults.no_camera else dict(shutter.messages)
        others |= {} if self.faults.no_gimbal else gimbal.messages
        self._telemetry = Telemetry(vehicle, origin, self._state, kind, self._emit, speed_up, others)
        self._mission = MissionProtocol(
            self._state,
            self._emit,
            self._mission_replaced,
            lambda: self.faults.refuses_missions,
            kind.unknown,
        )
        self._pilot = Pilot(
            vehicle,
            shutter,
            origin,
            kind,
            self._state,
            self.faults,
            parameters,
            lambda: self._mission.items,
            lambda number: self._emit("mission_item_reached_send", number),
            self._text,
        )
        commands = Commands(self._pilot, shutter, self._telemetry, kind, self.faults, self._emit)
        self._handlers: dict[str, Callable[[Any], None]] = {
            "MISSION_COUNT": self._mission.on_count,
            "MISSION_ITEM_INT": self._mission.on_item_int,
            "MISSION_REQUEST_LIST": self._mission.on_request_list,
            "MISSION_REQUEST_INT": self._mission.on_request_int,
            "MISSION_CLEAR_ALL": self._mission.on_clear_all,
            "MISSION_SET_CURRENT": lambda message: self._pilot.go_to_item(message.seq),
            "COMMAND_LONG": commands.on_command,
            "COMMAND_INT": commands.on_command,
            "PARAM_REQUEST_LIST": parameters.on_request_list,
            "PARAM_REQUEST_READ": parameters.on_request_read,
            "PARAM_SET": parameters.on_set,
        }

    def close(self) -> None:
        """End the connection."""
        self._link.close()

    @property
    def url(self) -> str:
        """Where ground stations connect to a ``tcpin`` link: pymavlink's name of the other end."""
        host, port = self._link.listen.getsockname()
        return f"tcp:{host}:{port}"

    @property
    def mode(self) -> Mode:
        """The flight mode."""
        return self._state.mode

    @property
    def mission(self) -> tuple[Item, ...]:
        """Its mission."""
        return tuple(self._mission.items)

    def run(self, stop: Callable[[], bool]) -> None:
        """Fly until ``stop`` returns True."""
        last = time.monotonic()
        while not stop():
            self._receive()
            now = time.monotonic()
            self._pilot.advance((now - last) * self._speed_up)
            last = now
            self._telemetry.send(now)
            time.sleep(_TICK_S)

    def _receive(self) -> None:
        while not self.faults.silent:
            message = None
            with contextlib.suppress(OSError):
                message = self._link.recv_match(blocking=False)
            if message is None:
                return
            handle = self._handlers.get(message.get_type())
            if handle is not None and getattr(message, "target_system", 0) in (0, _SYSTEM):
                handle(message)

    def _mission_replaced(self) -> None:
        self._pilot.mission_replaced()
        self._say(f"mission of {len(self._mission.items)} items")

    def _text(self, text: str) -> None:
        self._say(text)
        self._emit("statustext_send", mavlink.MAV_SEVERITY_INFO, text.encode()[:50])

    def _emit(self, name: str, *fields: Any, **more: Any) -> None:
        if not self.faults.silent:
            with contextlib.suppress(OSError):
                getattr(self._link.mav, name)(*fields, **more)
