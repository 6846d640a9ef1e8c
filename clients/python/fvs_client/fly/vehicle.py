"""A vehicle that speaks MAVLink, an ArduPilot copter's or PX4's: its missions, modes and other commands."""

import contextlib
import re
import time
from collections.abc import Callable, Sequence

from fvs_client.fly.connection import Connection
from fvs_client.fly.dialects import Mode
from fvs_client.fly.errors import NoAnswerError, VehicleError
from fvs_client.fly.items import MissionItem
from fvs_client.fly.own_fence import OwnFence, read_fence, upload_fence
from fvs_client.fly.read_back import require_same
from fvs_client.fly.upload import upload
from fvs_schema.fence import Fence
from fvs_schema.missions import Autopilot

_CHANGE_S = 3.0
_NOT_FLOWN = re.compile("^Mission rejected|^Geofence violation for waypoint")
"""PX4's texts (``FeasibilityChecker.cpp``)."""
_TRIES = 4
_CHECKS_S = 1.0
_TEXT_S = 0.5
"""Autopilots refuse a command before they say why."""


class Vehicle(Connection):
    """A vehicle that is commanded; its connection begins as ``Connection`` says."""

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

    def arming_objections(self) -> list[str]:
        """Have it run its checks before arming; returns what fails in its own words."""
        began_s = time.monotonic()
        with contextlib.suppress(VehicleError):  # a firmware without the command
            self.command(self._mavlink.MAV_CMD_RUN_PREARM_CHECKS)
            time.sleep(_CHECKS_S)
        said = self.said(time.monotonic() - began_s)
        return [text for text in said if text.startswith(("PreArm", "Arm:", "Preflight Fail"))]

    def upload(self, items: Sequence[MissionItem]) -> None:
        """Replace the vehicle's mission and read it back; the first item is home.

        Raises ``VehicleError`` when the autopilot refuses it, naming the item, or has another one afterwards
        or one that it does not fly, and ``NoAnswerError``.
        """
        began_s = time.monotonic()
        self._know_mission(None)
        upload(self._link, items[self.dialect.not_sent :], self.dialect.not_sent)
        self._know_mission(len(items))
        if not self.dialect.replaces_items:  # it is at another item now
            self._forget_item()
        require_same(self._link, items[self.dialect.not_sent :], self.dialect.not_sent, self.dialect)
        objections = [text for text in self.said(time.monotonic() - began_s) if _NOT_FLOWN.search(text)]
        if objections:  # PX4 takes a mission before it checks it
            raise VehicleError(
                f"The autopilot has the mission, and does not fly it: {'; '.join(objections)}",
                hint="A parameter of the vehicle, or its fence, forbids it.",
            )

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
                done=lambda: self._telemetry.state.armed or self._telemetry.state.custom_mode != mode,
            )
            self.wait(lambda: self._telemetry.state.armed, 10.0, "does not arm" + self._said_since(began_s))

    def disarm(self) -> None:
        """Stop the motors, on the ground."""
        self.command(self._mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0)
        self.wait(lambda: not self._telemetry.state.armed, 10.0, "does not disarm")

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
            if state.mode is not Mode.MISSION and self._telemetry.state.custom_mode == before:
                self.command(
                    self._mavlink.MAV_CMD_MISSION_START,
                    done=lambda: self._telemetry.state.custom_mode != before,
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
                done=lambda: self._telemetry.state.custom_mode != before,
            )
            with self._link.changed:
                if self._link.changed.wait_for(
                    lambda: self._telemetry.state.custom_mode == wanted, _CHANGE_S
                ):
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

    def _soon_flies(self, first: int, last: int, before: int) -> bool:
        """Whether it is soon at one of these items, or in a mode that nobody commanded here."""

        def flies() -> bool:
            state = self._telemetry.state
            if state.mode is Mode.MISSION:
                return first <= state.item <= last
            return state.custom_mode != before

        with self._link.changed:
            return bool(self._link.changed.wait_for(flies, _CHANGE_S))

    def _forget_item(self) -> None:
        with self._link.changed:
            self._telemetry.forget_item()

    def _know_mission(self, count: int | None) -> None:
        with self._link.changed:
            self._telemetry.know_mission(count)

    def _go_to(self, item: int) -> None:
        """Make an item the current one, without waiting."""
        self._link.send("mission_set_current_send", *self._link.target, item - self.dialect.not_sent)

    def _name(self, enum: str, value: int) -> str:
        entry = self._mavlink.enums[enum].get(value)
        return entry.name if entry is not None else str(value)
