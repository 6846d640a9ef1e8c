"""Flies a simulated vehicle as an autopilot does: modes, missions, the battery's failsafes."""

import math
from collections.abc import Callable

import numpy as np

from fvs_engine.geometry.geodetic import GeodeticPosition
from fvs_engine.lab.simulate.mavlink.camera import Camera
from fvs_engine.lab.simulate.mavlink.dialect import mavlink
from fvs_engine.lab.simulate.mavlink.firmware import Firmware, Meaning
from fvs_engine.lab.simulate.mavlink.flight_state import HOLDING, Faults, FlightState, Mode
from fvs_engine.lab.simulate.mavlink.mission import Item
from fvs_engine.lab.simulate.mavlink.parameters import Parameters
from fvs_engine.lab.simulate.vehicle import Goal, Vehicle

_STEP_S = 0.05
_LANDED_M = 0.15
_YAW_DEG = 3.0
_TAKEOFF_SHARE = 0.95


class Pilot:
    """Flies ``vehicle``; ``items`` returns its mission, ``reached`` and ``text`` report events."""

    def __init__(
        self,
        vehicle: Vehicle,
        camera: Camera,
        origin: GeodeticPosition,
        firmware: Firmware,
        state: FlightState,
        faults: Faults,
        parameters: Parameters,
        items: Callable[[], list[Item]],
        reached: Callable[[int], None],
        text: Callable[[str], None],
    ) -> None:
        self._vehicle, self._camera, self._origin = vehicle, camera, origin
        self._firmware, self._state, self._faults = firmware, state, faults
        self._parameters, self._items, self._reached, self._text = parameters, items, reached, text
        self._goal: Goal | None = None
        self._began_s, self._item_begun = 0.0, False
        self._speed_m_s = parameters.of(Meaning.SPEED)

    @property
    def landed(self) -> bool:
        """Whether it is on the ground."""
        return bool(self._vehicle.position[2] <= _LANDED_M)

    def advance(self, seconds: float) -> None:
        """Fly on for ``seconds`` of simulated time."""
        while seconds > 1e-9:
            step = min(_STEP_S, seconds)
            self._decide()
            self._vehicle.step(step, self._goal if self._state.armed else None)
            self._state.time_s += step
            seconds -= step

    def arm(self, armed: bool) -> bool:
        """Start the motors, or stop them; False in the air, where they are not stopped."""
        if not armed and not self.landed:
            return False
        self._state.armed = armed
        here = self._vehicle.believed
        pose = Goal(here, self._vehicle.yaw_deg, self._vehicle.pitch_deg, self._speed_m_s)
        self._goal = pose if armed else None
        return True

    def enter(self, mode: Mode, why: str) -> None:
        """Change the mode."""
        if mode is not self._state.mode:
            self._state.mode = mode
            name, _, _ = self._firmware.modes[mode]
            self._text(f"{name}: {why}")
            self._item_begun = False  # after a pause it heads for its item again
        if mode in HOLDING and self._goal is not None:
            self._goal.position = self._vehicle.believed

    def start_mission(self) -> bool:
        """Fly the mission; False if there is none, or the vehicle is not armed and does not arm by itself."""
        if not self._items():
            return False
        if not self._state.armed and not (self._firmware.start_arms and self.arm(True)):
            return False
        if self._state.mode is not Mode.MISSION:
            first = int(self._firmware.home_is_first)
            self._state.item = max(first, self._state.item)
            self._speed_m_s = self._parameters.of(Meaning.SPEED)
        self.enter(Mode.MISSION, "asked")
        return True

    def go_to_item(self, number: int) -> None:
        """Make another item the current one."""
        if 0 <= number < max(1, len(self._items())):
            self._state.item, self._item_begun = number, False

    def mission_replaced(self) -> None:
        """Start the new mission from its beginning when it is commanded to fly it."""
        self._state.item, self._item_begun = 0, False
        if self._state.mode is Mode.MISSION:
            self.enter(Mode.LOITER, "its mission was replaced")

    def do(self, command: int, parameters: tuple[float, float, float, float]) -> bool:
        """Execute an immediate command (turn, point the gimbal, photograph); returns False on the ground."""
        goal, first = self._goal, parameters[0]
        if goal is None:
            return False
        match command:
            case mavlink.MAV_CMD_CONDITION_YAW:
                relative = parameters[3] > 0
                goal.yaw_deg = (first + (self._vehicle.yaw_deg if relative else 0.0)) % 360.0
            case mavlink.MAV_CMD_DO_CHANGE_SPEED:
                if parameters[1] > 0:
                    self._speed_m_s = goal.speed_m_s = parameters[1]
            case mavlink.MAV_CMD_DO_MOUNT_CONTROL | mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW:
                if not self._faults.no_gimbal:
                    goal.pitch_deg = first
            case mavlink.MAV_CMD_DO_DIGICAM_CONTROL | mavlink.MAV_CMD_IMAGE_START_CAPTURE:
                if not self._faults.no_camera:
                    self._camera.photograph()
        return True

    def _decide(self) -> None:
        """The goal of the vehicle's next step."""
        if not self._state.armed or self._goal is None:
            return
        battery, mode = self._vehicle.battery, self._state.mode
        if battery <= self._parameters.of(Meaning.EMPTY_BATTERY) and mode is not Mode.LAND:
            self.enter(Mode.LAND, "Battery empty")
        elif battery <= self._parameters.of(Meaning.LOW_BATTERY) and mode not in (Mode.RETURN, Mode.LAND):
            self.enter(Mode.RETURN, "Battery low")
        match self._state.mode:
            case Mode.MISSION:
                self._fly_mission(self._goal)
            case Mode.RETURN:
                self._return(self._goal)
            case Mode.LAND:
                self._land(self._goal)

    def _fly_mission(self, goal: Goal) -> None:
        while self._state.mode is Mode.MISSION:
            items = self._items()
            if self._state.item >= len(items):
                self.enter(Mode.LOITER, "Mission complete")
                return
            item = items[self._state.item]
            if not self._item_begun:
                self._begin(item, goal)
                self._item_begun, self._began_s = True, self._state.time_s
            if not self._done(item, goal):
                return
            self._reached(self._state.item)
            self._state.item, self._item_begun = self._state.item + 1, False

    def _begin(self, item: Item, goal: Goal) -> None:
        match item.command:
            case mavlink.MAV_CMD_NAV_TAKEOFF:
                height_m = item.position(self._origin, goal.position)[2]
                here = self._vehicle.believed
                goal.position = np.array([here[0], here[1], height_m])
            case (
                mavlink.MAV_CMD_NAV_WAYPOINT
                | mavlink.MAV_CMD_NAV_LOITER_TIME
                | mavlink.MAV_CMD_NAV_LOITER_UNLIM
            ):
                self._head_for(item, goal)
            case mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH:
                self.enter(Mode.RETURN, "Returning home")
            case mavlink.MAV_CMD_NAV_LAND:
                self.enter(Mode.LAND, "Landing")
            case _:
                self.do(item.command, item.parameters)

    def _head_for(self, item: Item, goal: Goal) -> None:
        place = item.position(self._origin, goal.position)
        way = place[:2] - goal.position[:2]
        goal.position, goal.speed_m_s = place, self._speed_m_s
        if self._firmware.turns_at_waypoints:
            if math.isfinite(item.parameters[3]):
                goal.yaw_deg = item.parameters[3] % 360.0
            return
        moves = float(np.hypot(*way)) > self._parameters.of(Meaning.RADIUS)
        if moves and item.command == mavlink.MAV_CMD_NAV_WAYPOINT:
            goal.yaw_deg = math.degrees(math.atan2(way[0], way[1])) % 360.0  # it looks ahead

    def _done(self, item: Item, goal: Goal) -> bool:
        waited_s = self._state.time_s - self._began_s
        off_m = goal.position - self._vehicle.believed
        turned = abs((goal.yaw_deg - self._vehicle.yaw_deg + 180.0) % 360.0 - 180.0) <= _YAW_DEG
        match item.command:
            case mavlink.MAV_CMD_NAV_TAKEOFF:
                return bool(self._vehicle.believed[2] >= _TAKEOFF_SHARE * goal.position[2])
            case mavlink.MAV_CMD_NAV_WAYPOINT:
                radius_m = item.parameters[1] or self._parameters.of(Meaning.RADIUS)
                there = float(np.linalg.norm(off_m)) <= radius_m
                there &= turned or not self._firmware.turns_at_waypoints
                if not there:
                    self._began_s = self._state.time_s
                return there and waited_s >= item.parameters[0]
            case mavlink.MAV_CMD_NAV_LOITER_TIME | mavlink.MAV_CMD_NAV_DELAY:
                return waited_s >= item.parameters[0]
            case mavlink.MAV_CMD_NAV_LOITER_UNLIM:
                return False
            case mavlink.MAV_CMD_CONDITION_YAW:
                return turned
        return True

    def _return(self, goal: Goal) -> None:
        """Climb, fly home, land."""
        here, height_m = self._vehicle.believed, self._parameters.of(Meaning.RETURN_HEIGHT)
        radius_m = self._parameters.of(Meaning.RADIUS)
        if float(np.hypot(*here[:2])) <= radius_m:
            self.enter(Mode.LAND, "Landing")
        elif here[2] < height_m - radius_m:
            goal.position = np.array([*here[:2], height_m])
        else:
            goal.position = np.array([0.0, 0.0, max(float(here[2]), height_m)])

    def _land(self, goal: Goal) -> None:
        goal.position = np.array([*goal.position[:2], -1.0 - abs(float(self._vehicle.believed[2]))])
        if self.landed:
            self._state.armed, self._goal = False, None
            self._vehicle.position[2] = 0.0
            self._text("Disarmed")
