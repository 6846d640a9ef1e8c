"""Who commands a vehicle: modes that were commanded, returns of the mission, pilots, failsafes."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from fvs_client.fly.dialects import ARDUPILOT, PX4, Dialect, Mode
from fvs_client.fly.items import holding
from fvs_client.fly.log import FlightLog
from fvs_client.fly.places import Home
from fvs_client.fly.settings import EndedError, Ending, FlightSettings
from fvs_client.fly.survey import Survey
from fvs_client.fly.telemetry import VehicleState
from fvs_client.fly.watch import Control, Watch

ITEMS = holding(Survey(47.0, 8.0, radius_m=30.0, height_m=20.0, count=3).items(ARDUPILOT), 60.0)
WAITS_AT = len(ITEMS) - 2
NAMES = {
    Mode.MISSION: "AUTO",
    Mode.PAUSE: "GUIDED",
    Mode.RETURN: "RTL",
    Mode.OTHER: "LOITER",
}


class Watched:
    """A watch over a vehicle that flies its mission, in the state that a test gives it."""

    def __init__(self, *said: str, flies: bool = True, dialect: Dialect = ARDUPILOT, **settings: Any) -> None:
        self.vehicle = SimpleNamespace(
            state=VehicleState(),
            last_state=VehicleState(latitude_deg=47.0, longitude_deg=8.0),
            home=Home(47.0, 8.0, 440.0),
            said=lambda _seconds: list(said),
            warnings=lambda: list(said),
            stood_still_s=0.0,
            dialect=dialect,
        )
        self.logged: list[str] = []
        self.watch = Watch(
            self.vehicle,  # type: ignore[arg-type]
            FlightSettings("north", 3, **settings),
            FlightLog(None, self.logged.append),
        )
        self.watch.items = ITEMS
        if flies:
            with self.watch.commanding(Mode.MISSION):
                self.watch.flies()

    def after(self, mode: Mode, item: int = WAITS_AT, **state: Any) -> EndedError | None:
        """How the flight ends in this state; None where it goes on."""
        given = {"armed": True, "mode": mode, "mode_name": NAMES[mode], "item": item, **state}
        self.vehicle.state = VehicleState(**given)
        try:
            self.watch.require_going_on()
        except EndedError as ended:
            return ended
        return None


@pytest.mark.parametrize("item", range(1, WAITS_AT + 1))
def test_a_mission_is_ours_until_it_returns(item: int) -> None:
    assert Watched().after(Mode.MISSION, item) is None


def test_a_return_of_the_mission_ends_the_flight() -> None:
    """ArduPilot stays in AUTO then."""
    for item in (WAITS_AT + 1, WAITS_AT + 2):
        ended = Watched().after(Mode.MISSION, item)
        assert ended is not None
        assert ended.ending is Ending.VEHICLE
        assert "it waited 300 s for its next view (--patience)" in ended.reason


@pytest.mark.parametrize(
    ("mode", "said", "ending", "reason"),
    [
        (
            Mode.RETURN,
            ["Mission: 3 MountControl"],
            Ending.VEHICLE,
            "is in RTL, commanded by a pilot or another",
        ),
        (
            Mode.RETURN,
            ["Max Alt fence breached", "Manual recovery started"],
            Ending.VEHICLE,
            "is in RTL, commanded by its failsafe (it says: Max Alt fence breached)",
        ),
        (
            Mode.RETURN,
            ["Battery 1 is low 10.50V used 2000 mAh", "Battery Failsafe"],
            Ending.VEHICLE,
            "commanded by its failsafe (it says: Battery 1 is low",
        ),
        (Mode.OTHER, [], Ending.PILOT, "a pilot or another ground station has taken over, in LOITER"),
        (Mode.OTHER, ["EKF variance"], Ending.PILOT, "its failsafe (it says: EKF variance) has taken over"),
        (Mode.PAUSE, [], Ending.PILOT, "a pilot or another ground station has taken over, in GUIDED"),
    ],
)
def test_a_mode_that_was_not_commanded_ends_the_flight(
    mode: Mode, said: list[str], ending: Ending, reason: str
) -> None:
    ended = Watched(*said).after(mode)
    assert ended is not None
    assert ended.ending is ending
    assert reason in ended.reason


@pytest.mark.parametrize("flies", [True, False])
def test_a_program_that_stood_still_does_not_take_off(flies: bool) -> None:
    watched = Watched(flies=flies)
    watched.watch.starting = True
    with watched.watch.commanding(Mode.MISSION):
        assert watched.after(Mode.MISSION) is None
        watched.vehicle.stood_still_s = 30.0
        ended = watched.after(Mode.MISSION)
    assert (ended is None) is flies
    assert ended is None or ended.reason == "this program stood still for 30 s before takeoff: begin again."


def test_warnings_are_shown_once() -> None:
    watched = Watched("Auto mission changed, restarted command", "GPS Glitch or Compass error")
    for _ in range(2):
        assert watched.after(Mode.MISSION) is None
        watched.vehicle.warnings = lambda: ["GPS Glitch or Compass error"]
    assert watched.logged == ["The vehicle says: GPS Glitch or Compass error"]


def test_in_a_pause_a_mission_was_not_commanded() -> None:
    watched = Watched()
    with watched.watch.commanding(Mode.PAUSE):
        assert watched.after(Mode.MISSION) is None  # it has not changed its mode yet
        assert watched.after(Mode.PAUSE) is None
    assert watched.after(Mode.PAUSE) is None
    ended = watched.after(Mode.MISSION)
    assert ended is not None
    assert ended.ending is Ending.PILOT


def test_a_vehicle_that_is_armed_by_others_is_left_alone() -> None:
    ended = Watched(flies=False).after(Mode.OTHER)
    assert ended is not None
    assert ended.ending is Ending.PILOT
    assert "armed, in LOITER" in ended.reason
    assert "--take-over" in ended.reason
    assert Watched(flies=False, take_over=True).after(Mode.OTHER) is None


def test_a_pilot_who_takes_a_vehicle_that_starts_keeps_it() -> None:
    watched = Watched(flies=False)
    watched.watch.starting = True
    with watched.watch.commanding(Mode.HOLD):
        assert watched.after(Mode.OTHER, armed=False) is None
        assert watched.after(Mode.PAUSE) is None
        ended = watched.after(Mode.OTHER)
    assert ended is not None
    assert ended.ending is Ending.PILOT


def test_nothing_is_ours_after_a_release() -> None:
    watched = Watched()
    watched.watch.release(Mode.RETURN)
    state = VehicleState(armed=True, mode=Mode.MISSION, item=3)
    assert watched.watch.control(state) is Control.OTHERS


def test_a_home_that_moves_in_flight_is_said_once() -> None:
    watched = Watched()
    watched.vehicle.home = Home(47.0, 8.0, 447.0)
    for _ in range(3):
        assert watched.after(Mode.MISSION) is None
    assert watched.logged == ["Home has moved by 7 m (+7 m in height): the vehicle returns there."]


def test_a_job_does_not_outlast_the_patience() -> None:
    watched = Watched()
    watched.watch.require_in_time()
    watched.watch.deadline_s = 0.0
    with pytest.raises(EndedError, match="not updated in time: the vehicle waited 300 s") as ended:
        watched.watch.require_in_time()
    assert ended.value.ending is Ending.SERVICE


def test_px4_holds_before_its_failsafe_returns() -> None:
    """For ``COM_FAIL_ACT_T``, in the mode of a pause; without a failsafe it is a pilot's."""
    said = ("Battery level low", "Failsafe activated, entering Hold for 5 seconds")
    ended = Watched(*said, dialect=PX4).after(Mode.PAUSE, failsafe=True)
    assert ended is not None
    assert ended.ending is Ending.VEHICLE
    assert "commanded by its failsafe (it says: Battery level low)" in ended.reason
    for watched, failsafe in (
        (Watched(dialect=PX4), False),
        (Watched(dialect=replace(PX4, holds_s=0.0)), True),
        (Watched(), True),
    ):
        ended = watched.after(Mode.PAUSE, failsafe=failsafe)
        assert ended is not None
        assert ended.ending is Ending.PILOT


def test_px4_arms_in_the_mode_of_a_pause() -> None:
    watched = Watched(flies=False, dialect=PX4)
    with watched.watch.commanding(Mode.HOLD):
        watched.watch.starting = True
    assert watched.after(Mode.PAUSE) is None
