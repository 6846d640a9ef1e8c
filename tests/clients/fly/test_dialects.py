"""Modes of autopilots, held to pymavlink's tables."""

import pytest
from fvs_client.fly.dialects import ARDUPILOT, PX4, Dialect, Mode, dialect_of
from fvs_client.fly.errors import VehicleError
from pymavlink import mavutil

ARDUCOPTER = {
    Mode.MISSION: "AUTO", Mode.HOLD: "GUIDED", Mode.PAUSE: "GUIDED", Mode.RETURN: "RTL", Mode.LAND: "LAND"
}  # fmt: skip
AUTO = {Mode.MISSION: "MISSION", Mode.PAUSE: "LOITER", Mode.RETURN: "RTL", Mode.LAND: "LAND"}


@pytest.mark.parametrize("mode", ARDUCOPTER)
def test_arducopters_modes_are_pymavlinks(mode: Mode) -> None:
    number = ARDUPILOT.custom_mode(mode)
    assert mavutil.mode_mapping_acm[number] == ARDUCOPTER[mode]
    assert ARDUPILOT.modes[mode][0] == number
    assert ARDUPILOT.mode_of(number) is ARDUPILOT.reported(mode)


@pytest.mark.parametrize("mode", AUTO)
def test_px4s_modes_are_pymavlinks(mode: Mode) -> None:
    _, main, sub = mavutil.px4_map[AUTO[mode]]
    assert PX4.modes[mode] == (main, sub)
    assert mavutil.interpret_px4_mode(0, PX4.custom_mode(mode)) == AUTO[mode]
    assert PX4.mode_of(PX4.custom_mode(mode)) is mode


@pytest.mark.parametrize(
    ("dialect", "number"), [(ARDUPILOT, 0), (ARDUPILOT, 4 << 16), (PX4, 3), (PX4, 3 << 16)]
)
def test_other_modes_are_no_mission(dialect: Dialect, number: int) -> None:
    assert dialect.mode_of(number) is Mode.OTHER


def test_other_returns_are_returns() -> None:
    for name in ("SMART_RTL", "AUTO_RTL"):
        assert ARDUPILOT.mode_of(_number(name)) is Mode.RETURN


def _number(name: str) -> int:
    return next(number for number, known in mavutil.mode_mapping_acm.items() if known == name)


def test_only_copters_of_known_firmware_are_flown() -> None:
    mavlink = mavutil.mavlink
    assert dialect_of(mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_TYPE_HEXAROTOR) is PX4
    with pytest.raises(VehicleError, match="firmware is not known"):
        dialect_of(mavlink.MAV_AUTOPILOT_GENERIC, mavlink.MAV_TYPE_QUADROTOR)
    for kind in (mavlink.MAV_TYPE_FIXED_WING, mavlink.MAV_TYPE_GROUND_ROVER):
        with pytest.raises(VehicleError, match="no copter"):
            dialect_of(mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, kind)
