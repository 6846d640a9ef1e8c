"""A connection to a vehicle that speaks MAVLink: what it reports, and answers when it is asked."""

import math
import struct
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Self

from fvs_client.fly.captures import Capture
from fvs_client.fly.dialects import Dialect, dialect_of
from fvs_client.fly.errors import VehicleError
from fvs_client.fly.link import Link
from fvs_client.fly.places import Home
from fvs_client.fly.telemetry import Telemetry, VehicleState
from fvs_schema.missions import Autopilot

_FIX_S = 300.0
_EQUIPMENT_S = 1.0


@dataclass(frozen=True)
class Equipment:
    """The equipment that a vehicle reports; None where it has none."""

    camera: str | None
    """Its name."""
    gimbal_deg: tuple[float, float] | None
    """The lowest and the highest pitch of the gimbal."""


class Connection:
    """A connection to one vehicle. All methods may be called from any thread.

    ``url`` is pymavlink's: ``tcp:127.0.0.1:5760``, ``udpin:0.0.0.0:14550``, ``/dev/ttyUSB0``. ``system`` is
    the MAVLink id of the vehicle, if there are several on the link, ``signing_key`` the 32 bytes that sign
    its messages. Waits until the vehicle has a GPS fix and a home; ``say`` gets what is waited for. Raises
    ``VehicleError`` without pymavlink, for several vehicles, for one that is no copter of ArduPilot or PX4
    or gets no fix, and ``NoAnswerError`` when none answers.
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
        self._link = Link(url, baud=baud, system=system, heard=self._receive, key=signing_key)
        self._mavlink = self._link.mavlink
        try:
            heartbeat = self._link.find(timeout_s)
            self.dialect: Dialect = dialect_of(heartbeat.autopilot, heartbeat.type)
            self._telemetry = Telemetry(
                self._mavlink, self.dialect, self._link.mode_name, self._ask_for_photograph
            )
            with self._link.changed:
                self._telemetry.receive(heartbeat)
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

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def state(self) -> VehicleState:
        """The state that the vehicle reported last; raises ``NoAnswerError`` after a silence of 20 s."""
        with self._link.changed:
            self._link.require_heard()
            return self._telemetry.state

    @property
    def last_state(self) -> VehicleState:
        """The state that the vehicle reported last, however long ago."""
        with self._link.changed:
            return self._telemetry.state

    @property
    def home(self) -> Home:
        """Its home as it reported it last."""
        with self._link.changed:
            assert self._telemetry.home is not None, "it is waited for at the beginning"
            return self._telemetry.home

    def read_home(self) -> Home:
        """Request home again: arming sets it."""
        self._asked(self._mavlink.MAVLINK_MSG_ID_HOME_POSITION, "HOME_POSITION")
        return self.home

    def said(self, seconds: float) -> list[str]:
        """Its messages for people of the last ``seconds``, the oldest first."""
        since_s = time.monotonic() - seconds
        with self._link.changed:
            return [text for at_s, text in self._telemetry.texts if at_s >= since_s]

    def _said_since(self, began_s: float) -> str:
        texts = self.said(time.monotonic() - began_s)
        return f" (it says: {'; '.join(texts[-3:])})" if texts else ""

    def warnings(self) -> list[str]:
        """Its warnings, and worse, since the last call."""
        with self._link.changed:
            found = list(self._telemetry.warnings)
            self._telemetry.warnings.clear()
            return found

    def captures(self) -> list[Capture]:
        """The photographs that the camera has reported since the last call."""
        with self._link.changed:
            return self._telemetry.captures.take()

    def recover_captures(self) -> None:
        """Request the reports of photographs that were lost with the link; ``captures`` has them soon."""
        self._request(self._mavlink.MAVLINK_MSG_ID_CAMERA_CAPTURE_STATUS)

    @property
    def stood_still_s(self) -> float:
        """The longest time for which this program did not run."""
        return self._link.stood_still_s

    @property
    def stations(self) -> frozenset[int]:
        """The system ids of the ground stations whose heartbeats arrive here."""
        return self._link.stations

    @property
    def wind_m_s(self) -> float | None:
        """Its estimate of the wind; None when it reports none."""
        message = self._telemetry.received.get("WIND")
        return None if message is None else float(message.speed)

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
                self._telemetry.received.pop(name, None)
        for _ in range(2):
            missing = [name for name in names if name not in self._telemetry.received]
            for name in missing:
                self._link.send("param_request_read_send", *self._link.target, name.encode(), -1)
            with self._link.changed:
                self._link.changed.wait_for(
                    lambda missing=missing: all(name in self._telemetry.received for name in missing),  # type: ignore[misc]
                    _EQUIPMENT_S,
                )
        self._link.require_heard()
        return {
            name: self._value(self._telemetry.received[name])
            for name in names
            if name in self._telemetry.received
        }

    def version(self) -> str | None:
        """The version of its firmware; None when it does not report it."""
        message = self._asked(self._mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, "AUTOPILOT_VERSION")
        if message is None:
            return None
        return ".".join(str(message.flight_sw_version >> bits & 0xFF) for bits in (24, 16, 8))

    def wait(self, condition: Callable[[], bool], timeout_s: float, what: str) -> None:
        """Wait until ``condition`` holds, which is checked after each message.

        Raises ``NoAnswerError`` when the vehicle is silent, and ``VehicleError`` when the time is over: "The
        vehicle ``what``".
        """
        self._link.wait(condition, timeout_s, what)

    def _wait_for_position(self, say: Callable[[str], None]) -> None:
        """Wait for a GPS fix, a position and a home."""
        until, said = time.monotonic() + _FIX_S, ""
        while missing := self._telemetry.missing():
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
                self._link.changed.wait_for(lambda: not self._telemetry.missing(), 1.0)

    def _request(self, message: int, number: int = 0) -> None:
        """Request a message from all components of the vehicle, without waiting."""
        command, (system, _) = self._mavlink.MAV_CMD_REQUEST_MESSAGE, self._link.target
        parameters = (float(message), float(number), 0.0, 0.0, 0.0, 0.0, 0.0)
        self._link.send("command_long_send", system, 0, command, 0, *parameters)

    def _asked(self, message: int, name: str) -> Any:
        """Request a message, up to twice; None when no part of the vehicle sends it."""
        received = self._telemetry.received
        with self._link.changed:
            received.pop(name, None)
        for _ in range(2):
            self._request(message)
            with self._link.changed:
                if self._link.changed.wait_for(lambda: name in received, _EQUIPMENT_S):
                    return received[name]
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

    def _receive(self, message: Any) -> None:
        self._telemetry.receive(message)

    def _ask_for_photograph(self, number: int) -> None:
        self._request(self._mavlink.MAVLINK_MSG_ID_CAMERA_IMAGE_CAPTURED, number)


def _text(name: Any) -> str:
    """Decode a ``char[]`` field, padded with zeros."""
    return bytes(name).rstrip(b"\0").decode(errors="replace")
