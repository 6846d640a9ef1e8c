"""The autopilot of a simulated vehicle: modes, missions and commands as in ArduCopter, over MAVLink.

What drives it could drive a real vehicle: https://mavlink.io/en/services/mission.html,
https://ardupilot.org/copter/docs/common-mavlink-mission-command-messages-mav_cmd.html.
"""

import contextlib
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from fvs_engine.geometry.geodetic import GeodeticPosition
from fvs_engine.simulate.mavlink.dialect import mavlink, mavutil
from fvs_engine.simulate.mavlink.flight_state import FlightState, Mode
from fvs_engine.simulate.mavlink.mission import AT_ONCE, Item
from fvs_engine.simulate.mavlink.mission_protocol import MissionProtocol
from fvs_engine.simulate.mavlink.parameters import Parameters
from fvs_engine.simulate.mavlink.telemetry import Telemetry
from fvs_engine.simulate.vehicle import Goal, Vehicle
from fvs_engine.simulate.vehicle_camera import VehicleCamera

_STEP_S = 0.05
_TICK_S = 0.02
_LANDED_M = 0.15
_YAW_DEG = 3.0
_TAKEOFF_SHARE = 0.95
_LOW_BATTERY = 0.15
_EMPTY_BATTERY = 0.03


@dataclass
class Faults:
    """What goes wrong on purpose."""

    failing_photographs: set[int] = field(default_factory=set)
    """Numbers of photographs, from 0, that fail."""
    refuses_missions: bool = False
    silent: bool = False
    """It receives and sends nothing."""


class Autopilot:
    """Flies ``vehicle`` as ground stations on the ``link`` say.

    ``link`` is pymavlink's name of our end, such as ``tcpin:127.0.0.1:5760``. ``origin`` is home, and the
    origin of the vehicle's ENU positions. Simulated time is ``speed_up`` times as fast as real time.
    """

    def __init__(
        self,
        link: str,
        vehicle: Vehicle,
        camera: VehicleCamera,
        origin: GeodeticPosition,
        *,
        speed_up: float = 1.0,
        say: Callable[[str], None] = lambda _line: None,
    ) -> None:
        self.vehicle, self.camera, self.origin, self.faults = vehicle, camera, origin, Faults()
        self._speed_up, self._say = speed_up, say
        self._link: Any = mavutil.mavlink_connection(link, source_system=1, source_component=1)
        self._goal: Goal | None = None
        self._began_s, self._item_begun = 0.0, False
        self._state = FlightState()
        self._mission = MissionProtocol(
            self._state, self._tell, self._mission_replaced, lambda: self.faults.refuses_missions
        )
        self._parameters = Parameters(self._tell)
        self._telemetry = Telemetry(vehicle, camera, origin, self._state, self._tell, speed_up)
        self._speed_m_s = self._parameters.speed_m_s
        self._handlers: dict[str, Callable[[Any], None]] = {
            "MISSION_COUNT": self._mission.on_count,
            "MISSION_ITEM_INT": self._mission.on_item_int,
            "MISSION_REQUEST_LIST": self._mission.on_request_list,
            "MISSION_REQUEST_INT": self._mission.on_request_int,
            "MISSION_CLEAR_ALL": self._mission.on_clear_all,
            "MISSION_SET_CURRENT": self._on_mission_set_current,
            "COMMAND_LONG": self._on_command,
            "COMMAND_INT": self._on_command,
            "PARAM_REQUEST_LIST": self._parameters.on_request_list,
            "PARAM_REQUEST_READ": self._parameters.on_request_read,
            "PARAM_SET": self._parameters.on_set,
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

    def run(self, stop: Callable[[], bool]) -> None:
        """Fly until ``stop`` returns True."""
        last = time.monotonic()
        while not stop():
            self._receive()
            now = time.monotonic()
            self._advance((now - last) * self._speed_up)
            last = now
            self._telemetry.send(now)
            time.sleep(_TICK_S)

    def _advance(self, seconds: float) -> None:
        while seconds > 1e-9:
            step = min(_STEP_S, seconds)
            self._decide()
            self.vehicle.step(step, self._goal if self._state.armed else None)
            self._state.time_s += step
            seconds -= step

    def _decide(self) -> None:
        """What the vehicle does next."""
        if not self._state.armed or self._goal is None:
            return
        if self.vehicle.battery <= _EMPTY_BATTERY and self._state.mode is not Mode.LAND:
            self._enter(Mode.LAND, "Battery empty")
        elif self.vehicle.battery <= _LOW_BATTERY and self._state.mode not in (Mode.RTL, Mode.LAND):
            self._enter(Mode.RTL, "Battery low")
        match self._state.mode:
            case Mode.AUTO:
                self._fly_mission()
            case Mode.RTL:
                self._return()
            case Mode.LAND:
                self._land()

    def _fly_mission(self) -> None:
        while self._state.mode is Mode.AUTO:
            if self._state.item >= len(self._mission.items):
                self._enter(Mode.LOITER, "Mission complete")
                return
            item = self._mission.items[self._state.item]
            if not self._item_begun:
                self._begin(item)
                self._item_begun, self._began_s = True, self._state.time_s
            if not self._done(item):
                return
            self._tell_reached(self._state.item)
            self._state.item, self._item_begun = self._state.item + 1, False

    def _begin(self, item: Item) -> None:
        goal = self._flown()
        match item.command:
            case mavlink.MAV_CMD_NAV_TAKEOFF:
                height_m = item.position(self.origin, goal.position)[2]
                here = self.vehicle.believed
                goal.position = np.array([here[0], here[1], height_m])
            case (
                mavlink.MAV_CMD_NAV_WAYPOINT
                | mavlink.MAV_CMD_NAV_LOITER_TIME
                | mavlink.MAV_CMD_NAV_LOITER_UNLIM
            ):
                place = item.position(self.origin, goal.position)
                way = place[:2] - goal.position[:2]
                goal.position, goal.speed_m_s = place, self._speed_m_s
                moves = float(np.hypot(*way)) > self._parameters.radius_m
                if moves and item.command == mavlink.MAV_CMD_NAV_WAYPOINT:
                    goal.yaw_deg = math.degrees(math.atan2(way[0], way[1])) % 360.0  # it looks ahead
            case mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH:
                self._enter(Mode.RTL, "Returning home")
            case mavlink.MAV_CMD_NAV_LAND:
                self._enter(Mode.LAND, "Landing")
            case _:
                self._do(item.command, item.parameters)

    def _do(self, command: int, parameters: tuple[float, float, float, float]) -> None:
        """Do what takes no time: turn, point the gimbal, photograph."""
        goal, first = self._flown(), parameters[0]
        match command:
            case mavlink.MAV_CMD_CONDITION_YAW:
                relative = parameters[3] > 0
                goal.yaw_deg = (first + (self.vehicle.yaw_deg if relative else 0.0)) % 360.0
            case mavlink.MAV_CMD_DO_CHANGE_SPEED:
                if parameters[1] > 0:
                    self._speed_m_s = goal.speed_m_s = parameters[1]
            case mavlink.MAV_CMD_DO_MOUNT_CONTROL | mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW:
                goal.pitch_deg = first
            case mavlink.MAV_CMD_DO_DIGICAM_CONTROL | mavlink.MAV_CMD_IMAGE_START_CAPTURE:
                self._photograph()

    def _done(self, item: Item) -> bool:
        goal, waited_s = self._flown(), self._state.time_s - self._began_s
        off_m = goal.position - self.vehicle.believed
        match item.command:
            case mavlink.MAV_CMD_NAV_TAKEOFF:
                return bool(self.vehicle.believed[2] >= _TAKEOFF_SHARE * goal.position[2])
            case mavlink.MAV_CMD_NAV_WAYPOINT:
                there = float(np.linalg.norm(off_m)) <= (item.parameters[1] or self._parameters.radius_m)
                if not there:
                    self._began_s = self._state.time_s
                return there and waited_s >= item.parameters[0]
            case mavlink.MAV_CMD_NAV_LOITER_TIME | mavlink.MAV_CMD_NAV_DELAY:
                return waited_s >= item.parameters[0]
            case mavlink.MAV_CMD_NAV_LOITER_UNLIM:
                return False
            case mavlink.MAV_CMD_CONDITION_YAW:
                turn = (goal.yaw_deg - self.vehicle.yaw_deg + 180.0) % 360.0 - 180.0
                return abs(turn) <= _YAW_DEG
        return True

    def _return(self) -> None:
        """Climb, fly home, land."""
        goal, here = self._flown(), self.vehicle.believed
        height_m, radius_m = self._parameters.return_height_m, self._parameters.radius_m
        if float(np.hypot(*here[:2])) <= radius_m:
            self._enter(Mode.LAND, "Landing")
        elif here[2] < height_m - radius_m:
            goal.position = np.array([*here[:2], height_m])
        else:
            goal.position = np.array([0.0, 0.0, max(float(here[2]), height_m)])

    def _land(self) -> None:
        goal = self._flown()
        goal.position = np.array([*goal.position[:2], -1.0 - abs(float(self.vehicle.believed[2]))])
        if self.vehicle.position[2] <= _LANDED_M:
            self._state.armed, self._goal = False, None
            self.vehicle.position[2] = 0.0
            self._text("Disarmed")

    def _photograph(self) -> None:
        number = self._state.photographs
        self._state.photographs += 1
        file: Path | None = None
        if number not in self.faults.failing_photographs:
            file = self.camera.take(self.vehicle, self._state.time_s)
            self._say(f"photograph {file.name}")
        self._telemetry.photograph(number, None if file is None else file.name)

    def _flown(self) -> Goal:
        assert self._goal is not None, "a vehicle that is armed has a goal"
        return self._goal

    def _enter(self, mode: Mode, why: str) -> None:
        if mode is not self._state.mode:
            self._state.mode = mode
            self._text(f"{mode.name}: {why}")

    def _hold(self) -> None:
        """Stay where it is."""
        if self._goal is not None:
            self._goal.position = self.vehicle.believed

    def _receive(self) -> None:
        while not self.faults.silent:
            message = None
            with contextlib.suppress(OSError):
                message = self._link.recv_match(blocking=False)
            if message is None:
                return
            handle = self._handlers.get(message.get_type())
            if handle is not None:
                handle(message)

    def _on_mission_set_current(self, message: Any) -> None:
        if 0 <= message.seq < max(1, len(self._mission.items)):
            self._state.item, self._item_begun = message.seq, False

    def _on_command(self, message: Any) -> None:
        parameters = (message.param1, message.param2, message.param3, message.param4)
        self._tell("command_ack_send", message.command, self._command(message.command, parameters))

    def _command(self, command: int, parameters: tuple[float, float, float, float]) -> int:
        """Do a command; returns a ``MAV_RESULT``."""
        denied, unsupported = int(mavlink.MAV_RESULT_DENIED), int(mavlink.MAV_RESULT_UNSUPPORTED)
        first, second = parameters[:2]
        match command:
            case mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
                if first < 1 and self.vehicle.position[2] > _LANDED_M:
                    return denied
                self._state.armed = first >= 1
                here = self.vehicle.believed
                pose = Goal(here, self.vehicle.yaw_deg, self.vehicle.pitch_deg, self._speed_m_s)
                self._goal = pose if self._state.armed else None
            case mavlink.MAV_CMD_DO_SET_MODE:
                if round(second) not in set(Mode):
                    return denied
                self._enter(Mode(round(second)), "asked")
                if self._state.mode in (Mode.GUIDED, Mode.LOITER, Mode.BRAKE):
                    self._hold()
            case mavlink.MAV_CMD_MISSION_START:
                if not self._state.armed or not self._mission.items:
                    return denied
                if self._state.mode is not Mode.AUTO:
                    self._state.item, self._item_begun = max(1, self._state.item), False  # item 0 is home
                    self._speed_m_s = self._parameters.speed_m_s
                self._enter(Mode.AUTO, "asked")
            case mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH:
                self._enter(Mode.RTL, "asked")
            case mavlink.MAV_CMD_DO_PAUSE_CONTINUE:
                self._enter(Mode.AUTO if first >= 1 else Mode.BRAKE, "asked")
                if first < 1:
                    self._hold()
            case mavlink.MAV_CMD_REQUEST_MESSAGE:
                return _result(self._telemetry.answer(round(first)))
            case mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
                return _result(self._telemetry.set_interval(round(first), second))
            case _ if command in AT_ONCE:
                if self._goal is None:  # on the ground
                    return denied
                self._do(command, parameters)
            case _:
                return unsupported
        return int(mavlink.MAV_RESULT_ACCEPTED)

    def _mission_replaced(self) -> None:
        self._state.item, self._item_begun = 0, False
        if self._state.mode is Mode.AUTO:
            self._enter(Mode.LOITER, "its mission was replaced")
            self._hold()
        self._say(f"mission of {len(self._mission.items)} items")

    def _tell_reached(self, number: int) -> None:
        self._tell("mission_item_reached_send", number)

    def _text(self, text: str) -> None:
        self._say(text)
        self._tell("statustext_send", mavlink.MAV_SEVERITY_INFO, text.encode()[:50])

    def _tell(self, name: str, *fields: Any, **more: Any) -> None:
        if not self.faults.silent:
            with contextlib.suppress(OSError):
                getattr(self._link.mav, name)(*fields, **more)


def _result(known: bool) -> int:
    """``MAV_RESULT`` of something that an autopilot knows, or does not."""
    return int(mavlink.MAV_RESULT_ACCEPTED if known else mavlink.MAV_RESULT_UNSUPPORTED)
