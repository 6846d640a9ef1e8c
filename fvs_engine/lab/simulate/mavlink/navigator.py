"""Makes goals of a vehicle from waypoints, returns and landings."""

import math

import numpy as np

from fvs_engine.lab.simulate.mavlink.board import Board
from fvs_engine.lab.simulate.mavlink.camera import Camera
from fvs_engine.lab.simulate.mavlink.dialect import mavlink
from fvs_engine.lab.simulate.mavlink.firmware import Meaning
from fvs_engine.lab.simulate.mavlink.gimbal import Gimbal
from fvs_engine.lab.simulate.mavlink.mission import NAVIGATION, Item
from fvs_engine.lab.simulate.vehicle import Array, Goal

_YAW_DEG = 3.0
_TAKEOFF_SHARE = 0.95
_NEAR_GROUND_M, _CLIMB_AT_LEAST_M = 10.0, 2.0


class Navigator:
    """Steers towards a ``goal``; on the ground it stands until a takeoff begins."""

    def __init__(self, board: Board, camera: Camera, gimbal: Gimbal) -> None:
        self._board, self._camera, self._gimbal = board, camera, gimbal
        vehicle = board.vehicle
        self._speed_m_s = board.parameters.of(Meaning.SPEED)
        self.goal = Goal(vehicle.believed, vehicle.yaw_deg, self._speed_m_s)
        self.rising = False
        """Whether a takeoff has begun."""
        self._arrived_s: float | None = None
        self._return_m: Array | None = None
        """Where it turns from climbing to flying home; None as long as no return has begun."""
        self._above_home = False
        self._landing = False

    @property
    def landing(self) -> bool:
        """Whether it descends to land."""
        return self._landing

    def hold(self) -> None:
        """Stay here."""
        self._landing, self._return_m, self._arrived_s = False, None, None
        self.goal = Goal(self._board.vehicle.believed, self.goal.yaw_deg, self._speed_m_s)

    def fly_to(self, position: Array) -> None:
        """Fly to ``position`` [3]."""
        self.hold()
        self.goal.position = position

    def take_off(self, height_m: float) -> None:
        """Climb to a height above home."""
        self.hold()
        self.rising = True
        self.goal.position[2] = height_m + self._board.place.home_height_m
        self.goal.climb_m_s = self._board.parameters.named("WPNAV_SPEED_UP") or math.inf

    def use_speed(self, speed_m_s: float | None = None) -> None:
        """Fly at this speed; None: at the parameter's."""
        self._speed_m_s = self._board.parameters.of(Meaning.SPEED) if speed_m_s is None else speed_m_s
        self.goal.speed_m_s = self._speed_m_s

    def turn(self, parameters: tuple[float, float, float, float]) -> None:
        """Turn as ``CONDITION_YAW`` says."""
        relative = self._board.vehicle.yaw_deg if parameters[3] > 0 else 0.0
        direction = -1.0 if parameters[3] > 0 and parameters[2] < 0 else 1.0
        self.goal.yaw_deg = (relative + direction * parameters[0]) % 360.0

    def begin(self, item: Item) -> None:
        """Begin an item of a mission."""
        if item.command in NAVIGATION:
            self._arrived_s = None
        match item.command:
            case mavlink.MAV_CMD_NAV_TAKEOFF:
                self.take_off(float(self._place(item)[2]) - self._board.place.home_height_m)
            case (
                mavlink.MAV_CMD_NAV_WAYPOINT
                | mavlink.MAV_CMD_NAV_LOITER_TIME
                | mavlink.MAV_CMD_NAV_LOITER_UNLIM
            ):
                self._head_for(item)
            case mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH:
                self.begin_return()
            case mavlink.MAV_CMD_NAV_LAND:
                self.hold()
                if item.x or item.y:
                    self.goal.position[:2] = self._place(item)[:2]
            case mavlink.MAV_CMD_NAV_DELAY:
                if self._board.firmware.is_ardupilot:
                    self._board.text(f"Delaying {item.parameters[0]:.0f} sec")
            case _:
                self.do(item)

    def done(self, item: Item) -> bool:
        """Whether an item that has begun is done."""
        match item.command:
            case mavlink.MAV_CMD_NAV_TAKEOFF:
                height_m = self.goal.position[2] - self._board.place.home_height_m
                here_m = self._board.vehicle.believed[2] - self._board.place.home_height_m
                return bool(here_m >= _TAKEOFF_SHARE * height_m)
            case mavlink.MAV_CMD_NAV_WAYPOINT | mavlink.MAV_CMD_NAV_LOITER_TIME:
                # PX4 counts the time from the position on, also while it turns.
                return self._waited(item.parameters[0], self._there(item)) and self._faces(item)
            case mavlink.MAV_CMD_NAV_DELAY:
                return self._waited(item.parameters[0], True)
            case mavlink.MAV_CMD_NAV_LOITER_UNLIM:
                return False
            case mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH:
                self.fly_home()
                return self._landing and self._board.landed
            case mavlink.MAV_CMD_NAV_LAND:
                if float(np.hypot(*self._off_m()[:2])) <= self._board.parameters.of(Meaning.RADIUS):
                    self.descend()
                return self._landing and self._board.landed
            case mavlink.MAV_CMD_CONDITION_YAW:
                return self._off_deg <= _YAW_DEG
        return True

    def do(self, item: Item) -> bool:
        """Do at once what takes no time: turn, point the gimbal, photograph; False where it cannot."""
        first, second = item.parameters[:2]
        match item.command:
            case mavlink.MAV_CMD_CONDITION_YAW:
                self.turn(item.parameters)
            case mavlink.MAV_CMD_DO_CHANGE_SPEED:
                if second > 0:
                    self.use_speed(second)
            case mavlink.MAV_CMD_DO_MOUNT_CONTROL | mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW:
                return self._gimbal.point(first)
            case mavlink.MAV_CMD_DO_DIGICAM_CONTROL:
                return item.x == 1 and self._camera.trigger()
            case mavlink.MAV_CMD_IMAGE_START_CAPTURE:
                return self._camera.trigger()
            case mavlink.MAV_CMD_DO_FENCE_ENABLE:
                self._board.parameters.set("FENCE_ENABLE", float(first == 1.0))
        return True

    def begin_return(self) -> None:
        """Begin to return home."""
        self.hold()
        parameters, place = self._board.parameters, self._board.place
        here, home = self._board.vehicle.believed, self._home
        height_m = parameters.of(Meaning.RETURN_HEIGHT)
        slope = parameters.named("RTL_CONE_SLOPE")
        if slope > 0.0:
            far_m = float(np.hypot(*(here - home)[:2]))
            height_m = min(height_m, max(_CLIMB_AT_LEAST_M, far_m * slope))
        up_m = max(float(here[2]), height_m + place.home_height_m)
        self._return_m, self._above_home = np.array([here[0], here[1], up_m]), False
        self.goal.position = self._return_m

    def fly_home(self) -> None:
        """Climb, fly home, wait there, land: to be called again and again."""
        if self._return_m is None:
            self.begin_return()
        radius_m = self._board.parameters.of(Meaning.RADIUS)
        assert self._return_m is not None
        if not self._above_home and self._board.vehicle.believed[2] >= self._return_m[2] - radius_m:
            self._above_home = True
            self.goal.position = np.array([*self._home[:2], self._return_m[2]])
        if self._above_home and (self._landing or self._waits_above_home()):
            self.descend()

    def descend(self) -> None:
        """Land: to be called again and again."""
        if not self._landing:
            self._landing = True
            self.goal.position = self._board.vehicle.believed
        parameters, here = self._board.parameters, self._board.vehicle.believed
        high = here[2] - self._board.place.home_height_m > _NEAR_GROUND_M
        name = "WPNAV_SPEED_DN" if high else "LAND_SPEED"
        self.goal.climb_m_s = parameters.named(name) or math.inf
        self.goal.position = np.array([*self.goal.position[:2], float(here[2]) - _NEAR_GROUND_M])

    @property
    def _home(self) -> Array:
        home = self._board.state.home
        return np.zeros(3) if home is None else home

    @property
    def _off_deg(self) -> float:
        return abs((self.goal.yaw_deg - self._board.vehicle.yaw_deg + 180.0) % 360.0 - 180.0)

    def _off_m(self) -> Array:
        return self.goal.position - self._board.vehicle.believed

    def _there(self, item: Item) -> bool:
        """Whether it is at the position of a waypoint; ArduPilot has one radius for all."""
        parameters, turns = self._board.parameters, self._board.firmware.turns_at_waypoints
        own_m = item.parameters[1] if turns and item.command == mavlink.MAV_CMD_NAV_WAYPOINT else 0.0
        radius_m = own_m if own_m > 0.0 else parameters.of(Meaning.RADIUS)
        return float(np.linalg.norm(self._off_m())) <= radius_m

    def _faces(self, item: Item) -> bool:
        """Whether it has turned to the yaw of a waypoint as far as it waits for that."""
        parameters = self._board.parameters
        waits = self._board.firmware.turns_at_waypoints and math.isfinite(item.parameters[3])
        if not waits or parameters.named("MIS_YAW_TMT") > 0.0:
            return True
        return self._off_deg <= parameters.named("MIS_YAW_ERR")

    def _waited(self, seconds: float, there: bool) -> bool:
        """Whether it has been ``there`` for so long."""
        now_s = self._board.state.time_s
        if there and self._arrived_s is None:
            self._arrived_s = now_s
        return self._arrived_s is not None and now_s - self._arrived_s >= seconds

    def _waits_above_home(self) -> bool:
        """Whether it has waited above home for long enough."""
        there = float(np.hypot(*self._off_m()[:2])) <= self._board.parameters.of(Meaning.RADIUS)
        return self._waited(self._board.parameters.named("RTL_LOIT_TIME") * 1e-3, there)

    def _place(self, item: Item) -> Array:
        place = self._board.place
        return item.position(place.origin, place.home_height_m, self.goal.position)

    def _head_for(self, item: Item) -> None:
        before = self.goal.position
        yaw_deg = self.goal.yaw_deg
        self.fly_to(self._place(item))
        self.goal.yaw_deg = yaw_deg
        way = self.goal.position[:2] - before[:2]
        if self._board.firmware.turns_at_waypoints:
            self.rising = True  # PX4 takes off by itself where a mission has no takeoff
            if math.isfinite(item.parameters[3]):
                self.goal.yaw_deg = item.parameters[3] % 360.0
            return
        moves = float(np.hypot(*way)) > self._board.parameters.of(Meaning.RADIUS)
        if moves and item.command == mavlink.MAV_CMD_NAV_WAYPOINT:
            self.goal.yaw_deg = math.degrees(math.atan2(way[0], way[1])) % 360.0  # it looks ahead
