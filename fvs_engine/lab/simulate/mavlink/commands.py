"""The commands of a simulated autopilot: https://mavlink.io/en/services/command.html."""

from collections.abc import Callable
from typing import Any

from fvs_engine.lab.simulate.mavlink.camera import Camera
from fvs_engine.lab.simulate.mavlink.dialect import mavlink
from fvs_engine.lab.simulate.mavlink.firmware import Firmware
from fvs_engine.lab.simulate.mavlink.flight_state import Faults, Mode
from fvs_engine.lab.simulate.mavlink.mission import AT_ONCE
from fvs_engine.lab.simulate.mavlink.pilot import Pilot
from fvs_engine.lab.simulate.mavlink.telemetry import Telemetry

_ACCEPTED = int(mavlink.MAV_RESULT_ACCEPTED)
_DENIED = int(mavlink.MAV_RESULT_DENIED)
_UNSUPPORTED = int(mavlink.MAV_RESULT_UNSUPPORTED)


class Commands:
    """Executes the commands of ground stations, and answers with ``emit``."""

    def __init__(
        self,
        pilot: Pilot,
        camera: Camera,
        telemetry: Telemetry,
        firmware: Firmware,
        faults: Faults,
        emit: Callable[..., None],
    ) -> None:
        self._pilot, self._camera, self._telemetry = pilot, camera, telemetry
        self._firmware, self._faults, self._emit = firmware, faults, emit

    def on_command(self, message: Any) -> None:
        """Execute a command, and answer its sender."""
        parameters = (message.param1, message.param2, message.param3, message.param4)
        result = self._do(message.command, parameters)
        sender = {"target_system": message.get_srcSystem(), "target_component": message.get_srcComponent()}
        self._emit("command_ack_send", message.command, result, **sender)

    def _do(self, command: int, parameters: tuple[float, float, float, float]) -> int:
        """Execute a command; returns a ``MAV_RESULT``."""
        first, second, third, _ = parameters
        match command:
            case mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
                return _result(self._pilot.arm(first >= 1))
            case mavlink.MAV_CMD_DO_SET_MODE:
                return _result(self._set_mode(round(second), round(third)))
            case mavlink.MAV_CMD_MISSION_START:
                return _result(self._pilot.start_mission())
            case mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH:
                self._pilot.enter(Mode.RETURN, "asked")
            case mavlink.MAV_CMD_DO_PAUSE_CONTINUE:
                self._pilot.enter(Mode.MISSION if first >= 1 else Mode.BRAKE, "asked")
            case mavlink.MAV_CMD_REQUEST_MESSAGE:
                return _result(self._send(round(first), round(second)), _UNSUPPORTED)
            case mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
                return _result(self._telemetry.set_interval(round(first), second), _UNSUPPORTED)
            case _ if command in AT_ONCE and command not in self._firmware.unknown:
                return _result(self._pilot.do(command, parameters))
            case _:
                return _UNSUPPORTED
        return _ACCEPTED

    def _set_mode(self, main: int, sub: int) -> bool:
        mode = self._firmware.mode_of(main, sub)
        if mode is None:
            return False
        if mode is Mode.MISSION and self._firmware.start_arms:
            return self._pilot.start_mission()
        self._pilot.enter(mode, "asked")
        return True

    def _send(self, message: int, number: int) -> bool:
        if message == mavlink.MAVLINK_MSG_ID_CAMERA_IMAGE_CAPTURED and not self._faults.no_camera:
            return self._camera.tell_again(number)
        return self._telemetry.answer(message)


def _result(done: bool, otherwise: int = _DENIED) -> int:
    return _ACCEPTED if done else otherwise
