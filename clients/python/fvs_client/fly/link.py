"""A MAVLink connection to one vehicle, read in a thread. Needs pymavlink."""

import contextlib
import math
import os
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

from fvs_client.fly.errors import NoAnswerError, VehicleError

SYSTEM, _COMPONENT = 245, 191
"""An onboard computer (``MAV_COMP_ID_ONBOARD_COMPUTER``) with an id that no ground station has: a failsafe
for lost ground stations must not take its heartbeats for theirs."""
_VERSION_2 = 0xFD
"""The first byte of a message of MAVLink 2."""
_SIGNED = 1
"""``MAVLINK_IFLAG_SIGNED``, a bit of ``incompat_flags``, the third byte of a message."""
_BEGAN_2015_S = 1_420_070_400
_TICKS_PER_S = 100_000
"""Signatures count 10 µs since 2015: https://mavlink.io/en/guide/message_signing.html."""
_VERSION_2_S = 3.0
"""Autopilots that begin with MAVLink 1 have answered in MAVLink 2 by then."""
STOOD_STILL_S = 10.0
"""A program that did not run for this long sends nothing of before: the vehicle may not be where it was."""
_HEARTBEAT_S = 1.0
_ANSWER_S = 3.0
_TRIES = 4
_SILENCE_S = 20.0
"""A vehicle without a heartbeat for this long is lost."""
_OTHERS_S = 1.2
"""Autopilots send a heartbeat every second: after this time all of them have been received."""
_ADDRESSED = frozenset(
    {
        "COMMAND_ACK",
        "MISSION_ACK",
        "MISSION_COUNT",
        "MISSION_ITEM_INT",
        "MISSION_REQUEST",
        "MISSION_REQUEST_INT",
    }
)


class Link:
    """A connection to the vehicle with the MAVLink id ``system``, or the only one; ``heard`` gets messages.

    All methods may be called from any thread. ``heard`` is called in the thread that reads, while ``changed``
    is held; after it, those who wait for ``changed`` are notified. With a ``key`` of 32 bytes messages are
    signed, and those that are not signed by it are ignored.

    Raises ``VehicleError`` without pymavlink, and ``NoAnswerError`` when the ``url`` cannot be opened.
    """

    def __init__(
        self,
        url: str,
        *,
        baud: int,
        system: int | None,
        heard: Callable[[Any], None],
        key: bytes | None = None,
    ) -> None:
        self._mavutil = mavutil = _mavutil()
        try:
            self._link: Any = mavutil.mavlink_connection(
                url,
                baud=baud,
                source_system=SYSTEM,
                source_component=_COMPONENT,
                autoreconnect=True,
                dialect="ardupilotmega",  # it contains common
            )
        except ModuleNotFoundError as error:
            raise VehicleError(
                f"{url} is a serial device, which needs pyserial.", hint="pip install pyserial"
            ) from error
        except (OSError, ValueError) as error:
            raise NoAnswerError(
                f"{url} cannot be opened: {error}.",
                hint="Is the autopilot or its router running, and no other program connected to it?",
            ) from error
        self.mavlink: Any = mavutil.mavlink  # which opening the link has set, whatever was imported before
        self._key = key
        if key is not None:
            self._link.setup_signing(key)
        self.changed = threading.Condition()
        self._sending = threading.Lock()
        self._heard_s = time.monotonic()
        self._answers: deque[Any] = deque(maxlen=1_000)
        self._system, self._handle = system, heard
        self._target: tuple[int, int] | None = None
        self._heartbeats: dict[int, Any] = {}
        """The first heartbeat of each vehicle on the link."""
        self.stations: frozenset[int] = frozenset()
        """The system ids of the ground stations whose heartbeats arrive."""
        self._another = self._version_2 = self._signed = False
        """Whether another client has our id, and whether the vehicle speaks MAVLink 2, and signs."""
        self._rejected: VehicleError | None = None
        """Why the vehicle's heartbeats are ignored, if they are for their signature."""
        self._rejected_s = math.inf
        """When that was first seen."""
        self.stood_still_s = 0.0
        """The longest time for which this program did not run: it was stopped, or hung."""
        self._closed = False
        self._reader = threading.Thread(target=self._read, name="mavlink", daemon=True)
        self._reader.start()

    def mode_name(self, heartbeat: Any) -> str:
        """The firmware's name of the mode in a heartbeat."""
        return str(self._mavutil.mode_string_v10(heartbeat))

    def close(self) -> None:
        """End the connection; the vehicle continues what it does."""
        self._closed = True
        self._reader.join(timeout=5.0)
        with contextlib.suppress(OSError, AttributeError):  # pymavlink's, of a link that is broken
            self._link.close()

    @property
    def target(self) -> tuple[int, int]:
        """The vehicle's system and component."""
        return self._target or (0, 0)

    def find(self, timeout_s: float) -> Any:
        """Wait for the vehicle, return its heartbeat.

        Raises ``VehicleError`` where there are several, another client, or one that signs otherwise.
        """
        until = time.monotonic() + timeout_s
        with self.changed:
            while self._wanted() is None:
                left = min(until, self._rejected_s + _VERSION_2_S) - time.monotonic()
                if left <= 0:
                    raise self._rejected or self._not_found(timeout_s)
                self.changed.wait(left)
            self.changed.wait_for(lambda: self._another or self._ambiguous, _OTHERS_S)
            if self._ambiguous:
                systems = " and ".join(map(str, sorted(self._heartbeats)))
                raise VehicleError(
                    f"The vehicles {systems} are on this link.", hint="Say which one to fly: --system N."
                )
            if self._another:
                raise VehicleError(
                    "Another fvs-client is connected to this vehicle.",
                    hint="End it: two programs that send missions would take the vehicle from each other.",
                )
            found = self._wanted()
            assert found is not None, "a heartbeat stays"
            return found

    def listen_to(self, heartbeat: Any) -> None:
        """Ignore all vehicles except the one that sent this heartbeat.

        Raises ``VehicleError`` when it does not speak MAVLink 2, or signs and there is no key.
        """
        with self.changed:
            self._target = (heartbeat.get_srcSystem(), heartbeat.get_srcComponent())
            if not self.changed.wait_for(lambda: self._version_2, _VERSION_2_S):
                raise VehicleError(
                    "The vehicle speaks MAVLink 1, which has no messages of cameras.",
                    hint="Set version 2 of this link: ArduPilot's SERIALn_PROTOCOL 2, PX4's MAV_PROTO_VER 2.",
                )
            if self._signed and self._key is None:
                raise VehicleError(
                    "The vehicle signs its messages, and ignores others.",
                    hint="Give the passphrase of its key: --signing-key FILE.",
                )

    def require_heard(self) -> None:
        """Raise ``NoAnswerError`` after a silence of 20 s."""
        silent_s = time.monotonic() - self._heard_s
        if silent_s > _SILENCE_S:
            raise NoAnswerError(
                f"The vehicle has been silent for {silent_s:.0f} s.",
                hint="A mission that it flies ends at home. Check the link.",
            )

    def wait(self, condition: Callable[[], bool], timeout_s: float, what: str) -> None:
        """Wait until ``condition`` holds, which is checked after each message.

        Raises ``NoAnswerError`` when the vehicle is silent, and ``VehicleError`` when the time is over: "The
        vehicle ``what``".
        """
        until = time.monotonic() + timeout_s
        with self.changed:
            while not condition():
                left = until - time.monotonic()
                if left <= 0:
                    raise VehicleError(
                        f"The vehicle {what}.", hint="Look at what its ground station shows, and at the link."
                    )
                self.changed.wait(min(left, 0.5))
                self.require_heard()

    def send(self, name: str, *values: Any) -> None:
        """Send a message; lost where the link is broken."""
        with self._sending, contextlib.suppress(OSError):
            getattr(self._link.mav, name)(*values)

    def forget_answers(self) -> None:
        """Discard unread answers."""
        with self.changed:
            self._answers.clear()

    def ask(
        self,
        send: Callable[[], None],
        kinds: Sequence[str],
        what: str,
        fits: Callable[[Any], bool] = lambda _message: True,
        done: Callable[[], bool] = lambda: False,
    ) -> Any:
        """Send, repeatedly, until a message of one of ``kinds`` arrives that ``fits``; return it.

        None when ``done`` holds first, which is checked after each message: then nothing is sent again.
        Raises ``NoAnswerError``, and ``VehicleError`` when this program stood still meanwhile.
        """
        found: list[Any] = []

        def over() -> bool:
            while self._answers and not found:
                message = self._answers.popleft()
                if message.get_type() in kinds and fits(message):
                    found.append(message)
            return bool(found) or done()

        for _ in range(_TRIES):
            sent_s = time.monotonic()
            send()
            with self.changed:
                if self.changed.wait_for(over, _ANSWER_S):
                    return found[0] if found else None
            if (late_s := time.monotonic() - sent_s) > _ANSWER_S + STOOD_STILL_S:
                raise VehicleError(
                    f"This program stood still for {late_s:.0f} s while it waited for an answer: a {what} is "
                    "not sent again."
                )
        raise NoAnswerError(
            f"The vehicle does not answer a {what}, sent {_TRIES} times.",
            hint="Check the link. The vehicle continues what it does.",
        )

    @property
    def _ambiguous(self) -> bool:
        """Whether it is not said which of several vehicles is meant."""
        return self._system is None and len(self._heartbeats) > 1

    def _wanted(self) -> Any:
        """The heartbeat of the vehicle; None as long as there is none."""
        if self._system is not None:
            return self._heartbeats.get(self._system)
        return next(iter(self._heartbeats.values()), None)

    def _not_found(self, timeout_s: float) -> NoAnswerError:
        if self._heartbeats:
            others = ", ".join(map(str, sorted(self._heartbeats)))
            return NoAnswerError(
                f"Vehicle {self._system} sends no heartbeat, but {others} does.",
                hint="Give another --system.",
            )
        return NoAnswerError(
            f"No heartbeat from the vehicle for {timeout_s:.0f} s.",
            hint="Is it switched on, are port and baud rate right? A ground station alone is no vehicle.",
        )

    def _read(self) -> None:
        beat, looped_s = -math.inf, time.monotonic()
        while not self._closed:
            self.stood_still_s = max(self.stood_still_s, time.monotonic() - looped_s)
            looped_s = time.monotonic()
            if time.monotonic() - beat >= _HEARTBEAT_S:
                beat = time.monotonic()
                mavlink, signing = self.mavlink, self._link.mav.signing
                now = int((time.time() - _BEGAN_2015_S) * _TICKS_PER_S)
                signing.timestamp = max(signing.timestamp, now)
                kinds = (mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID)
                self.send("heartbeat_send", *kinds, 0, 0, mavlink.MAV_STATE_ACTIVE)
            message = None
            with contextlib.suppress(OSError, ValueError):
                message = self._link.recv_match(blocking=True, timeout=0.2)
            if message is not None:
                with self.changed:
                    self._receive(message)
                    self.changed.notify_all()

    def _receive(self, message: Any) -> None:
        """Dispatch the vehicle's messages to us."""
        kind = message.get_type()
        if kind == "BAD_DATA":
            if self._key is not None and message.reason == "Invalid signature":
                self._reject(message.data)
            return
        if (message.get_srcSystem(), message.get_srcComponent()) == (SYSTEM, _COMPONENT):
            self._another = True
            return
        if self._target is None:
            if kind == "HEARTBEAT" and self._is_vehicle(message):
                self._heard_s = time.monotonic()
                self._heartbeats.setdefault(message.get_srcSystem(), message)
            return
        if message.get_srcSystem() != self._target[0]:
            if kind == "HEARTBEAT" and message.type == self.mavlink.MAV_TYPE_GCS:
                self.stations |= {message.get_srcSystem()}
            return
        first, _, flags = message.get_msgbuf()[:3]
        self._version_2 |= first == _VERSION_2
        self._signed |= first == _VERSION_2 and bool(flags & _SIGNED)
        if kind == "HEARTBEAT":
            if message.get_srcComponent() != self._target[1]:  # its camera, its gimbal
                return
            self._heard_s = time.monotonic()
        if kind in _ADDRESSED:
            if self._for_us(message):
                self._answers.append(message)
            return
        self._handle(message)

    def _reject(self, data: bytearray) -> None:
        """Note why a vehicle's heartbeat is ignored."""
        message = self.mavlink.MAVLink(None).decode(data)
        wanted = self._system in (None, message.get_srcSystem())
        if not (wanted and message.get_type() == "HEARTBEAT" and self._is_vehicle(message)):
            return
        self._rejected_s = min(self._rejected_s, time.monotonic())
        if data[0] == _VERSION_2 and data[2] & _SIGNED:
            self._rejected = VehicleError(
                "The vehicle signs its messages with another key, or another time.",
                hint="Look at the passphrase in --signing-key, and at this computer's clock.",
            )
        else:
            self._rejected = VehicleError(
                "The vehicle does not sign its messages.",
                hint="Set the key up in it, by a ground station, or fly without --signing-key.",
            )

    def _is_vehicle(self, message: Any) -> bool:
        mavlink = self.mavlink
        invalid = message.autopilot == mavlink.MAV_AUTOPILOT_INVALID
        return not invalid and bool(message.type != mavlink.MAV_TYPE_GCS)

    @staticmethod
    def _for_us(message: Any) -> bool:
        system, component = (getattr(message, name, 0) or 0 for name in ("target_system", "target_component"))
        return system in (0, SYSTEM) and component in (0, _COMPONENT)


def _mavutil() -> Any:
    os.environ["MAVLINK20"] = "1"  # version 1 of the protocol has no messages of cameras
    try:
        from pymavlink import mavutil
    except ModuleNotFoundError:
        raise VehicleError(
            "MAVLink needs pymavlink.", hint="Install it: pip install 'fvs-client[fly]'."
        ) from None
    # It prints some lines a second while a connection is broken. A flight reports the lost link once.
    mavutil.print = lambda *_, **__: None
    return mavutil
