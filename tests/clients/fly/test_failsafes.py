"""What the checklist says of the vehicle's own failsafes."""

from collections.abc import Iterable

import pytest
from fvs_client.fly import failsafes
from fvs_client.fly.failsafes import Check, Reach
from fvs_client.fly.own_fence import OwnFence

from fvs_schema.fence import Fence

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
        ({"SYSID_MYGCS": 245.0}, "lost ground station", "SYSID_MYGCS: it hides that"),  # it is ours
        ({"MAV_GCS_SYSID": 1.0, "MAV_GCS_SYSID_HI": 255.0}, "lost ground station", "MAV_GCS_SYSID: it hides"),
        ({"MAV_GCS_SYSID": 250.0, "MAV_GCS_SYSID_HI": 254.0}, "lost ground station", "connect that ground"),
        ({"BATT_MONITOR": 0.0}, "low battery", "BATT_MONITOR"),
        ({"FENCE_ENABLE": 0.0, "FENCE_AUTOENABLE": 1.0}, "vehicle's fence", "FENCE_ENABLE 1"),
        ({"RTL_ALT_FINAL": 500.0}, "landing", "RTL_ALT_FINAL 0"),
        ({"RTL_ALT_FINAL_M": 5.0}, "landing", "RTL_ALT_FINAL_M 0"),
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
    ("changed", "line"),
    [
        (
            {"FENCE_ENABLE": 0.0, "FENCE_AUTOENABLE": 3.0},
            "vehicle's fence: RTL, else LAND (FENCE_ACTION 1), from arming on (FENCE_AUTOENABLE 3); 300 m "
            "around home, up to 100 m",
        ),
        (
            {"MAV_GCS_SYSID": 250.0, "MAV_GCS_SYSID_HI": 255.0, "FS_OPTIONS": 0.0},
            "lost ground station: RTL (FS_GCS_ENABLE 1), also on missions (FS_OPTIONS); of system 250 to 255 "
            "(MAV_GCS_SYSID)",
        ),
        (
            {"MAV_GCS_SYSID": 255.0, "MAV_GCS_SYSID_HI": 0.0, "FS_OPTIONS": 0.0},
            "lost ground station: RTL (FS_GCS_ENABLE 1), also on missions (FS_OPTIONS); of system 255 "
            "(MAV_GCS_SYSID)",
        ),
        (
            {"RTL_ALT_M": 20.0, "RTL_ALT_TYPE": 1.0, "RTL_CONE_SLOPE": 3.0},
            "way home: at 20 m above the ground (RTL_ALT_TYPE) or higher (RTL_ALT_M), lower near home "
            "(RTL_CONE_SLOPE): above all obstacles?",
        ),
    ],
)
def test_what_other_parameters_change_is_told(changed: dict[str, float], line: str) -> None:
    checks = failsafes.ardupilot({**GOOD, **changed}, frozenset({255}), REACH)
    assert f"[ ok ] {line}" in [str(check) for check in checks]


def test_a_fence_of_which_nothing_is_told_is_not_off() -> None:
    told = {name: value for name, value in GOOD.items() if not name.startswith("FENCE")}
    check = _fence_of(failsafes.ardupilot(told, frozenset({255}), REACH))
    assert check.found == "not told (FENCE_ENABLE)"
    assert not check.fine


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


HIGHEST_60 = Reach(away_m=150.0, highest_m=60.0, ceiling_m=60.0)


@pytest.mark.parametrize(
    ("changed", "remedy"),
    [
        ({"FENCE_ALT_MAX": 59.0}, "FENCE_ALT_MAX: the flight may go up to 60 m"),
        ({"FENCE_ALT_MAX": 60.0}, ""),
        ({"FENCE_ALT_MAX": 70.0}, ""),
        (
            {"FENCE_ALT_MAX": 71.0},
            "FENCE_ALT_MAX: its ceiling is far above the flight's 60 m (--highest)",
        ),
        ({"FENCE_ALT_MAX": 71.0, "FENCE_TYPE": 6.0}, "FENCE_TYPE 7, FENCE_ALT_MAX: it has no ceiling"),
    ],
)
def test_a_ceiling_is_that_of_the_flight(changed: dict[str, float], remedy: str) -> None:
    checks = failsafes.ardupilot({**GOOD, **changed}, frozenset({255}), HIGHEST_60)
    assert _fence_of(checks).remedy == remedy


@pytest.mark.parametrize(
    ("top_m", "remedy"),
    [
        (59.0, "GF_MAX_VER_DIST: the flight may go up to 60 m"),
        (60.0, ""),
        (71.0, "GF_MAX_VER_DIST: its ceiling is far above the flight's 60 m (--highest)"),
        (0.0, "GF_MAX_VER_DIST: its ceiling is far above the flight's 60 m (--highest)"),
    ],
)
def test_so_it_is_of_px4s_ceiling(top_m: float, remedy: str) -> None:
    checks = failsafes.px4({**GOOD_PX4, "GF_MAX_VER_DIST": top_m}, frozenset({255}), HIGHEST_60)
    assert _fence_of(checks).remedy == remedy


def _square(south_deg: float, side_deg: float) -> Fence:
    north_deg, west_deg, east_deg = south_deg + side_deg, 8.54, 8.54 + side_deg
    corners = (south_deg, west_deg), (south_deg, east_deg), (north_deg, east_deg), (north_deg, west_deg)
    return Fence(corners)


GEOFENCE = _square(47.0, 0.001)


@pytest.mark.parametrize(
    ("own", "changed", "found", "remedy"),
    [
        (OwnFence((GEOFENCE,)), {}, "; its polygon is --geofence", ""),
        (OwnFence((GEOFENCE,)), {"FENCE_TYPE": 3.0}, "--geofence", "FENCE_TYPE 7: its polygons do not act"),
        (
            OwnFence((GEOFENCE,)),
            {"FENCE_ENABLE": 0.0, "FENCE_TYPE": 3.0, "FENCE_ACTION": 0.0},
            "off; its polygon is --geofence",
            "FENCE_ENABLE 1, FENCE_ALT_MAX; FENCE_ACTION 1; FENCE_TYPE 7: its polygons do not act",
        ),
        (
            OwnFence((_square(46.9995, 0.001),)),
            {},
            "--geofence is not inside",
            "--upload-fence, or a smaller",
        ),
        (OwnFence((_square(47.5, 0.001),)), {}, "--geofence is not inside", "--upload-fence, or a smaller"),
        (
            OwnFence((Fence([(46.9, 8.5), (46.9, 8.6), (47.1, 8.6), (47.1, 8.5)]),), others=2),
            {},
            "; --geofence is inside its polygon",
            "its 2 other zones are not compared: look at them",
        ),
        (OwnFence(), {}, "up to 100 m", ""),
        (None, {}, "up to 100 m", ""),
    ],
)
def test_the_geofence_is_compared_with_the_vehicles_own(
    own: OwnFence | None, changed: dict[str, float], found: str, remedy: str
) -> None:
    reach = Reach(150.0, 60.0, geofence=GEOFENCE, own=own)
    check = _fence_of(failsafes.ardupilot({**GOOD, **changed}, frozenset({255}), reach))
    assert found in check.found
    assert check.remedy.startswith(remedy)
    assert bool(check.remedy) is bool(remedy)


def test_a_polygon_of_px4_acts_without_distances() -> None:
    reach = Reach(150.0, 60.0, geofence=GEOFENCE, own=OwnFence((GEOFENCE,)))
    none = {"GF_MAX_HOR_DIST": 0.0}
    check = _fence_of(failsafes.px4({**GOOD_PX4, **none}, frozenset({255}), reach))
    assert check.fine
    assert check.found.endswith("; its polygon is --geofence")
    check = _fence_of(failsafes.px4({**GOOD_PX4, **none, "GF_ACTION": 0.0}, frozenset({255}), reach))
    assert check.remedy == "GF_ACTION 3, GF_MAX_VER_DIST"


def _fence_of(checks: Iterable[Check]) -> Check:
    return next(check for check in checks if check.what == "vehicle's fence")


def test_what_is_not_told_is_not_taken_for_set() -> None:
    assert not any(check.fine for check in failsafes.ardupilot({}, frozenset({255}), REACH))
    assert not any(check.fine for check in failsafes.px4({}, frozenset({255}), REACH))
