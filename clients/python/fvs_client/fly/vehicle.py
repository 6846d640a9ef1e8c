"""A vehicle that speaks MAVLink, as ArduPilot's copters do: its state, missions and commands."""

import contextlib
import math
import os
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import partial
from typing import Any

from fvs_client.fly.errors import NoAnswerError, VehicleError
from fvs_client.fly.items import MissionItem

_GROUND_STATION = 255
_HEARTBEAT_S = 1.0
_ANSWER_S = 3.0
_TRIES = 4
_SILENCE_S = 20.0
"""Without a heartbeat for so long a vehicle is lost."""


class Mode(IntEnum):
    """ArduCopter's flight modes."""

    AUTO = 3
    GUIDED = 4
    LOITER = 5
    RETURN = 6
    LAND = 9
    BRAKE = 17


@dataclass(frozen=True)
class Capture:
    """A photograph that the camera has reported; ``file`` is its name, empty when the camera tells none."""

    number: int
    succeeded: bool
    file: str


@dataclass(frozen=True)
class VehicleState:
    """What a vehicle has said of itself last. Altitudes are above sea level, heights above home."""

    latitude_deg: float = math.nan
    longitude_deg: float = math.nan
    altitude_m: float = math.nan
    height_m: float = math.nan
    yaw_deg: float = math.nan
    battery: float | None = None
    """The share that is left, in [0, 1]; None when the vehicle does not tell."""
    armed: bool = False
    mode: int = -1
    item: int = 0
    """The number of the mission item that it is at."""
    reached: int = -1
    """The number of the last item that it has reached."""

    @property
    def located(self) -> bool:
        """Whether its position is known."""
        return math.isfinite(self.latitude_deg)


class Vehicle:
    """A connection to one vehicle. All methods may be called from any thread.

    ``url`` is pymavlink's: ``tcp:127.0.0.1:5760``, ``udpin:0.0.0.0:14550``, ``/dev/ttyUSB0``.
    Raises ``VehicleError`` without pymavlink, and ``NoAnswerError`` when no vehicle answers.
    """

    def __init__(self, url: str, *, baud: int = 57_600, timeout_s: float = 30.0) -> None:
        mavutil = _mavutil()
        self._mavlink = mavutil.mavlink
        try:
            self._link: Any = mavutil.mavlink_connection(
                url, baud=baud, source_system=_GROUND_STATION, autoreconnect=True, dialect="common"
            )
        except ModuleNotFoundError as error:
            raise VehicleError(
                f"{url} is a serial device, which needs pyserial.", hint="pip install pyserial"
            ) from error
        except (OSError, ValueError) as error:
            raise NoAnswerError(
                f"{url} cannot be opened: {error}.", hint="Is the autopilot or its router running?"
            ) from error
        self._changed = threading.Condition()
        self._sending = threading.Lock()
        self._state = VehicleState()
        self._heard = time.monotonic()
        self._messages: deque[Any] = deque(maxlen=1_000)
        self._captures: deque[Capture] = deque(maxlen=1_000)
        self._texts: deque[str] = deque(maxlen=100)
        self._target = (0, 0)
        self._closed = False
        self._reader = threading.Thread(target=self._read, name="mavlink", daemon=True)
        self._reader.start()
        try:
            self.wait(lambda: self._target[0] != 0, timeout_s, "sends no heartbeat")
            self._send("request_data_stream_send", *self._target, self._mavlink.MAV_DATA_STREAM_ALL, 4, 1)
            self.wait(lambda: self._state.located, timeout_s, "does not say where it is")
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """End the connection; the vehicle goes on with what it does."""
        self._closed = True
        self._reader.join(timeout=5.0)
        self._link.close()

    def __enter__(self) -> "Vehicle":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def state(self) -> VehicleState:
        """What the vehicle has said last; raises ``NoAnswerError`` after a silence of 20 s."""
        with self._changed:
            self._require_heard()
            return self._state

    @property
    def texts(self) -> tuple[str, ...]:
        """Its last messages for people."""
        return tuple(self._texts)

    def captures(self) -> list[Capture]:
        """The photographs that the camera has reported since the last call."""
        with self._changed:
            found = list(self._captures)
            self._captures.clear()
            return found

    def wait(self, condition: Callable[[], bool], timeout_s: float, what: str) -> None:
        """Wait until ``condition`` holds, which is checked after each message.

        Raises ``NoAnswerError`` when the vehicle is silent or the time is over: "The vehicle ``what``".
        """
        until = time.monotonic() + timeout_s
        with self._changed:
            while not condition():
                left = until - time.monotonic()
                if left <= 0:
                    raise NoAnswerError(
                        f"The vehicle {what}.", hint="Check the link, and what its ground station shows."
                    )
                self._changed.wait(min(left, 0.5))
                self._require_heard()

    def upload(self, items: Sequence[MissionItem]) -> None:
        """Replace the vehicle's mission, the first item of which is home.

        Raises ``VehicleError`` when the autopilot refuses it, naming the item, and ``NoAnswerError``. Then
        it has either the mission before or none.
        """
        requests = ("MISSION_REQUEST_INT", "MISSION_REQUEST", "MISSION_ACK")
        self._drain()
        asked = -1
        answer = self._asked(
            lambda: self._send("mission_count_send", *self._target, len(items)), requests, "mission"
        )
        while answer.get_type() != "MISSION_ACK":
            asked = answer.seq
            if not 0 <= asked < len(items):
                raise VehicleError(f"The autopilot asks for item {asked} of {len(items)}.")
            answer = self._asked(partial(self._send_item, asked, items[asked]), requests, "mission")
        if answer.type != self._mavlink.MAV_MISSION_ACCEPTED:
            name = self._name("MAV_MISSION_RESULT", answer.type)
            item = f", at item {asked} (command {items[asked].command})" if asked >= 0 else ""
            raise VehicleError(
                f"The autopilot refuses the mission: {name}{item}.",
                hint="Its firmware may not know the command, or the position is outside of its own fence.",
            )

    def fly(self) -> None:
        """Arm if needed, and fly the mission from its beginning."""
        if not self.state.armed:
            self.set_mode(Mode.GUIDED)
            self.command(self._mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
            self.wait(lambda: self._state.armed, 10.0, "does not arm" + self._said())
        with self._changed:
            self._state = replace(self._state, reached=-1)
        self._send("mission_set_current_send", *self._target, 0)
        self.command(self._mavlink.MAV_CMD_MISSION_START)  # it changes to AUTO, and begins
        self.wait(lambda: self._state.mode != Mode.GUIDED, 10.0, "does not begin its mission" + self._said())

    def pause(self) -> None:
        """Stop where it is; ``resume`` goes on with the mission."""
        self.set_mode(Mode.BRAKE)

    def resume(self) -> None:
        """Go on with the mission after a pause."""
        self.set_mode(Mode.AUTO)

    def hold(self) -> None:
        """Stay where it is, to get another mission."""
        self.set_mode(Mode.GUIDED)

    def return_home(self) -> None:
        """Fly home and land."""
        self.set_mode(Mode.RETURN)

    def set_mode(self, mode: Mode) -> None:
        """Change the flight mode, and wait until the vehicle has it."""
        custom = float(self._mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)
        for _ in range(_TRIES):
            self.command(self._mavlink.MAV_CMD_DO_SET_MODE, custom, float(mode))
            with contextlib.suppress(NoAnswerError):
                self.wait(lambda: self._state.mode == mode, _ANSWER_S, f"does not change to {mode.name}")
                return
        raise VehicleError(f"The vehicle does not change to {mode.name}{self._said()}.")

    def command(self, number: int, *parameters: float) -> None:
        """Send a command and wait until it is accepted; raises ``VehicleError`` when it is refused."""
        given = (*parameters, *(0.0,) * (7 - len(parameters)))

        def send() -> None:
            self._send("command_long_send", *self._target, number, 0, *given)

        self._drain()
        answer = self._asked(
            send, ("COMMAND_ACK",), "command", lambda message: bool(message.command == number)
        )
        if answer.result not in (
            self._mavlink.MAV_RESULT_ACCEPTED,
            self._mavlink.MAV_RESULT_IN_PROGRESS,
        ):
            result, name = self._name("MAV_RESULT", answer.result), self._name("MAV_CMD", number)
            raise VehicleError(f"The autopilot answers {name} with {result}{self._said()}.")

    def _send_item(self, number: int, item: MissionItem) -> None:
        x, y = item.encoded
        self._send(
            "mission_item_int_send",
            *self._target,
            number,
            item.frame,
            item.command,
            int(number == 0),
            1,
            *item.parameters,
            x,
            y,
            item.z,
        )

    def _asked(
        self,
        send: Callable[[], None],
        kinds: Sequence[str],
        what: str,
        fits: Callable[[Any], bool] = lambda _message: True,
    ) -> Any:
        """Send, also again, until a message of one of ``kinds`` comes."""
        for _ in range(_TRIES):
            send()
            until = time.monotonic() + _ANSWER_S
            with self._changed:
                while (left := until - time.monotonic()) > 0:
                    while self._messages:
                        message = self._messages.popleft()
                        if message.get_type() in kinds and fits(message):
                            return message
                    self._changed.wait(left)
        raise NoAnswerError(
            f"The vehicle does not answer a {what}, sent {_TRIES} times.",
            hint="Check the link. The vehicle goes on with what it does.",
        )

    def _drain(self) -> None:
        with self._changed:
            self._messages.clear()

    def _send(self, name: str, *values: Any) -> None:
        with self._sending, contextlib.suppress(OSError):  # a broken link comes back, or is silent
            getattr(self._link.mav, name)(*values)

    def _require_heard(self) -> None:
        silent_s = time.monotonic() - self._heard
        if silent_s > _SILENCE_S:
            raise NoAnswerError(
                f"The vehicle has been silent for {silent_s:.0f} s.",
                hint="It flies its last mission, which ends at home. Check the link.",
            )

    def _said(self) -> str:
        return f" (it says: {self._texts[-1]})" if self._texts else ""

    def _name(self, enum: str, value: int) -> str:
        entry = self._mavlink.enums[enum].get(value)
        return entry.name if entry is not None else str(value)

    def _read(self) -> None:
        beat = -math.inf
        while not self._closed:
            if time.monotonic() - beat >= _HEARTBEAT_S:
                beat = time.monotonic()
                mavlink = self._mavlink
                kinds = (mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID)
                self._send("heartbeat_send", *kinds, 0, 0, mavlink.MAV_STATE_ACTIVE)
            message = None
            with contextlib.suppress(OSError):
                message = self._link.recv_match(blocking=True, timeout=0.2)
            if message is not None:
                with self._changed:
                    self._receive(message)
                    self._changed.notify_all()

    def _receive(self, message: Any) -> None:
        match message.get_type():
            case "HEARTBEAT":
                self._receive_heartbeat(message)
            case "GLOBAL_POSITION_INT":
                yaw = math.nan if message.hdg == 65535 else message.hdg / 100.0
                self._state = replace(
                    self._state,
                    latitude_deg=message.lat / 1e7,
                    longitude_deg=message.lon / 1e7,
                    altitude_m=message.alt / 1e3,
                    height_m=message.relative_alt / 1e3,
                    yaw_deg=yaw,
                )
            case "SYS_STATUS":
                left = message.battery_remaining
                self._state = replace(self._state, battery=None if left < 0 else left / 100.0)
            case "MISSION_CURRENT":
                self._state = replace(self._state, item=message.seq)
            case "MISSION_ITEM_REACHED":
                self._state = replace(self._state, reached=message.seq)
            case "CAMERA_IMAGE_CAPTURED":
                url = message.file_url
                text = url.decode(errors="replace") if isinstance(url, bytes) else url
                name = text.rstrip("\0").rpartition("/")[2]
                self._captures.append(Capture(message.image_index, message.capture_result == 1, name))
            case "STATUSTEXT":
                self._texts.append(message.text)
            case "MISSION_REQUEST" | "MISSION_REQUEST_INT" | "MISSION_ACK" | "COMMAND_ACK":
                self._messages.append(message)

    def _receive_heartbeat(self, message: Any) -> None:
        mavlink = self._mavlink
        if message.autopilot == mavlink.MAV_AUTOPILOT_INVALID:  # another ground station, a camera, a gimbal
            return
        self._heard = time.monotonic()
        self._target = (message.get_srcSystem(), message.get_srcComponent())
        armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        self._state = replace(self._state, armed=armed, mode=message.custom_mode)


def _mavutil() -> Any:
    os.environ["MAVLINK20"] = "1"  # version 1 of the protocol has no messages of cameras
    try:
        from pymavlink import mavutil
    except ModuleNotFoundError:
        raise VehicleError(
            "MAVLink needs pymavlink.", hint="Install it: pip install 'fvs-client[fly]'."
        ) from None
    return mavutil
