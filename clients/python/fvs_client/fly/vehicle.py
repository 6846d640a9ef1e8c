"""A vehicle that speaks MAVLink, an ArduPilot copter's or PX4's: its state, missions and commands."""

import contextlib
import math
import re
import struct
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from fvs_client.fly.captures import Capture, Captures
from fvs_client.fly.dialects import Dialect, Mode, dialect_of
from fvs_client.fly.errors import NoAnswerError, VehicleError
from fvs_client.fly.home import Home
from fvs_client.fly.items import MissionItem
from fvs_client.fly.link import Link
from fvs_client.fly.own_fence import OwnFence, read_fence, upload_fence
from fvs_client.fly.read_back import require_same
from fvs_client.fly.upload import upload
from fvs_schema.fence import Fence
from fvs_schema.missions import Autopilot

__all__ = ["Capture", "Equipment", "Mode", "Vehicle", "VehicleState"]

_FIX_3D = 3
"""``GPS_FIX_TYPE_3D_FIX``."""
_FIX_S = 300.0
_CHANGE_S = 3.0
_NOT_FLOWN = re.compile("^Mission rejected|^Geofence violation for waypoint")
"""PX4's texts (``FeasibilityChecker.cpp``)."""
_TRIES = 4
_EQUIPMENT_S = 1.0
_TEXT_S = 0.5
"""Autopilots refuse a command before they say why."""
_UNKNOWN_TOTALS = (0, 65_535)
"""Values of ``MISSION_CURRENT.total``: it is not told, or there is no mission."""


@dataclass(frozen=True)
class Equipment:
    """The equipment that a vehicle reports; None where it has none."""

    camera: str | None
    """Its name."""
    gimbal_deg: tuple[float, float] | None
    """The lowest and the highest pitch of the gimbal."""


@dataclass(frozen=True)
class VehicleState:
    """The state that a vehicle reported last. Altitudes are above sea level, heights above home."""

    latitude_deg: float = math.nan
    longitude_deg: float = math.nan
    altitude_m: float = math.nan
    height_m: float = math.nan
    yaw_deg: float = math.nan
    battery: float | None = None
    """The share of the battery that is left, in [0, 1]; None when the vehicle does not report it."""
    armed: bool = False
    mode: Mode = Mode.OTHER
    custom_mode: int = -1
    """The mode as the firmware numbers it."""
    mode_name: str = ""
    """The mode as the firmware names it."""
    failsafe: bool = False
    """Whether its failsafe acts."""
    item: int = 0
    """The number of the mission item that it is at, in the list that was uploaded, whose first is home."""
    replaced_by: int | None = None
    """Number of items, with home, of another mission than the one that was uploaded; None as far as known."""
    fix: int = 0
    """The kind of its GPS fix, ``GPS_FIX_TYPE``; 0 when it reports none."""
    satellites: int = 0

    @property
    def place(self) -> tuple[float, float]:
        """Its latitude and longitude."""
        return self.latitude_deg, self.longitude_deg

    @property
    def located(self) -> bool:
        """Whether its position is known."""
        return math.isfinite(self.latitude_deg)


class Vehicle:
    """A connection to one vehicle. All methods may be called from any thread.

    ``url`` is pymavlink's: ``tcp:127.0.0.1:5760``, ``udpin:0.0.0.0:14550``, ``/dev/ttyUSB0``. ``system`` is
    the MAVLink id of the vehicle, if there are several on the link, ``signing_key`` the 32 bytes that sign
    its messages. Waits until the vehicle has a GPS fix and
    a home; ``say`` gets what is waited for. Raises ``VehicleError`` without pymavlink, for several vehicles,
    for one that is no copter of ArduPilot or PX4 or gets no fix, and ``NoAnswerError`` when none answers.
    """

    def __init__(
        self,
        url: str,
        *,
        system: int | None = None,
        baud: int = 57_600,
        signing_key: bytes | None = None,
        timeout_s: float = 30.0,
        say: Callable[[str], None] = lambda _line: None,
    ) -> None:
        self._state = VehicleState()
        self._home: Home | None = None
        self._texts: deque[tuple[float, str]] = deque(maxlen=100)
        self._warnings: deque[str] = deque(maxlen=100)
        self._received: dict[str, Any] = {}
        self._sent: int | None = None
        """Number of items, with home, of the mission that it has got here; None before, and in an upload."""
        self._captures = Captures(self._ask_for_photograph)
        self._link = Link(url, baud=baud, system=system, heard=self._receive, key=signing_key)
        self._mavlink = self._link.mavlink
        try:
            heartbeat = self._link.find(timeout_s)
            self.dialect: Dialect = dialect_of(heartbeat.autopilot, heartbeat.type)
            with self._link.changed:
                self._receive(heartbeat)
            self._link.listen_to(heartbeat)
            streams = (self._mavlink.MAV_DATA_STREAM_ALL, 4, 1)
            self._link.send("request_data_stream_send", *self._link.target, *streams)
            self._wait_for_position(say)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """End the connection; the vehicle continues what it does."""
        self._link.close()

    def __enter__(self) -> "Vehicle":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def state(self) -> VehicleState:
        """The state that the vehicle reported last; raises ``NoAnswerError`` after a silence of 20 s."""
        with self._link.changed:
            self._link.require_heard()
            return self._state

    @property
    def last_state(self) -> VehicleState:
        """The state that the vehicle reported last, however long ago."""
        with self._link.changed:
            return self._state

    @property
    def home(self) -> Home:
        """Its home as it reported it last."""
        with self._link.changed:
            assert self._home is not None, "it is waited for at the beginning"
            return self._home

    def read_home(self) -> Home:
        """Request home again: arming sets it."""
        self._asked(self._mavlink.MAVLINK_MSG_ID_HOME_POSITION, "HOME_POSITION")
        return self.home

    def said(self, seconds: float) -> list[str]:
        """Its messages for people of the last ``seconds``, the oldest first."""
        since_s = time.monotonic() - seconds
        with self._link.changed:
            return [text for at_s, text in self._texts if at_s >= since_s]

    def warnings(self) -> list[str]:
        """Its warnings, and worse, since the last call."""
        with self._link.changed:
            found = list(self._warnings)
            self._warnings.clear()
            return found

    def captures(self) -> list[Capture]:
        """The photographs that the camera has reported since the last call."""
        with self._link.changed:
            return self._captures.take()

    def recover_captures(self) -> None:
        """Request the reports of photographs that were lost with the link; ``captures`` has them soon."""
        self._request(self._mavlink.MAVLINK_MSG_ID_CAMERA_CAPTURE_STATUS)

    def photograph(self) -> None:
        """Take one photograph now; raises ``VehicleError`` when that is refused.

        ArduPilot accepts it without a camera, too. PX4 gives it to its camera trigger, as it does with the
        photographs of missions; without one, nobody answers.
        """
        try:
            self.command(self._mavlink.MAV_CMD_DO_DIGICAM_CONTROL, 0.0, 0.0, 0.0, 0.0, 1.0)
        except NoAnswerError as error:
            self._link.require_heard()
            if self.dialect.autopilot is not Autopilot.PX4:
                raise
            raise VehicleError(
                "Its camera trigger does not answer.", hint="TRIG_MODE 1 starts it."
            ) from error

    def equipment(self) -> Equipment:
        """Request the vehicle's equipment."""
        mavlink = self._mavlink
        camera = self._asked(mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION, "CAMERA_INFORMATION")
        gimbal = self._asked(mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION, "GIMBAL_MANAGER_INFORMATION")
        name = "" if camera is None and self._has_trigger() else None
        if camera is not None:
            self.recover_captures()  # how many there are before the flight
            name = f"{_text(camera.vendor_name)} {_text(camera.model_name)}".strip()
        pitch = None if gimbal is None else (math.degrees(gimbal.pitch_min), math.degrees(gimbal.pitch_max))
        return Equipment(name, pitch)

    def _has_trigger(self) -> bool:
        """Whether it is a PX4 that triggers a camera on a wire, of which it reports nothing."""
        return (
            self.dialect.autopilot is Autopilot.PX4 and self.parameters(["TRIG_MODE"]).get("TRIG_MODE", 0) > 0
        )

    def parameters(self, names: Sequence[str]) -> dict[str, float]:
        """The values of those parameters that the autopilot has; it does not answer for others."""
        with self._link.changed:
            for name in names:
                self._received.pop(name, None)
        for _ in range(2):
            missing = [name for name in names if name not in self._received]
            for name in missing:
                self._link.send("param_request_read_send", *self._link.target, name.encode(), -1)
            with self._link.changed:
                self._link.changed.wait_for(
                    lambda missing=missing: all(name in self._received for name in missing),  # type: ignore[misc]
                    _EQUIPMENT_S,
                )
        self._link.require_heard()
        return {name: self._value(self._received[name]) for name in names if name in self._received}

    def version(self) -> str | None:
        """The version of its firmware; None when it does not report it."""
        message = self._asked(self._mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, "AUTOPILOT_VERSION")
        if message is None:
            return None
        return ".".join(str(message.flight_sw_version >> bits & 0xFF) for bits in (24, 16, 8))

    def arming_objections(self) -> list[str]:
        """Have it run its checks before arming; returns what fails in its own words."""
        began_s = time.monotonic()
        with contextlib.suppress(VehicleError):  # a firmware without the command
            self.command(self._mavlink.MAV_CMD_RUN_PREARM_CHECKS)
            time.sleep(_EQUIPMENT_S)
        said = self.said(time.monotonic() - began_s)
        return [text for text in said if text.startswith(("PreArm", "Arm:", "Preflight Fail"))]

    @property
    def stations(self) -> frozenset[int]:
        """The system ids of the ground stations whose heartbeats arrive here."""
        return self._link.stations

    @property
    def wind_m_s(self) -> float | None:
        """Its estimate of the wind; None when it reports none."""
        message = self._received.get("WIND")
        return None if message is None else float(message.speed)

    def wait(self, condition: Callable[[], bool], timeout_s: float, what: str) -> None:
        """Wait until ``condition`` holds, which is checked after each message.

        Raises ``NoAnswerError`` when the vehicle is silent, and ``VehicleError`` when the time is over: "The
        vehicle ``what``".
        """
        self._link.wait(condition, timeout_s, what)

    def upload(self, items: Sequence[MissionItem]) -> None:
        """Replace the vehicle's mission and read it back; the first item is home.

        Raises ``VehicleError`` when the autopilot refuses it, naming the item, or has another one afterwards
        or one that it does not fly, and ``NoAnswerError``.
        """
        began_s = time.monotonic()
        self._know_mission(None)
        upload(self._link, items[self._not_sent :], self._not_sent)
        self._know_mission(len(items))
        if not self.dialect.replaces_items:  # it is at another item now
            self._forget_item()
        require_same(self._link, items[self._not_sent :], self._not_sent, self.dialect)
        objections = [text for text in self.said(time.monotonic() - began_s) if _NOT_FLOWN.search(text)]
        if objections:  # PX4 takes a mission before it checks it
            raise VehicleError(
                f"The autopilot has the mission, and does not fly it: {'; '.join(objections)}",
                hint="A parameter of the vehicle, or its fence, forbids it.",
            )

    def _know_mission(self, count: int | None) -> None:
        with self._link.changed:
            self._sent, self._state = count, replace(self._state, replaced_by=None)

    def fence(self) -> OwnFence | None:
        """Its own fence; None when it stores none, or does not say."""
        try:
            return read_fence(self._link)
        except NoAnswerError:
            self._link.require_heard()
            return None

    def replace_fence(self, fence: Fence) -> None:
        """Replace its own fence by this polygon, on the ground; raises as ``upload`` does, and when armed."""
        if self.state.armed:
            raise VehicleError(
                "The vehicle is armed: its fence is not replaced.", hint="Fly without --upload-fence."
            )
        upload_fence(self._link, fence)

    def arm(self) -> None:
        """Start the motors, on the ground."""
        self.set_mode(Mode.HOLD)
        if not self.state.armed:
            began_s, mode = time.monotonic(), self.dialect.custom_mode(Mode.HOLD)
            self.command(
                self._mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
                1.0,
                done=lambda: self._state.armed or self._state.custom_mode != mode,
            )
            self.wait(lambda: self._state.armed, 10.0, "does not arm" + self._said_since(began_s))

    def disarm(self) -> None:
        """Stop the motors, on the ground."""
        self.command(self._mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0)
        self.wait(lambda: not self._state.armed, 10.0, "does not disarm")

    def begin(self, first: int, last: int) -> None:
        """Fly the mission from item ``first``, and wait until it is at an item from there to ``last``.

        A vehicle in the mode of missions stays in it. Returns also when somebody else changes its mode.
        """
        began_s, state = time.monotonic(), self.last_state
        before = state.custom_mode
        if self.dialect.replaces_items or state.mode is not Mode.MISSION:
            self._forget_item()
        elif self._soon_flies(first, last, before):  # it has begun with the upload: not a second time
            return
        for _ in range(_TRIES):
            self._go_to(first)
            if state.mode is not Mode.MISSION and self._state.custom_mode == before:
                self.command(
                    self._mavlink.MAV_CMD_MISSION_START, done=lambda: self._state.custom_mode != before
                )
            if self._soon_flies(first, last, before):
                return
        raise VehicleError(f"The vehicle does not begin its mission{self._said_since(began_s)}.")

    def pause(self) -> None:
        """Stop where it is; ``resume`` continues the mission."""
        self.set_mode(Mode.PAUSE)

    def resume(self, item: int) -> None:
        """Continue the mission after a pause, from an item.

        It is sent in the pause, and again in the mission: ArduPilot's ``MIS_RESTART`` would begin anew.
        """
        self._go_to(item)
        self.set_mode(Mode.MISSION)
        self._go_to(item)

    def set_mode(self, mode: Mode) -> None:
        """Change the flight mode and wait until the vehicle reports it.

        Raises ``VehicleError`` when it does not change, or changes to another: somebody else has taken over.
        """
        before, began_s = self.last_state.custom_mode, time.monotonic()
        numbers = (self._mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, *self.dialect.modes[mode])
        wanted = self.dialect.custom_mode(mode)
        for _ in range(_TRIES):
            if self.last_state.custom_mode not in (before, wanted):
                raise VehicleError("Somebody else changes the vehicle's mode.")
            self.command(
                self._mavlink.MAV_CMD_DO_SET_MODE,
                *map(float, numbers),
                done=lambda: self._state.custom_mode != before,
            )
            until = time.monotonic() + _CHANGE_S
            with self._link.changed:
                while self._state.custom_mode != wanted and (left := until - time.monotonic()) > 0:
                    self._link.changed.wait(left)
                if self._state.custom_mode == wanted:
                    return
        raise VehicleError(
            f"The vehicle does not change to {mode.name}{self._said_since(began_s)}.",
            hint="A pilot's remote control, or a check before arming, may forbid it.",
        )

    def command(self, number: int, *parameters: float, done: Callable[[], bool] = lambda: False) -> None:
        """Send a command and wait until it is accepted; raises ``VehicleError`` when it is refused.

        It is sent again where no answer comes, but not once ``done`` holds: a pilot may have taken over.
        """
        began_s = time.monotonic()
        given = (*parameters, *(0.0,) * (7 - len(parameters)))
        self._link.forget_answers()
        answer = self._link.ask(
            lambda: self._link.send("command_long_send", *self._link.target, number, 0, *given),
            ("COMMAND_ACK",),
            "command",
            lambda message: bool(message.command == number),
            done,
        )
        if answer is not None and answer.result not in (
            self._mavlink.MAV_RESULT_ACCEPTED,
            self._mavlink.MAV_RESULT_IN_PROGRESS,
        ):
            result, name = self._name("MAV_RESULT", answer.result), self._name("MAV_CMD", number)
            time.sleep(_TEXT_S)
            raise VehicleError(
                f"The autopilot answers {name} with {result}{self._said_since(began_s)}.",
                hint="Look at its messages in a ground station: checks before arming, its mode, its fence.",
            )

    @property
    def _not_sent(self) -> int:
        """Number of items of a mission, home first, that are not sent to the autopilot."""
        return 0 if self.dialect.home_is_first else 1

    def _soon_flies(self, first: int, last: int, before: int) -> bool:
        """Whether it is soon at one of these items, or in a mode that nobody commanded here."""

        def flies() -> bool:
            state = self._state
            if state.mode is Mode.MISSION:
                return first <= state.item <= last
            return state.custom_mode != before

        with self._link.changed:
            return bool(self._link.changed.wait_for(flies, _CHANGE_S))

    def _forget_item(self) -> None:
        """Count only what it reports from now on."""
        with self._link.changed:
            self._state = replace(self._state, item=-1)

    def _go_to(self, item: int) -> None:
        """Make an item the current one, without waiting."""
        self._link.send("mission_set_current_send", *self._link.target, item - self._not_sent)

    def _wait_for_position(self, say: Callable[[str], None]) -> None:
        """Wait for a GPS fix, a position and a home."""
        until, said = time.monotonic() + _FIX_S, ""
        while missing := self._missing():
            if missing != said:
                said = missing
                say(f"The vehicle {missing}: waiting for it.")
            if time.monotonic() > until:
                raise VehicleError(
                    f"The vehicle {missing}.", hint="Look at its GPS in a ground station: is the sky open?"
                )
            self._link.require_heard()
            self._request(self._mavlink.MAVLINK_MSG_ID_HOME_POSITION)
            with self._link.changed:
                self._link.changed.wait_for(lambda: not self._missing(), 1.0)

    @property
    def _placed(self) -> bool:
        """Whether it has, or had, a GPS fix: ArduPilot sends zeros before."""
        return self._state.located or self._state.fix >= _FIX_3D

    def _missing(self) -> str:
        """What is missing to know where it is."""
        if self._state.fix < _FIX_3D:
            return f"has no GPS fix yet (GPS_RAW_INT: fix_type {self._state.fix})"
        if not self._state.located:
            return "has no position yet (GLOBAL_POSITION_INT)"
        return "" if self._home is not None else "has no home yet (HOME_POSITION)"

    def _request(self, message: int, number: int = 0) -> None:
        """Request a message from all components of the vehicle, without waiting."""
        command, (system, _) = self._mavlink.MAV_CMD_REQUEST_MESSAGE, self._link.target
        parameters = (float(message), float(number), 0.0, 0.0, 0.0, 0.0, 0.0)
        self._link.send("command_long_send", system, 0, command, 0, *parameters)

    def _asked(self, message: int, name: str) -> Any:
        """Request a message; None when no part of the vehicle sends it."""
        return self._awaited(name, lambda: self._request(message))

    def _awaited(self, name: str, ask: Callable[[], None]) -> Any:
        """The next message of this name after ``ask``, which is called up to twice; None without it."""
        with self._link.changed:
            self._received.pop(name, None)
        for _ in range(2):
            ask()
            until = time.monotonic() + _EQUIPMENT_S
            with self._link.changed:
                while name not in self._received and (left := until - time.monotonic()) > 0:
                    self._link.changed.wait(left)
                if name in self._received:
                    return self._received[name]
        return None

    def _value(self, message: Any) -> float:
        """The value of a ``PARAM_VALUE``: PX4 sends the bits of whole numbers."""
        real = message.param_type in (
            self._mavlink.MAV_PARAM_TYPE_REAL32,
            self._mavlink.MAV_PARAM_TYPE_REAL64,
        )
        if real or self.dialect.autopilot is not Autopilot.PX4:
            return float(message.param_value)
        return float(struct.unpack("<i", struct.pack("<f", message.param_value))[0])

    def _ask_for_photograph(self, number: int) -> None:
        self._request(self._mavlink.MAVLINK_MSG_ID_CAMERA_IMAGE_CAPTURED, number)

    def _said_since(self, began_s: float) -> str:
        texts = self.said(time.monotonic() - began_s)
        return f" (it says: {'; '.join(texts[-3:])})" if texts else ""

    def _name(self, enum: str, value: int) -> str:
        entry = self._mavlink.enums[enum].get(value)
        return entry.name if entry is not None else str(value)

    def _receive(self, message: Any) -> None:
        match message.get_type():
            case "HEARTBEAT":
                self._state = replace(
                    self._state,
                    armed=bool(message.base_mode & self._mavlink.MAV_MODE_FLAG_SAFETY_ARMED),
                    mode=self.dialect.mode_of(message.custom_mode),
                    custom_mode=message.custom_mode,
                    failsafe=message.system_status == self._mavlink.MAV_STATE_CRITICAL,
                    mode_name=self._link.mode_name(message),
                )
            case "GPS_RAW_INT":
                self._state = replace(
                    self._state, fix=message.fix_type, satellites=message.satellites_visible
                )
            case "GLOBAL_POSITION_INT" if self._placed and (message.lat or message.lon):
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
                self._state = replace(self._state, item=message.seq + self._not_sent)
                if self._sent is not None and message.total not in _UNKNOWN_TOTALS:
                    count = message.total + 1  # home is not counted
                    self._state = replace(self._state, replaced_by=None if count == self._sent else count)
            case "CAMERA_IMAGE_CAPTURED":
                home_m = math.nan if self._home is None else self._home.altitude_m
                self._captures.add(message, home_m)
            case "CAMERA_FEEDBACK":
                self._captures.add_feedback(message)
            case "CAMERA_CAPTURE_STATUS":
                component = message.get_srcComponent()
                self._captures.are(component, message.image_count, message.time_boot_ms)
            case "STATUSTEXT":
                self._texts.append((time.monotonic(), message.text))
                if message.severity <= self._mavlink.MAV_SEVERITY_WARNING:
                    self._warnings.append(message.text)
            case "HOME_POSITION":
                if message.latitude or message.longitude:
                    place = message.latitude / 1e7, message.longitude / 1e7
                    self._home = Home(*place, message.altitude / 1e3)
                    self._received[message.get_type()] = message
            case "PARAM_VALUE":
                self._received[message.param_id] = message
            case "CAMERA_INFORMATION" | "GIMBAL_MANAGER_INFORMATION" | "AUTOPILOT_VERSION" | "WIND":
                self._received[message.get_type()] = message


def _text(name: Any) -> str:
    """A name that is an array of bytes."""
    return bytes(name).rstrip(b"\0").decode(errors="replace")
