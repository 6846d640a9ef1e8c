"""What the checklist says of the vehicle's own failsafes."""

import pytest
from fvs_client.fly import failsafes
from fvs_client.fly.failsafes import Reach

GOOD = {
    "BATT_FS_CRT_ACT": 1.0,
    "BATT_FS_LOW_ACT": 2.0,
    "BATT_LOW_MAH": 0.0,
    "BATT_LOW_VOLT": 10.5,
    "FENCE_ACTION": 1.0,
    "FENCE_ALT_MAX": 100.0,
    "FENCE_ENABLE": 1.0,
    "FENCE_RADIUS": 300.0,
    "FENCE_TYPE": 7.0,
    "FS_GCS_ENABLE": 1.0,
    "FS_OPTIONS": 18.0,
    "FS_THR_ENABLE": 1.0,
    "RTL_ALT": 1_500.0,
    "SYSID_MYGCS": 255.0,
}
GOOD_PX4 = {
    "COM_LOW_BAT_ACT": 3.0,
    "GF_ACTION": 3.0,
    "GF_MAX_HOR_DIST": 300.0,
    "GF_MAX_VER_DIST": 0.0,
    "NAV_DLL_ACT": 2.0,
    "NAV_RCL_ACT": 2.0,
    "RTL_RETURN_ALT": 30.0,
    "TRIG_MODE": 1.0,
}
REACH = Reach(away_m=150.0, highest_m=60.0)


def test_nothing_is_off() -> None:
    found = [str(check) for check in failsafes.ardupilot(GOOD, frozenset({255}), REACH)]
    assert found == [
        "[ ok ] lost ground station: RTL (FS_GCS_ENABLE 1), but continues missions (FS_OPTIONS); of system "
        "255 (SYSID_MYGCS)",
        "[ ok ] lost remote control: RTL (FS_THR_ENABLE 1)",
        "[ ok ] low battery: RTL (BATT_FS_LOW_ACT 2) at 10.5 V (BATT_LOW_VOLT); critical: LAND "
        "(BATT_FS_CRT_ACT 1)",
        "[ ok ] vehicle's fence: RTL, else LAND (FENCE_ACTION 1); 300 m around home, up to 100 m",
        "[ ok ] way home: at 15 m above home or higher (RTL_ALT): above all obstacles?",
    ]
    assert all(check.fine for check in failsafes.px4(GOOD_PX4, frozenset({255}), REACH))


@pytest.mark.parametrize(
    ("changed", "what", "remedy"),
    [
        ({"FS_GCS_ENABLE": 0.0}, "lost ground station", "FS_GCS_ENABLE 1"),
        ({"SYSID_MYGCS": 252.0}, "lost ground station", "connect that ground station, or SYSID_MYGCS"),
        ({"MAV_GCS_SYSID": 252.0}, "lost ground station", "connect that ground station, or MAV_GCS_SYSID"),
        ({"FS_THR_ENABLE": 0.0}, "lost remote control", "FS_THR_ENABLE 1"),
        ({"BATT_FS_LOW_ACT": 0.0}, "low battery", "BATT_FS_LOW_ACT 2"),
        ({"BATT_LOW_VOLT": 0.0}, "low battery", "BATT_LOW_VOLT or BATT_LOW_MAH"),
        ({"FENCE_ENABLE": 0.0}, "vehicle's fence", "FENCE_ENABLE 1"),
        ({"FENCE_ACTION": 0.0}, "vehicle's fence", "FENCE_ACTION 1"),
        ({"FENCE_RADIUS": 149.0}, "vehicle's fence", "FENCE_RADIUS"),
        ({"FENCE_ALT_MAX": 59.0}, "vehicle's fence", "FENCE_ALT_MAX"),
        ({"RTL_ALT": 0.0}, "way home", "RTL_ALT"),
        ({"RTL_ALT_M": 0.0}, "way home", "RTL_ALT_M"),
    ],
)
def test_what_is_off_is_named_with_the_parameter_that_changes_it(
    changed: dict[str, float], what: str, remedy: str
) -> None:
    checks = failsafes.ardupilot({**GOOD, **changed}, frozenset({255}), REACH)
    [off] = [check for check in checks if not check.fine]
    assert off.what == what
    assert off.remedy.startswith(remedy)


@pytest.mark.parametrize(
    ("changed", "what", "remedy"),
    [
        ({"NAV_DLL_ACT": 0.0}, "lost ground station", "NAV_DLL_ACT 2"),
        ({"NAV_DLL_ACT": 1.0}, "lost ground station", "NAV_DLL_ACT 2"),  # it stays where it is
        ({"NAV_DLL_ACT": 6.0}, "lost ground station", "NAV_DLL_ACT 2"),  # it stops its motors
        ({"NAV_RCL_ACT": 1.0}, "lost remote control", "NAV_RCL_ACT 2"),
        ({"NAV_RCL_ACT": 0.0}, "lost remote control", "NAV_RCL_ACT 2"),
        ({"COM_LOW_BAT_ACT": 0.0}, "low battery", "COM_LOW_BAT_ACT 3"),
        ({"GF_ACTION": 0.0}, "vehicle's fence", "GF_ACTION 3"),
        ({"GF_ACTION": 2.0}, "vehicle's fence", "GF_ACTION 3"),
        ({"GF_ACTION": 4.0}, "vehicle's fence", "GF_ACTION 3"),
        ({"GF_MAX_HOR_DIST": 149.0}, "vehicle's fence", "GF_MAX_HOR_DIST"),
        ({"GF_MAX_VER_DIST": 59.0}, "vehicle's fence", "GF_MAX_VER_DIST"),
        ({"RTL_RETURN_ALT": 0.0}, "way home", "RTL_RETURN_ALT"),
        ({"RTL_LAND_DELAY": -1.0}, "landing", "RTL_LAND_DELAY 0"),
        ({"MIS_YAW_TMT": 5.0}, "turns", "MIS_YAW_TMT -1"),
        ({"TRIG_MODE": 0.0}, "camera trigger", "TRIG_MODE 1"),
        ({"TRIG_MODE": 3.0}, "camera trigger", "TRIG_MODE 1"),
    ],
)
def test_so_it_is_of_px4(changed: dict[str, float], what: str, remedy: str) -> None:
    checks = failsafes.px4({**GOOD_PX4, **changed}, frozenset({255}), REACH)
    [off] = [check for check in checks if not check.fine]
    assert off.what == what
    assert off.remedy.startswith(remedy)


def test_what_is_not_told_is_not_taken_for_set() -> None:
    assert not any(check.fine for check in failsafes.ardupilot({}, frozenset({255}), REACH))
    assert not any(check.fine for check in failsafes.px4({}, frozenset({255}), REACH))
