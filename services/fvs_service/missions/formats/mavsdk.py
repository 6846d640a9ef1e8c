"""Items of MAVSDK's plugin ``mission``, as the JSON of ``mavsdk.rpc.mission.UploadMissionRequest``.

Every protobuf library with MAVSDK's ``mission.proto`` reads it; in Python the fields of an item are those of
``mavsdk.mission.MissionItem``. Altitudes are above home, and MAVSDK takes off by itself. The plugin is for
PX4: ArduPilot takes the first item for home, and turns to no waypoint's yaw.
"""

from typing import Any

import orjson

from fvs_schema.error_codes import FieldError
from fvs_schema.missions import Autopilot, Finish
from fvs_schema.scenes import AltitudeDatum
from fvs_service.errors import InvalidRequestError
from fvs_service.missions.flight import Mission, Waypoint
from fvs_service.missions.times import SETTLE_S

DATUMS = frozenset({AltitudeDatum.TAKEOFF})


def write(mission: Mission) -> bytes:
    """The mission as MAVSDK's items; raises ``InvalidRequestError`` for ArduPilot."""
    if mission.options.autopilot is Autopilot.ARDUPILOT:
        raise InvalidRequestError(
            "MAVSDK's mission items are for PX4: ArduPilot drops the first one and does not turn to views.",
            hint="For PX4 give autopilot=px4. For ArduPilot ask for format=qgc-plan, which MAVSDK's "
            "mission_raw reads (import_qgroundcontrol_mission) and uploads.",
            errors=[FieldError("autopilot", "MAVSDK's mission items are for px4")],
        )
    document = {
        "mission_plan": {"mission_items": [_item(mission, waypoint) for waypoint in mission.waypoints]},
        # MAVSDK sets this with a separate call: mission.set_return_to_launch_after_mission.
        "return_to_launch_after_mission": mission.options.finish is Finish.RETURN,
    }
    return orjson.dumps(document)


def _item(mission: Mission, waypoint: Waypoint) -> dict[str, Any]:
    options, is_view = mission.options, waypoint.name is not None
    return {
        "latitude_deg": waypoint.latitude_deg,
        "longitude_deg": waypoint.longitude_deg,
        "relative_altitude_m": waypoint.altitude_m,
        "speed_m_s": options.speed_m_s,
        "is_fly_through": False,
        "gimbal_pitch_deg": waypoint.pitch_deg,
        "gimbal_yaw_deg": 0.0,  # to the vehicle's
        "camera_action": "CAMERA_ACTION_TAKE_PHOTO" if is_view else "CAMERA_ACTION_NONE",
        "loiter_time_s": max(SETTLE_S, options.hold_s) if is_view else 0.0,  # a delay after the turn
        "camera_photo_interval_s": 1.0,
        "acceptance_radius_m": options.acceptance_radius_m,
        "yaw_deg": waypoint.yaw_deg,
        "camera_photo_distance_m": "NaN",  # protobuf's JSON for it
        "vehicle_action": "VEHICLE_ACTION_NONE",
    }
