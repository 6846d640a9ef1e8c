"""Registry of the formats: the module that writes each, and the names of its files."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from fvs_schema.missions import MissionFormat
from fvs_schema.scenes import AltitudeDatum
from fvs_service.missions.camera_poses import CameraPoses
from fvs_service.missions.flight import Mission
from fvs_service.missions.formats import (
    briefing,
    dji_kmz,
    geojson,
    kml,
    litchi,
    mavlink_items,
    mavsdk,
    nerfstudio,
    qgc_plan,
    qgc_wpl,
    ros,
    table,
)

_ALL = frozenset(AltitudeDatum)
_JSON, _CSV = "application/json", "text/csv; charset=utf-8"


@dataclass(frozen=True)
class MissionWriter:
    """A format for vehicles: its name in messages, its files, and the altitudes that it can have.

    ``above_ground``: whether it can have altitudes above the ground, and, where these are ``flown``, vehicles
    follow the ground from one to the next; where they are ``shown``, other altitudes are flown.
    """

    name: str
    suffix: str
    media_type: str
    datums: frozenset[AltitudeDatum]
    write: Callable[[Mission], bytes]
    above_ground: Literal["never", "shown", "flown"] = "never"


@dataclass(frozen=True)
class PoseWriter:
    """A format of poses in the world frame; ``metric``: only where its unit is the metre and z is up."""

    name: str
    suffix: str
    media_type: str
    metric: bool
    write: Callable[[CameraPoses], bytes]


WRITERS: dict[MissionFormat, MissionWriter | PoseWriter] = {
    MissionFormat.QGC_PLAN: MissionWriter(
        "QGroundControl", ".plan", _JSON, mavlink_items.DATUMS, qgc_plan.write, "flown"
    ),
    MissionFormat.QGC_WPL: MissionWriter(
        "MAVLink", ".waypoints", "text/plain; charset=utf-8", mavlink_items.DATUMS, qgc_wpl.write, "flown"
    ),
    MissionFormat.DJI_KMZ: MissionWriter(
        "DJI", ".kmz", "application/vnd.google-earth.kmz", dji_kmz.DATUMS, dji_kmz.write, "shown"
    ),
    MissionFormat.LITCHI_CSV: MissionWriter("Litchi", ".litchi.csv", _CSV, litchi.DATUMS, litchi.write),
    MissionFormat.MAVSDK: MissionWriter("MAVSDK", ".mavsdk.json", _JSON, mavsdk.DATUMS, mavsdk.write),
    MissionFormat.KML: MissionWriter(
        "KML", ".kml", "application/vnd.google-earth.kml+xml", kml.DATUMS, kml.write, "shown"
    ),
    MissionFormat.BRIEFING: MissionWriter(
        "A briefing", ".briefing.svg", "image/svg+xml", _ALL, briefing.write, "flown"
    ),
    MissionFormat.GEOJSON: MissionWriter("GeoJSON", ".geojson", "application/geo+json", _ALL, geojson.write),
    MissionFormat.CSV: MissionWriter("CSV", ".csv", _CSV, _ALL, table.write),
    MissionFormat.ROS_POSEARRAY: PoseWriter("ROS", ".posearray.json", _JSON, True, ros.write_pose_array),
    MissionFormat.ROS_POSESTAMPED: PoseWriter(
        "ROS", ".posestamped.json", _JSON, True, ros.write_poses_stamped
    ),
    MissionFormat.NERFSTUDIO: PoseWriter("nerfstudio", ".transforms.json", _JSON, False, nerfstudio.write),
}
