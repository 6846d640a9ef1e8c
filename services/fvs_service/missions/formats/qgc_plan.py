"""QGroundControl's ``.plan``: https://docs.qgroundcontrol.com/master/en/qgc-dev-guide/file_formats/plan.html."""

import math
from typing import Any

import orjson

from fvs_schema.missions import Autopilot
from fvs_service.missions.flight import Mission
from fvs_service.missions.formats.mavlink_items import Frame, Item, frame_of, items_of

_FIRMWARE = {Autopilot.ARDUPILOT: 3, Autopilot.PX4: 12}
"""``MAV_AUTOPILOT``."""
_QUADROTOR = 2
"""``MAV_TYPE``."""
_ALTITUDE_MODE = {Frame.GLOBAL_RELATIVE_ALT: 1, Frame.GLOBAL: 2, Frame.GLOBAL_TERRAIN_ALT: 4}
"""QGroundControl's own numbers: relative to home, above sea level, in the terrain frame."""
_MIXED_MODES = 0
"""Each item has its own."""


def write(mission: Mission) -> bytes:
    """The mission as a plan file."""
    home, first = mission.home, mission.waypoints[0]
    planned = [*first.place, 0.0]
    if home is not None:
        planned = [home.latitude_deg, home.longitude_deg, home.sea_level_m or 0.0]
    document = {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "QGroundControl",
        "mission": {
            "version": 2,
            "firmwareType": _FIRMWARE[mission.options.autopilot],
            "vehicleType": _QUADROTOR,
            "globalPlanAltitudeMode": _MIXED_MODES
            if mission.options.above_ground
            else _ALTITUDE_MODE[frame_of(mission)],
            "cruiseSpeed": mission.options.speed_m_s,
            "hoverSpeed": mission.options.speed_m_s,
            "plannedHomePosition": planned,
            "items": [_item(number, item) for number, item in enumerate(items_of(mission), start=1)],
        },
        "geoFence": {
            "version": 2,
            "circles": [],
            "polygons": [{"version": 1, "inclusion": True, "polygon": mission.options.fence.corners}]
            if mission.options.fence
            else [],
        },
        "rallyPoints": {"version": 2, "points": []},
    }
    return orjson.dumps(document)


def _item(number: int, item: Item) -> dict[str, Any]:
    parameters = [None if math.isnan(value) else value for value in item.parameters]
    found: dict[str, Any] = {
        "type": "SimpleItem",
        "autoContinue": True,
        "command": int(item.command),
        "doJumpId": number,
        "frame": int(item.frame),
        "params": parameters,
    }
    if item.placed:
        altitude = {"Altitude": parameters[-1], "AltitudeMode": _ALTITUDE_MODE[item.frame]}
        found |= {"AMSLAltAboveTerrain": None, **altitude}
    return found
