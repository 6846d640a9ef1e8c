"""The commands of a simulated autopilot and its camera: https://mavlink.io/en/services/command.html."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from fvs_engine.lab.simulate.mavlink.arming import Arming
from fvs_engine.lab.simulate.mavlink.board import Board
from fvs_engine.lab.simulate.mavlink.camera import COMPONENT, Camera
from fvs_engine.lab.simulate.mavlink.dialect import mavlink
from fvs_engine.lab.simulate.mavlink.flight_state import Mode
from fvs_engine.lab.simulate.mavlink.gimbal import Gimbal
from fvs_engine.lab.simulate.mavlink.mission import Item
from fvs_engine.lab.simulate.mavlink.pilot import Pilot
from fvs_engine.lab.simulate.mavlink.receiver import set_home
from fvs_engine.lab.simulate.mavlink.telemetry import Telemetry

_ACCEPTED = int(mavlink.MAV_RESULT_ACCEPTED)
_DENIED = int(mavlink.MAV_RESULT_DENIED)
_UNSUPPORTED = int(mavlink.MAV_RESULT_UNSUPPORTED)
_FAILED = int(mavlink.MAV_RESULT_FAILED)
_NOT_NOW = int(mavlink.MAV_RESULT_TEMPORARILY_REJECTED)
_FORCE = 21_196.0
"""The number that forces arming and disarming."""
_REQUESTS = {
    mavlink.MAV_CMD_GET_HOME_POSITION: mavlink.MAVLINK_MSG_ID_HOME_POSITION,
    mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION,
    mavlink.MAV_CMD_REQUEST_CAMERA_INFORMATION: mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION,
    mavlink.MAV_CMD_REQUEST_CAMERA_SETTINGS: mavlink.MAVLINK_MSG_ID_CAMERA_SETTINGS,
    mavlink.MAV_CMD_REQUEST_STORAGE_INFORMATION: mavlink.MAVLINK_MSG_ID_STORAGE_INFORMATION,
    mavlink.MAV_CMD_REQUEST_CAMERA_CAPTURE_STATUS: mavlink.MAVLINK_MSG_ID_CAMERA_CAPTURE_STATUS,
}
"""Older commands that request one message."""
_AT_ONCE = frozenset(
    {
        mavlink.MAV_CMD_CONDITION_YAW,
        mavlink.MAV_CMD_DO_CHANGE_SPEED,
        mavlink.MAV_CMD_DO_MOUNT_CONTROL,
        mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW,
        mavlink.MAV_CMD_DO_DIGICAM_CONTROL,
        mavlink.MAV_CMD_IMAGE_START_CAPTURE,
        mavlink.MAV_CMD_IMAGE_STOP_CAPTURE,
        mavlink.MAV_CMD_DO_SET_ROI_NONE,
        mavlink.MAV_CMD_DO_FENCE_ENABLE,
    }
)
_GLOBAL_FRAMES = frozenset(
    {
        mavlink.MAV_FRAME_GLOBAL,
        mavlink.MAV_FRAME_GLOBAL_INT,
        mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
        mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
    }
)
_IGNORED_POSITION = 0b111


class Commands:
    """Executes the commands of ground stations, for the autopilot and a camera that speaks MAVLink."""

    def __init__(
        self,
        board: Board,
        pilot: Pilot,
        arming: Arming,
        camera: Camera,
        gimbal: Gimbal,
        telemetry: Telemetry,
    ) -> None:
        self._board, self._pilot, self._arming = board, pilot, arming
        self._camera, self._gimbal, self._telemetry = camera, gimbal, telemetry
        self._refused = _FAILED if board.firmware.is_ardupilot else _NOT_NOW
        """The answer where a command is known but cannot be done."""
        self._commands: dict[int, Callable[[Item, Any], bool]] = {
            mavlink.MAV_CMD_COMPONENT_ARM_DISARM: self._arm,
            mavlink.MAV_CMD_DO_SET_MODE: lambda item, _: self._set_mode(
                _whole(item.parameters[1]), _whole(item.parameters[2])
            ),
            mavlink.MAV_CMD_MISSION_START: self._start,
            mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: lambda _item, _: pilot.enter(Mode.RETURN, "asked"),
            mavlink.MAV_CMD_NAV_LAND: lambda _item, _: pilot.enter(Mode.LAND, "asked"),
            mavlink.MAV_CMD_NAV_LOITER_UNLIM: lambda _item, _: pilot.enter(Mode.LOITER, "asked"),
            mavlink.MAV_CMD_NAV_TAKEOFF: lambda item, _: pilot.take_off(self._takeoff_m(item)),
            mavlink.MAV_CMD_DO_PAUSE_CONTINUE: lambda item, _: pilot.pause(item.parameters[0] < 1.0),
            mavlink.MAV_CMD_DO_REPOSITION: self._reposition,
            mavlink.MAV_CMD_DO_SET_MISSION_CURRENT: self._set_current,
            mavlink.MAV_CMD_DO_SET_HOME: self._set_home,
            mavlink.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE: self._configure,
            mavlink.MAV_CMD_RUN_PREARM_CHECKS: self._check,
            mavlink.MAV_CMD_REQUEST_MESSAGE: self._request,
            mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: lambda item, _: telemetry.set_interval(
                _whole(item.parameters[0]), item.parameters[1]
            ),
        }

    def on_command(self, message: Any) -> None:
        """Execute a command, and answer its sender: each component that it is for does so."""
        untriggered = message.command == mavlink.MAV_CMD_DO_DIGICAM_CONTROL and not self._camera.has_trigger
        if message.target_component in (0, 1) and not untriggered:  # which nobody answers
            self._answer(message, self._do(_item(message), message), 1)
        if self._camera.speaks and message.target_component in (0, COMPONENT):
            self._answer(message, self._do_by_camera(_item(message)), COMPONENT)

    def on_set_mode(self, message: Any) -> None:
        """Change the mode by the older message, which a heartbeat answers alone."""
        number = message.custom_mode
        if self._board.firmware.has_sub_modes:
            self._set_mode(number >> 16 & 255, number >> 24 & 255)
        else:
            self._set_mode(number, 0)

    def on_set_current(self, message: Any) -> None:
        """Make another item the current one, by a message that is answered by the same number."""
        if self._pilot.mission.go_to(message.seq):
            self._telemetry.tell_current(message.seq)

    def on_target(self, message: Any) -> None:
        """Fly to a position in guided mode."""
        if message.type_mask & _IGNORED_POSITION:
            return
        item = Item(0, message.coordinate_frame, (0.0,) * 4, message.lat_int, message.lon_int, message.alt)
        self._go_to(item, change_mode=False)

    def _do(self, item: Item, message: Any) -> int:
        command, px4 = item.command, not self._board.firmware.is_ardupilot
        if command in self._board.firmware.unknown | self._board.firmware.only_in_missions:
            return _UNSUPPORTED
        if command in _REQUESTS:
            self._telemetry.answer(_REQUESTS[command])
            return _ACCEPTED
        if command == mavlink.MAV_CMD_DO_SET_MISSION_CURRENT and not self._has(item):
            return _DENIED
        if px4 and command == mavlink.MAV_CMD_MISSION_START and not self._startable(item):
            return _DENIED
        if px4 and command == mavlink.MAV_CMD_DO_REPOSITION and _whole(item.parameters[1]) != 1:
            return _UNSUPPORTED
        if command in self._commands:
            done = self._commands[command](item, message)
            if done:
                return _ACCEPTED
            requests = (mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL)
            return _UNSUPPORTED if px4 and command in requests else self._refused
        if command in _AT_ONCE:
            return _ACCEPTED if self._pilot.navigator.do(item) else self._refused
        return _UNSUPPORTED

    def _do_by_camera(self, item: Item) -> int:
        first, second = _whole(item.parameters[0]), _whole(item.parameters[1])
        requests = item.command == mavlink.MAV_CMD_REQUEST_MESSAGE
        message = first if requests else int(_REQUESTS.get(item.command, -1))
        if message == mavlink.MAVLINK_MSG_ID_CAMERA_IMAGE_CAPTURED:
            return _ACCEPTED if self._camera.tell_again(second) else _DENIED
        if message in self._camera.messages:
            self._camera.messages[message]()
            return _ACCEPTED
        if item.command == mavlink.MAV_CMD_IMAGE_START_CAPTURE:
            self._camera.photograph()
            return _ACCEPTED
        known = (mavlink.MAV_CMD_SET_CAMERA_MODE, mavlink.MAV_CMD_IMAGE_STOP_CAPTURE)
        return _ACCEPTED if item.command in known else _UNSUPPORTED

    def _arm(self, item: Item, _message: Any) -> bool:
        first, second = item.parameters[:2]
        if first == 1.0:
            return self._pilot.arm(forced=second == _FORCE)
        return first == 0.0 and self._pilot.disarm(forced=second == _FORCE)

    def _set_mode(self, main: int, sub: int) -> bool:
        mode = self._board.firmware.mode_of(main, sub)
        if mode is None:
            if self._board.firmware.is_ardupilot:
                self._board.text(f"No such mode {main}", int(mavlink.MAV_SEVERITY_WARNING))
            return False
        return self._pilot.enter(mode, "asked")

    def _takeoff_m(self, item: Item) -> float:
        """Height above home; PX4 is told an altitude above the sea, or none."""
        if self._board.firmware.is_ardupilot:
            return item.z
        if not math.isfinite(item.z):
            return self._board.parameters.named("MIS_TAKEOFF_ALT")
        return item.z - self._board.place.home().altitude_m

    def _reposition(self, item: Item, _message: Any) -> bool:
        changes = _whole(item.parameters[1]) & mavlink.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE
        return self._go_to(item, change_mode=bool(changes))

    def _go_to(self, item: Item, *, change_mode: bool) -> bool:
        sane = abs(item.x) <= 90e7 and abs(item.y) <= 180e7 and item.frame in _GLOBAL_FRAMES
        if not sane:
            return False
        place = self._board.place
        position = item.position(place.origin, place.home_height_m, self._board.vehicle.believed)
        return bool(np.isfinite(position).all()) and self._pilot.go_to(position, change_mode=change_mode)

    def _has(self, item: Item) -> bool:
        """Whether the mission has an item of the number in a command."""
        return 0 <= _whole(item.parameters[0]) < self._pilot.mission.count

    def _startable(self, item: Item) -> bool:
        """Whether PX4 has a mission that it can begin at the item of a command."""
        if self._pilot.objection() is not None:
            self._board.text("Mission start denied! No valid mission", int(mavlink.MAV_SEVERITY_CRITICAL))
            return False
        return math.isfinite(item.parameters[0]) and -1.0 <= item.parameters[0] < self._pilot.mission.count

    def _start(self, item: Item, _message: Any) -> bool:
        if not self._pilot.start_mission():
            return False
        if not self._board.firmware.is_ardupilot and item.parameters[0] >= 0.0:
            self._pilot.mission.go_to(int(item.parameters[0]))
        return True

    def _set_current(self, item: Item, _message: Any) -> bool:
        mission = self._pilot.mission
        if item.parameters[1] == 1.0:
            mission.reset()
        if not mission.go_to(_whole(item.parameters[0])):
            return False
        if item.parameters[1] == 1.0 and self._board.state.mode is Mode.MISSION:
            mission.resume()
        self._telemetry.tell_current(mission.current)
        return True

    def _set_home(self, item: Item, _message: Any) -> bool:
        if item.parameters[0] != 1.0 or not self._board.state.fixed:
            return False
        set_home(self._board)
        return True

    def _configure(self, item: Item, message: Any) -> bool:
        """Who controls the gimbal: -2 is the sender, -1 nobody of those that were."""
        system, component = _whole(item.parameters[0]), _whole(item.parameters[1])
        if system == -2:
            system, component = message.get_srcSystem(), message.get_srcComponent()
        return self._gimbal.configure(max(0, system), max(0, component))

    def _check(self, _item: Item, _message: Any) -> bool:
        if self._board.state.armed:
            return False
        reason = self._arming.before_mode()
        if reason is not None:
            self._board.text(reason, int(mavlink.MAV_SEVERITY_CRITICAL))
        return True

    def _request(self, item: Item, _message: Any) -> bool:
        return self._telemetry.answer(_whole(item.parameters[0]))

    def _answer(self, message: Any, result: int, component: int) -> None:
        sender = {"target_system": message.get_srcSystem(), "target_component": message.get_srcComponent()}
        self._board.emit("command_ack", message.command, result, component=component, **sender)


def _item(message: Any) -> Item:
    """A command as an item of a mission, with a place in whole numbers."""
    parameters = (message.param1, message.param2, message.param3, message.param4)
    if message.get_type() == "COMMAND_INT":
        return Item(message.command, message.frame, parameters, message.x, message.y, message.z)
    placed = message.command in (mavlink.MAV_CMD_DO_REPOSITION, mavlink.MAV_CMD_NAV_TAKEOFF)
    factor = 1e7 if placed else 1.0
    frame = int(mavlink.MAV_FRAME_GLOBAL)
    x, y = (_whole(value * factor) for value in (message.param5, message.param6))
    return Item(message.command, frame, parameters, x, y, message.param7)


def _whole(value: float) -> int:
    """A number as a whole one; 0 where it is none."""
    return round(value) if math.isfinite(value) else 0
