"""The autopilot of a simulated vehicle: modes, missions and commands as in ArduCopter or PX4, over MAVLink.

What drives it could drive a real vehicle: https://mavlink.io/en/services/mission.html,
https://ardupilot.org/copter/docs/common-mavlink-mission-command-messages-mav_cmd.html.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from fvs_engine.choices import CameraReports
from fvs_engine.choices import Firmware as FirmwareName
from fvs_engine.geometry.geodetic import GeodeticPosition
from fvs_engine.lab.simulate.mavlink.arming import Arming
from fvs_engine.lab.simulate.mavlink.board import Board
from fvs_engine.lab.simulate.mavlink.camera import COMPONENT, Camera
from fvs_engine.lab.simulate.mavlink.commands import Commands
from fvs_engine.lab.simulate.mavlink.dialect import mavlink
from fvs_engine.lab.simulate.mavlink.failsafes import Failsafes
from fvs_engine.lab.simulate.mavlink.feasibility import objection
from fvs_engine.lab.simulate.mavlink.fence import Fence
from fvs_engine.lab.simulate.mavlink.firmware import FIRMWARES
from fvs_engine.lab.simulate.mavlink.flight_state import Faults, FlightState, Mode, Place
from fvs_engine.lab.simulate.mavlink.gimbal import Gimbal
from fvs_engine.lab.simulate.mavlink.links import Links, Peer
from fvs_engine.lab.simulate.mavlink.mission import Item
from fvs_engine.lab.simulate.mavlink.mission_protocol import (
    FENCES,
    MISSION,
    RALLIES,
    ItemList,
    MissionProtocol,
)
from fvs_engine.lab.simulate.mavlink.navigator import Navigator
from fvs_engine.lab.simulate.mavlink.parameters import Parameters
from fvs_engine.lab.simulate.mavlink.pilot import Pilot
from fvs_engine.lab.simulate.mavlink.px4_failsafes import Px4Failsafes
from fvs_engine.lab.simulate.mavlink.receiver import Receiver
from fvs_engine.lab.simulate.mavlink.reports import Reports
from fvs_engine.lab.simulate.mavlink.signing import keep_time, sign_by
from fvs_engine.lab.simulate.mavlink.telemetry import Telemetry
from fvs_engine.lab.simulate.vehicle import Vehicle
from fvs_engine.lab.simulate.vehicle_camera import VehicleCamera

_TICK_S = 0.02
_STEP_S = 0.05
_SYSTEM = 1


@dataclass(frozen=True)
class Setup:
    """How a vehicle is set up: what tells of photographs, how long the first GPS fix takes in s, its key."""

    camera_reports: CameraReports = "both"
    fix_after_s: float = 0.0
    signing_key: bytes | None = None
    """32 bytes by which messages are signed; others are ignored."""


class Autopilot:
    """Flies ``vehicle`` by commands of ground stations on the ``links``, in the way of a ``firmware``.

    ``links`` are pymavlink's names of our ends, such as ``tcpin:127.0.0.1:5760``. ``origin`` is home, and the
    origin of the vehicle's ENU positions. Simulated time is ``speed_up`` times as fast as real time.
    ``faults`` says what goes wrong, and what the vehicle lacks.
    """

    def __init__(
        self,
        links: str | Sequence[str],
        vehicle: Vehicle,
        camera: VehicleCamera,
        origin: GeodeticPosition,
        *,
        firmware: FirmwareName = "ardupilot",
        faults: Faults | None = None,
        setup: Setup | None = None,
        speed_up: float = 1.0,
        say: Callable[[str], None] = lambda _line: None,
    ) -> None:
        self.vehicle, self.camera, self.faults = vehicle, camera, faults or Faults()
        setup = setup or Setup()
        self._speed_up = speed_up
        self._links = Links([links] if isinstance(links, str) else links, setup.signing_key)
        self._voices = {each: mavlink.MAVLink(None, _SYSTEM, each) for each in (1, COMPONENT)}
        for voice in self._voices.values():
            sign_by(setup.signing_key, voice)
        self._heard_from: Peer | None = None
        self._texts: list[tuple[Any, ...]] = []
        """What is told to people once the message that is handled is answered."""
        kind = FIRMWARES[firmware]
        self._state = FlightState(kind.first_mode)
        place = Place(vehicle, origin, self._state)
        parameters = Parameters(kind, self._emit)
        board = Board(vehicle, place, kind, self._state, self.faults, parameters, self._emit, say)
        gimbal, shutter = Gimbal(board), Camera(board, camera, setup.camera_reports)
        self._receiver = Receiver(board, setup.fix_after_s)
        fence = Fence(board, lambda: lists[FENCES].items)
        arming = Arming(board, fence)
        self._pilot = Pilot(
            board,
            gimbal,
            Navigator(board, shutter, gimbal),
            arming,
            lambda: lists[MISSION].items,
            lambda: objection(board, fence, lists[MISSION].items),
        )
        mission = self._pilot.mission
        lists = {
            MISSION: ItemList(
                board,
                MISSION,
                self._pilot.mission_changed,
                lambda: mission.current,
                lambda: mission.running and self._state.armed,
            ),
            FENCES: ItemList(board, FENCES, fence.count),
            RALLIES: ItemList(board, RALLIES, lambda _current: None),
        }
        self._mission, self._protocol = lists[MISSION], MissionProtocol(board, lists)
        self._failsafes: Failsafes | Px4Failsafes = Px4Failsafes(board, self._pilot)
        if kind.is_ardupilot:
            self._failsafes = Failsafes(board, self._pilot, fence)
        reports = Reports(board, self._receiver, mission)
        others = {**shutter.autopilots_messages, **gimbal.messages}
        beat = shutter.messages[mavlink.MAVLINK_MSG_ID_HEARTBEAT] if shutter.speaks else None
        self._telemetry = Telemetry(board, reports, speed_up, others, beat)
        commands = Commands(board, self._pilot, arming, shutter, gimbal, self._telemetry)
        self._handlers: dict[str, Callable[[Any], None]] = {
            **self._protocol.handlers(),
            "COMMAND_LONG": commands.on_command,
            "COMMAND_INT": commands.on_command,
            "HEARTBEAT": self._failsafes.heard,
            "MISSION_SET_CURRENT": commands.on_set_current,
            "PARAM_REQUEST_LIST": parameters.on_request_list,
            "PARAM_REQUEST_READ": parameters.on_request_read,
            "PARAM_SET": parameters.on_set,
            "REQUEST_DATA_STREAM": self._telemetry.on_stream,
            "SET_MODE": commands.on_set_mode,
            "SET_POSITION_TARGET_GLOBAL_INT": commands.on_target,
            "TIMESYNC": reports.time_answer,
        }

    def close(self) -> None:
        """End the connections."""
        self._links.close()

    @property
    def url(self) -> str:
        """Where ground stations connect, in pymavlink's name of their ends."""
        return self._links.urls[0]

    @property
    def urls(self) -> list[str]:
        """The ends of all links."""
        return self._links.urls

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
            self._advance((now - last) * self._speed_up)
            last = now
            self._protocol.update()
            self._telemetry.send(now)

    def _advance(self, seconds: float) -> None:
        while seconds > 1e-9:
            step = min(_STEP_S, seconds)
            self._receiver.update()
            self._failsafes.check()
            self._pilot.step(step)
            seconds -= step

    def _receive(self) -> None:
        """Handle what has come, or wait a moment."""
        for peer, message in self._links.receive(_TICK_S):
            if self.faults.silent:
                continue
            target = getattr(message, "target_system", 0)
            if target != _SYSTEM:
                self._links.send(bytes(message.get_msgbuf()), but=peer)
            handle = self._handlers.get(message.get_type())
            if handle is not None and target in (0, _SYSTEM) and _is_for_us(message):
                self._heard_from = peer
                handle(message)
                self._heard_from = None
                texts, self._texts = self._texts, []
                for fields in texts:
                    self._emit("statustext", *fields)

    def _emit(self, name: str, *fields: Any, component: int = 1, **more: Any) -> None:
        """Send a message: an answer to whom it is for, others to all."""
        if self.faults.silent:
            return
        if name == "statustext" and self._heard_from is not None:
            self._texts.append(fields)
            return
        voice = self._voices[component]
        keep_time(voice)
        message = getattr(voice, f"{name}_encode")(*fields, **more)
        data = message.pack(voice)
        voice.seq = (voice.seq + 1) % 256
        addressed = getattr(message, "target_system", 0) not in (0, _SYSTEM)
        self._links.send(data, only=self._heard_from if addressed else None)


def _is_for_us(message: Any) -> bool:
    """Whether the autopilot is addressed, or its camera by a command."""
    components = (0, 1, COMPONENT) if message.get_type().startswith("COMMAND") else (0, 1)
    return getattr(message, "target_component", 0) in components
