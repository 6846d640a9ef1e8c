"""Flies a simulated vehicle as an autopilot does: its modes, and what starts and stops the motors."""

from collections.abc import Callable

from fvs_engine.lab.simulate.mavlink.arming import Arming
from fvs_engine.lab.simulate.mavlink.board import Board
from fvs_engine.lab.simulate.mavlink.dialect import mavlink
from fvs_engine.lab.simulate.mavlink.flight_state import Mode
from fvs_engine.lab.simulate.mavlink.gimbal import Gimbal
from fvs_engine.lab.simulate.mavlink.mission import NAVIGATION, Item
from fvs_engine.lab.simulate.mavlink.navigator import Navigator
from fvs_engine.lab.simulate.mavlink.receiver import set_home
from fvs_engine.lab.simulate.mavlink.sequencer import Concurrent, InOrder, Progress
from fvs_engine.lab.simulate.vehicle import Array

_WARNING = int(mavlink.MAV_SEVERITY_WARNING)


class Pilot:
    """Flies by modes, of which one flies the mission that ``items`` returns."""

    def __init__(
        self,
        board: Board,
        gimbal: Gimbal,
        navigator: Navigator,
        arming: Arming,
        items: Callable[[], list[Item]],
        objection: Callable[[], str | None],
    ) -> None:
        self._board, self._gimbal, self._arming, self._items = board, gimbal, arming, items
        self.objection = objection
        """Returns why PX4 would not fly the mission; None where it would."""
        self.navigator = navigator
        order = Concurrent if board.firmware.is_ardupilot else InOrder
        self.mission: Concurrent | InOrder = order(board, items, self._begin, navigator.done)
        self._waits_to_start = False
        self._paused = False

    def step(self, seconds: float) -> None:
        """Fly on for ``seconds`` of simulated time."""
        state, navigator = self._board.state, self.navigator
        if state.armed:
            self._decide()
        if not self._board.landed:
            navigator.rising = False
        flies = state.armed and (navigator.rising or not self._board.landed)
        self._board.vehicle.step(seconds, navigator.goal if flies else None)
        self._gimbal.advance(seconds)
        state.time_s += seconds

    def arm(self, *, forced: bool = False) -> bool:
        """Start the motors; False where a check forbids it."""
        state = self._board.state
        if state.armed:
            return True
        forced = forced and self._board.firmware.is_ardupilot  # PX4 lets nobody outside force it
        if not forced and (reason := self._arming.refusal()) is not None:
            self._board.text(reason, int(mavlink.MAV_SEVERITY_CRITICAL))
            return False
        if state.fixed:
            set_home(self._board)
        self._told("Arming motors", "Armed by external command")
        state.armed = True
        self.navigator.use_speed()
        self.navigator.hold()
        return True

    def disarm(self, *, forced: bool = False) -> bool:
        """Stop the motors; False in the air, where they are not stopped unless that is ``forced``."""
        if not self._board.landed and not forced:
            return False
        if self._board.state.armed:
            self._board.state.armed = False
            self._told("Disarming motors", "Disarmed by landing")
            self.mission.stop()
            self.mission.reset()
            self.navigator.rising = False
        return True

    def enter(self, mode: Mode, why: str) -> bool:
        """Change the mode; False where it cannot be flown now."""
        state = self._board.state
        if mode is state.mode:
            return True
        refusal = self._refusal(mode)
        if refusal is not None:
            name = self._board.firmware.modes[mode].name
            self._told(f"Mode change to {name} failed: {refusal}", f"{name} is not possible", _WARNING)
            return False
        if state.mode is Mode.MISSION:
            self.mission.stop()
            if self._board.firmware.is_ardupilot or not self._board.landed:
                self._gimbal.reset()
        state.mode, self._paused = mode, False
        self._board.say(f"{self._board.firmware.modes[mode].name}: {why}")
        if mode is not Mode.LAND or not self.navigator.landing:
            self.navigator.hold()
        if mode is Mode.MISSION:
            self.navigator.use_speed()
            self._waits_to_start = True
            if not self._board.firmware.is_ardupilot:
                self._point_again()
        return True

    def start_mission(self) -> bool:
        """Fly the mission; False if it cannot be flown, or the vehicle does not arm by itself."""
        if self._board.firmware.is_ardupilot:
            if not self.enter(Mode.MISSION, "asked"):
                return False
            if self._board.state.armed and not self.mission.running:
                self.mission.resume()
            return True
        return self.enter(Mode.MISSION, "asked") and self.arm()

    def pause(self, paused: bool) -> bool:
        """Stop on the way, in the same mode, or go on; False in other modes."""
        if self._board.state.mode not in (Mode.MISSION, Mode.GUIDED):
            return False
        if paused and not self._paused:
            self.navigator.hold()
        elif self._paused and not paused and self._board.state.mode is Mode.MISSION:
            self.mission.resume()
        self._paused = paused
        return True

    def take_off(self, height_m: float) -> bool:
        """Climb from the ground to a height above home; False elsewhere, and where nothing would climb."""
        state = self._board.state
        if not self._board.firmware.is_ardupilot:
            self.enter(Mode.GUIDED, "takeoff")
        elif state.mode not in (Mode.GUIDED, Mode.LOITER, Mode.ALT_HOLD, Mode.POSHOLD):
            return False
        if not state.armed or not self._board.landed or not height_m > 0.0:
            return False
        self.navigator.take_off(height_m)
        return True

    def go_to(self, position: Array, *, change_mode: bool = False) -> bool:
        """Fly to a position in guided mode; False in others, unless the mode may be changed."""
        guided = self._board.state.mode is Mode.GUIDED
        if not guided and not (change_mode and self.enter(Mode.GUIDED, "asked")):
            return False
        self.navigator.fly_to(position)
        return True

    def mission_changed(self, current: int | None) -> None:
        """Go on with another mission; PX4 at the item that was marked as the ``current`` one, if any."""
        self._board.parameters.set("MIS_TOTAL", float(len(self._items())))
        if not self._board.firmware.is_ardupilot and self._items():
            objection = self.objection()
            if objection is not None:
                self._board.text(objection, int(mavlink.MAV_SEVERITY_CRITICAL))
        self.mission.changed(current)

    def _refusal(self, mode: Mode) -> str | None:
        """Why a mode cannot be flown now."""
        state, firmware = self._board.state, self._board.firmware
        if not state.armed:
            return None
        if firmware.modes[mode].needs_position and not state.fixed:
            return "requires position"
        if mode is not Mode.MISSION:
            return None
        if not firmware.is_ardupilot:
            return self.objection()
        items = self._items()
        if len(items) <= 1:
            return "init failed"
        begins = next(
            (item for item in items[max(1, self.mission.current) :] if item.command in NAVIGATION), None
        )
        takes_off = begins is not None and begins.command == mavlink.MAV_CMD_NAV_TAKEOFF
        if self._board.landed and not takes_off:
            self._board.text("Auto: Missing Takeoff Cmd", int(mavlink.MAV_SEVERITY_CRITICAL))
            return "init failed"
        return None

    def _decide(self) -> None:
        """The goal of the vehicle's next step."""
        match self._board.state.mode:
            case Mode.MISSION:
                self._fly_mission()
            case Mode.RETURN:
                self.navigator.fly_home()
                self._disarm_when_landed()
            case Mode.LAND:
                self.navigator.descend()
                self._disarm_when_landed()

    def _fly_mission(self) -> None:
        if self._paused:
            return
        if self._waits_to_start:
            self._waits_to_start = False
            self.mission.resume()
        elif self.mission.running:
            self.mission.update()
            if self.mission.progress is Progress.COMPLETE:
                self._end_mission()

    def _end_mission(self) -> None:
        if self._board.landed:
            self._come_to_rest()
        else:
            self.navigator.hold()
            if not self._board.firmware.is_ardupilot:
                self._board.text("Mission finished, loitering")

    def _point_again(self) -> None:
        """Point the gimbal as the mission has set it: PX4 does so on entering the mode."""
        before = self._items()[: self.mission.current]
        for item in (each for each in before if each.command == mavlink.MAV_CMD_DO_MOUNT_CONTROL):
            self.navigator.do(item)

    def _begin(self, item: Item) -> None:
        returns = item.command == mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH
        if returns and not self._board.firmware.is_ardupilot:
            self.enter(Mode.RETURN, "Returning home")
        else:
            self.navigator.begin(item)

    def _disarm_when_landed(self) -> None:
        if self._board.landed and (self.navigator.landing or not self.navigator.rising):
            self._come_to_rest()

    def _come_to_rest(self) -> None:
        self.disarm()
        self._board.vehicle.position[2] = 0.0

    def _told(self, ardupilot: str, px4: str, severity: int = int(mavlink.MAV_SEVERITY_INFO)) -> None:
        self._board.text(ardupilot if self._board.firmware.is_ardupilot else px4, severity)
