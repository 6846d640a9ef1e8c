"""The autopilot of a simulated vehicle: modes, missions and commands as in ArduCopter, over MAVLink.

What drives it could drive a real vehicle: https://mavlink.io/en/services/mission.html,
https://ardupilot.org/copter/docs/common-mavlink-mission-command-messages-mav_cmd.html.
"""

import contextlib
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import IntEnum
from pathlib import Path
from typing import Any

import numpy as np

from fvs_engine.geometry.geodetic import GeodeticPosition, geodetic_from_enu
from fvs_engine.simulate.mavlink.dialect import mavlink, mavutil
from fvs_engine.simulate.mavlink.mission import Item, Reception
from fvs_engine.simulate.vehicle import Goal, Vehicle
from fvs_engine.simulate.vehicle_camera import VehicleCamera

_STEP_S = 0.05
_TICK_S = 0.02
_TELEMETRY_S = 0.2
_HEARTBEAT_S = 1.0
_FASTEST_S = 0.1
"""Messages are no more frequent, however fast simulated time is."""
_RETURN_HEIGHT_M = 15.0
_LANDED_M = 0.15
_RADIUS_M = 1.0
_YAW_DEG = 3.0
_TAKEOFF_SHARE = 0.95
_LOW_BATTERY = 0.15
_EMPTY_BATTERY = 0.03


class Mode(IntEnum):
    """ArduCopter's flight modes that a mission needs."""

    AUTO = 3
    GUIDED = 4
    LOITER = 5
    RTL = 6
    LAND = 9
    BRAKE = 17


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
        self._mode, self._armed = Mode.LOITER, False
        self._goal: Goal | None = None
        self._items: list[Item] = []
        self._reception: Reception | None = None
        self._item, self._began_s, self._item_begun = 0, 0.0, False
        self._speed_m_s = 5.0
        self._time_s = 0.0
        self._photographs = 0
        self._next_telemetry = self._next_heartbeat = 0.0
        self._reported = -1

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
        return self._mode

    def run(self, stop: Callable[[], bool]) -> None:
        """Fly until ``stop`` returns True."""
        last = time.monotonic()
        while not stop():
            self._receive()
            now = time.monotonic()
            self._advance((now - last) * self._speed_up)
            last = now
            self._send(now)
            time.sleep(_TICK_S)

    def _advance(self, seconds: float) -> None:
        while seconds > 1e-9:
            step = min(_STEP_S, seconds)
            self._decide()
            self.vehicle.step(step, self._goal if self._armed else None)
            self._time_s += step
            seconds -= step

    def _decide(self) -> None:
        """What the vehicle does next."""
        if not self._armed or self._goal is None:
            return
        if self.vehicle.battery <= _EMPTY_BATTERY and self._mode is not Mode.LAND:
            self._enter(Mode.LAND, "Battery empty")
        elif self.vehicle.battery <= _LOW_BATTERY and self._mode not in (Mode.RTL, Mode.LAND):
            self._enter(Mode.RTL, "Battery low")
        match self._mode:
            case Mode.AUTO:
                self._fly_mission()
            case Mode.RTL:
                self._return()
            case Mode.LAND:
                self._land()

    def _fly_mission(self) -> None:
        while self._mode is Mode.AUTO:
            if self._item >= len(self._items):
                self._enter(Mode.LOITER, "Mission complete")
                return
            item = self._items[self._item]
            if not self._item_begun:
                self._begin(item)
                self._item_begun, self._began_s = True, self._time_s
            if not self._done(item):
                return
            self._tell_reached(self._item)
            self._item, self._item_begun = self._item + 1, False

    def _begin(self, item: Item) -> None:
        goal, first = self._flown(), item.parameters[0]
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
                if item.command == mavlink.MAV_CMD_NAV_WAYPOINT and float(np.hypot(*way)) > _RADIUS_M:
                    goal.yaw_deg = math.degrees(math.atan2(way[0], way[1])) % 360.0  # it looks ahead
            case mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH:
                self._enter(Mode.RTL, "Returning home")
            case mavlink.MAV_CMD_NAV_LAND:
                self._enter(Mode.LAND, "Landing")
            case mavlink.MAV_CMD_CONDITION_YAW:
                relative = item.parameters[3] > 0
                goal.yaw_deg = (first + (self.vehicle.yaw_deg if relative else 0.0)) % 360.0
            case mavlink.MAV_CMD_DO_CHANGE_SPEED:
                if item.parameters[1] > 0:
                    self._speed_m_s = goal.speed_m_s = item.parameters[1]
            case mavlink.MAV_CMD_DO_MOUNT_CONTROL | mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW:
                goal.pitch_deg = first
            case mavlink.MAV_CMD_DO_DIGICAM_CONTROL | mavlink.MAV_CMD_IMAGE_START_CAPTURE:
                self._photograph()

    def _done(self, item: Item) -> bool:
        goal, waited_s = self._flown(), self._time_s - self._began_s
        off_m = goal.position - self.vehicle.believed
        match item.command:
            case mavlink.MAV_CMD_NAV_TAKEOFF:
                return bool(self.vehicle.believed[2] >= _TAKEOFF_SHARE * goal.position[2])
            case mavlink.MAV_CMD_NAV_WAYPOINT:
                there = float(np.linalg.norm(off_m)) <= (item.parameters[1] or _RADIUS_M)
                if not there:
                    self._began_s = self._time_s
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
        goal = self._flown()
        home = float(np.hypot(*self.vehicle.believed[:2]))
        height_m = max(float(self.vehicle.believed[2]), _RETURN_HEIGHT_M) if home > _RADIUS_M else 0.0
        if home > _RADIUS_M and self.vehicle.believed[2] < _RETURN_HEIGHT_M - _RADIUS_M:
            goal.position = np.array([*self.vehicle.believed[:2], _RETURN_HEIGHT_M])
        elif home > _RADIUS_M:
            goal.position = np.array([0.0, 0.0, height_m])
        else:
            self._enter(Mode.LAND, "Landing")

    def _land(self) -> None:
        goal = self._flown()
        goal.position = np.array([*goal.position[:2], -1.0 - abs(float(self.vehicle.believed[2]))])
        if self.vehicle.position[2] <= _LANDED_M:
            self._armed, self._goal = False, None
            self.vehicle.position[2] = 0.0
            self._text("Disarmed")

    def _photograph(self) -> None:
        number = self._photographs
        self._photographs += 1
        file: Path | None = None
        if number not in self.faults.failing_photographs:
            file = self.camera.take(self.vehicle, self._time_s)
            self._say(f"photograph {file.name}")
        here = geodetic_from_enu(self.vehicle.believed, self.origin)
        quaternion = (1.0, 0.0, 0.0, 0.0)
        self._tell(
            "camera_image_captured_send",
            self._clock_ms(),
            0,
            0,
            round(here.latitude_deg * 1e7),
            round(here.longitude_deg * 1e7),
            round(here.altitude_m * 1e3),
            round(float(self.vehicle.believed[2]) * 1e3),
            quaternion,
            number,
            int(file is not None),
            b"" if file is None else file.name.encode(),
        )

    def _flown(self) -> Goal:
        assert self._goal is not None, "a vehicle that is armed has a goal"
        return self._goal

    def _enter(self, mode: Mode, why: str) -> None:
        if mode is not self._mode:
            self._mode = mode
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
            handle = getattr(self, f"_on_{message.get_type().lower()}", None)
            if handle is not None:
                handle(message)

    def _on_mission_count(self, message: Any) -> None:
        self._reception = Reception(message.count)
        refusal = mavlink.MAV_MISSION_DENIED if self.faults.refuses_missions else self._reception.refusal
        if refusal is not None:
            self._refuse(refusal)
        elif message.count == 0:
            self._accept([])
        else:
            self._request(0)

    def _on_mission_item_int(self, message: Any) -> None:
        reception = self._reception
        if reception is None:
            return
        if message.seq != len(reception.items):  # one of an earlier request
            self._request(len(reception.items))
            return
        item = Item.of(message)
        if item.refusal is not None:
            self._refuse(item.refusal)
            return
        reception.items.append(item)
        if reception.whole:
            self._accept(reception.items)
        else:
            self._request(len(reception.items))

    def _on_mission_request_list(self, _message: Any) -> None:
        self._tell("mission_count_send", *self._station(), len(self._items))

    def _on_mission_request_int(self, message: Any) -> None:
        if not 0 <= message.seq < len(self._items):
            self._tell("mission_ack_send", *self._station(), mavlink.MAV_MISSION_INVALID_SEQUENCE)
            return
        item = self._items[message.seq]
        factor = 1e7 if item.frame != mavlink.MAV_FRAME_MISSION else 1.0
        place = (round(item.latitude_deg * factor), round(item.longitude_deg * factor), item.altitude_m)
        current = int(message.seq == self._item)
        fields = (message.seq, item.frame, item.command, current, 1, *item.parameters, *place)
        self._tell("mission_item_int_send", *self._station(), *fields)

    def _on_mission_clear_all(self, _message: Any) -> None:
        self._accept([])

    def _on_mission_set_current(self, message: Any) -> None:
        if 0 <= message.seq < max(1, len(self._items)):
            self._item, self._item_begun = message.seq, False

    def _on_command_long(self, message: Any) -> None:
        result = self._command(message.command, message.param1, message.param2)
        self._tell("command_ack_send", message.command, result)

    def _command(self, command: int, first: float, second: float) -> int:
        """Do a command; returns a ``MAV_RESULT``."""
        denied, accepted = int(mavlink.MAV_RESULT_DENIED), int(mavlink.MAV_RESULT_ACCEPTED)
        match command:
            case mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
                if first < 1 and self.vehicle.position[2] > _LANDED_M:
                    return denied
                self._armed = first >= 1
                here = self.vehicle.believed
                pose = Goal(here, self.vehicle.yaw_deg, self.vehicle.pitch_deg, self._speed_m_s)
                self._goal = pose if self._armed else None
            case mavlink.MAV_CMD_DO_SET_MODE:
                if round(second) not in set(Mode):
                    return denied
                self._enter(Mode(round(second)), "asked")
                if self._mode in (Mode.GUIDED, Mode.LOITER, Mode.BRAKE):
                    self._hold()
            case mavlink.MAV_CMD_MISSION_START:
                if not self._armed or not self._items:
                    return denied
                if self._mode is not Mode.AUTO:
                    self._item, self._item_begun = max(1, self._item), False  # item 0 is home
                self._enter(Mode.AUTO, "asked")
            case mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH:
                self._enter(Mode.RTL, "asked")
            case mavlink.MAV_CMD_DO_PAUSE_CONTINUE:
                self._enter(Mode.AUTO if first >= 1 else Mode.BRAKE, "asked")
                if first < 1:
                    self._hold()
            case mavlink.MAV_CMD_SET_MESSAGE_INTERVAL | mavlink.MAV_CMD_REQUEST_MESSAGE:
                pass
            case _:
                return int(mavlink.MAV_RESULT_UNSUPPORTED)
        return accepted

    def _request(self, number: int) -> None:
        self._tell("mission_request_int_send", *self._station(), number)

    def _refuse(self, result: int) -> None:
        self._reception = None
        self._tell("mission_ack_send", *self._station(), result)

    def _accept(self, items: list[Item]) -> None:
        self._items, self._reception = list(items), None
        self._item, self._item_begun = 0, False
        if self._mode is Mode.AUTO:
            self._enter(Mode.LOITER, "its mission was replaced")
            self._hold()
        self._tell("mission_ack_send", *self._station(), mavlink.MAV_MISSION_ACCEPTED)
        self._say(f"mission of {len(items)} items")

    def _station(self) -> tuple[int, int]:
        """The ground station that is spoken to: whoever listens."""
        return 0, 0

    def _send(self, now: float) -> None:
        if now >= self._next_heartbeat:
            self._next_heartbeat = now + max(_HEARTBEAT_S / self._speed_up, _FASTEST_S)
            state = mavlink.MAV_STATE_ACTIVE if self._armed else mavlink.MAV_STATE_STANDBY
            flags = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
            flags |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED if self._armed else 0
            kinds = (mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA)
            self._tell("heartbeat_send", *kinds, flags, int(self._mode), state)
        if now >= self._next_telemetry:
            self._next_telemetry = now + max(_TELEMETRY_S / self._speed_up, _FASTEST_S)
            self._tell_state()

    def _tell_state(self) -> None:
        vehicle, clock_ms = self.vehicle, self._clock_ms()
        here = geodetic_from_enu(vehicle.believed, self.origin)
        speeds = (round(100.0 * v) for v in (vehicle.velocity[1], vehicle.velocity[0], -vehicle.velocity[2]))
        self._tell(
            "global_position_int_send",
            clock_ms,
            round(here.latitude_deg * 1e7),
            round(here.longitude_deg * 1e7),
            round(here.altitude_m * 1e3),
            round(float(vehicle.believed[2]) * 1e3),
            *speeds,
            round(vehicle.yaw_deg * 100.0) % 36_000,
        )
        yaw = math.radians((vehicle.yaw_deg + 180.0) % 360.0 - 180.0)
        self._tell("attitude_send", clock_ms, 0.0, 0.0, yaw, 0.0, 0.0, 0.0)
        left = round(vehicle.battery * 100.0)
        self._tell("sys_status_send", 0, 0, 0, 0, 15_000, -1, left, 0, 0, 0, 0, 0, 0)
        self._tell("mission_current_send", self._item)

    def _tell_reached(self, number: int) -> None:
        self._tell("mission_item_reached_send", number)

    def _text(self, text: str) -> None:
        self._say(text)
        self._tell("statustext_send", mavlink.MAV_SEVERITY_INFO, text.encode()[:50])

    def _tell(self, name: str, *fields: Any) -> None:
        if not self.faults.silent:
            with contextlib.suppress(OSError):
                getattr(self._link.mav, name)(*fields)

    def _clock_ms(self) -> int:
        return round(self._time_s * 1e3)
