"""With PX4's firmware the simulated copter behaves as PX4's sources say; each test names what it is from."""

import math
import time
from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

pytestmark = pytest.mark.process

LATITUDE, LONGITUDE = 473_769_000, 85_417_000
ACCEPTED = mavlink.MAV_RESULT_ACCEPTED
ARM = (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)


def item(command: int, x: int = 0, y: int = 0, z: float = 0.0, **more: Any) -> dict[str, Any]:
    return {"command": command, "x": x, "y": y, "z": z, **more}


TAKEOFF = item(mavlink.MAV_CMD_NAV_TAKEOFF, LATITUDE, LONGITUDE, 10.0, param4=math.nan)
SHUTTER = item(mavlink.MAV_CMD_IMAGE_START_CAPTURE, param3=1.0, param4=1.0, frame=2)
RETURN = item(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH, frame=2)


def view(**more: Any) -> dict[str, Any]:
    """A waypoint where it is, at which it turns around."""
    return item(mavlink.MAV_CMD_NAV_WAYPOINT, LATITUDE, LONGITUDE, 10.0, param4=180.0, **more)


@pytest.mark.parametrize(
    ("way", "parameters", "most_deg"),
    [
        ([view()], {}, 12.0),
        ([view(param1=2.0)], {}, 12.0),
        ([view(), item(mavlink.MAV_CMD_NAV_DELAY, param1=1.0, frame=2)], {}, 0.1),
        ([view()], {"MIS_YAW_TMT": 1.0}, 180.0),
    ],
    ids=[
        "at once",
        "the hold is counted while it turns",
        "a delay begins after the turn",
        "it does not wait",
    ],
)
def test_it_goes_on_when_it_has_nearly_turned(
    flown: Any, way: list[dict[str, Any]], parameters: dict[str, float], most_deg: float
) -> None:
    """``mission_block.cpp``: in ``MIS_YAW_ERR``, unless ``MIS_YAW_TMT`` is set; a hold counts meanwhile."""
    with flown(firmware="px4", speed_up=5.0) as (simulator, ground):
        for name, value in parameters.items():
            ground.mav.param_set_send(1, 1, name.encode(), value, mavlink.MAV_PARAM_TYPE_REAL32)
        assert ground.upload([*way, SHUTTER, RETURN]) == mavlink.MAV_MISSION_ACCEPTED
        assert ground.command(*ARM) == ACCEPTED
        simulator.autopilot.vehicle.position[2] = 10.0
        assert ground.command(mavlink.MAV_CMD_MISSION_START) == ACCEPTED
        taken = ground.next("CAMERA_IMAGE_CAPTURED")
        off_deg = abs(180.0 - yaw_deg(taken.q))
        assert most_deg / 2.0 - 0.05 <= off_deg <= most_deg + 0.1


def yaw_deg(quaternion: list[float]) -> float:
    w, x, y, z = quaternion
    return math.degrees(math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))) % 360.0


def until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + 30.0
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)
