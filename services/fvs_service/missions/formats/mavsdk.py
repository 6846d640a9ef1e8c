"""Mission items of MAVSDK, as the JSON of ``mavsdk.rpc.mission.UploadMissionRequest``.

Every protobuf library with MAVSDK's ``mission.proto`` reads it; in Python the fields of an item are those of
``mavsdk.mission.MissionItem``. Altitudes are above home, and MAVSDK takes off by itself.
"""

from typing import Any

import orjson

from fvs_schema.missions import Finish
from fvs_schema.scenes import AltitudeDatum
from fvs_service.missions.flight import Mission, Waypoint

DATUMS = frozenset({AltitudeDatum.TAKEOFF})


def write(mission: Mission) -> bytes:
    """The mission as MAVSDK's items."""
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
        "loiter_time_s": options.hold_s if is_view else 0.0,
        "camera_photo_interval_s": 1.0,
        "acceptance_radius_m": options.acceptance_radius_m,
        "yaw_deg": waypoint.yaw_deg,
        "camera_photo_distance_m": "NaN",  # protobuf's JSON for it
        "vehicle_action": "VEHICLE_ACTION_NONE",
    }
