"""MAVSDK's items, tables, maps, ROS messages and transforms.json, read by other programs' readers."""

import csv
import json
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from fvs_service.errors import InvalidRequestError
from fvs_service.missions.formats import geojson
from fvs_service.missions.writing import write_mission
from fvs_service.scenes.poses import WorldFrame
from google.protobuf import descriptor_pb2, descriptor_pool, json_format, message_factory
from scipy.spatial.transform import Rotation

from fvs_schema.missions import MissionOptions, MissionView
from fvs_schema.poses import FramePose
from fvs_schema.scenes import Alignment, AlignmentStatus
from fvs_schema.snapshots import PinholeIntrinsics

CAMERA = PinholeIntrinsics(width_px=640, height_px=480, fx_px=600, fy_px=601, cx_px=320, cy_px=240)
_FIELD = descriptor_pb2.FieldDescriptorProto


def _upload_request() -> Any:
    """MAVSDK's ``mavsdk.rpc.mission.UploadMissionRequest``, with the fields of its mission.proto."""
    file = descriptor_pb2.FileDescriptorProto(
        name="mission.proto", package="mavsdk.rpc.mission", syntax="proto3"
    )
    item = file.message_type.add(name="MissionItem")
    fields = (
        *(("latitude_deg", _FIELD.TYPE_DOUBLE), ("longitude_deg", _FIELD.TYPE_DOUBLE)),
        *(("relative_altitude_m", _FIELD.TYPE_FLOAT), ("speed_m_s", _FIELD.TYPE_FLOAT)),
        *(("is_fly_through", _FIELD.TYPE_BOOL), ("gimbal_pitch_deg", _FIELD.TYPE_FLOAT)),
        *(("gimbal_yaw_deg", _FIELD.TYPE_FLOAT), ("camera_action", _FIELD.TYPE_ENUM)),
        *(("loiter_time_s", _FIELD.TYPE_FLOAT), ("camera_photo_interval_s", _FIELD.TYPE_DOUBLE)),
        *(("acceptance_radius_m", _FIELD.TYPE_FLOAT), ("yaw_deg", _FIELD.TYPE_FLOAT)),
        *(("camera_photo_distance_m", _FIELD.TYPE_FLOAT), ("vehicle_action", _FIELD.TYPE_ENUM)),
    )
    for number, (name, kind) in enumerate(fields, start=1):
        field = item.field.add(name=name, number=number, type=kind, label=_FIELD.LABEL_OPTIONAL)
        if kind == _FIELD.TYPE_ENUM:
            word = "CameraAction" if name == "camera_action" else "VehicleAction"
            field.type_name = f".mavsdk.rpc.mission.MissionItem.{word}"
    for word, values in (("CameraAction", ("NONE", "TAKE_PHOTO")), ("VehicleAction", ("NONE", "TAKEOFF"))):
        enum = item.enum_type.add(name=word)
        prefix = "CAMERA_ACTION_" if word == "CameraAction" else "VEHICLE_ACTION_"
        for number, value in enumerate(values):
            enum.value.add(name=f"{prefix}{value}", number=number)
    plan = file.message_type.add(name="MissionPlan")
    request = file.message_type.add(name="UploadMissionRequest")
    for outer, name, label, inner in (
        (plan, "mission_items", _FIELD.LABEL_REPEATED, "MissionItem"),
        (request, "mission_plan", _FIELD.LABEL_OPTIONAL, "MissionPlan"),
    ):
        outer.field.add(
            name=name,
            number=1,
            type=_FIELD.TYPE_MESSAGE,
            label=label,
            type_name=f".mavsdk.rpc.mission.{inner}",
        )
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    found = pool.FindMessageTypeByName("mavsdk.rpc.mission.UploadMissionRequest")
    return message_factory.GetMessageClass(found)


def test_protobuf_reads_many_missions_of_mavsdk(flights: Any, errors: Any) -> None:
    kind = _upload_request()
    for flight in flights:
        document = json.loads(flight.write(format="mavsdk", autopilot="px4", speed_m_s=3.0))
        assert document.pop("return_to_launch_after_mission") is True
        items = json_format.ParseDict(document, kind()).mission_plan.mission_items
        photographed = [item for item in items if item.camera_action == 1]
        for view, item in zip(flight.views, photographed, strict=True):
            altitude = item.relative_altitude_m - flight.to_takeoff_m
            place = (item.latitude_deg, item.longitude_deg, altitude)
            errors.add(flight, view, place, item.yaw_deg, item.gimbal_pitch_deg)
            assert item.loiter_time_s == 4.0
        assert {item.speed_m_s for item in items} == {3.0}
        assert not any(item.is_fly_through for item in items)
        assert np.isnan(items[0].camera_photo_distance_m)
    errors.check("MAVSDK")


def test_mavsdks_items_are_not_for_ardupilot(flights: Any) -> None:
    with pytest.raises(InvalidRequestError, match="items are for PX4: ArduPilot drops the first") as refused:
        flights[0].write(format="mavsdk")
    assert [error.field for error in refused.value.errors] == ["autopilot"]
    assert "import_qgroundcontrol_mission" in refused.value.hint


def test_many_missions_come_back_from_tables_and_maps(flights: Any, errors: Any) -> None:
    for flight in flights:
        rows = list(csv.DictReader(flight.write(format="csv").decode().splitlines()))
        collection = json.loads(flight.write(format="geojson"))
        points = [one for one in collection["features"] if one["properties"]["kind"] == "view"]
        seen = [row for row in rows if row["photograph"] == "1"]
        for view, row, point in zip(flight.views, seen, points, strict=True):
            assert row["id"] == point["properties"]["id"] == view.id
            properties = point["properties"]
            longitude, latitude = point["geometry"]["coordinates"]
            for found, place in (
                (row, (row["latitude_deg"], row["longitude_deg"])),
                (properties, (latitude, longitude)),
            ):
                altitude = float(found["altitude_m"]) - flight.to_takeoff_m
                place = (*map(float, place), altitude)
                errors.add(flight, view, place, float(found["yaw_deg"]), float(found["pitch_deg"]))
    errors.check("CSV and GeoJSON")


def _in_world(pose: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """The position of a ROS pose, and its axes: forward, left and up."""
    position = np.array([pose["position"][axis] for axis in "xyz"])
    rotation = Rotation.from_quat([pose["orientation"][axis] for axis in "xyzw"])
    return position, rotation.as_matrix()


def test_poses_of_ros_are_enu_and_look_forward(flights: Any) -> None:
    worst = np.zeros(2)
    for flight in flights:
        array = json.loads(flight.write(format="ros-posearray"))
        stamped = json.loads(flight.write(format="ros-posestamped"))
        assert array["header"] == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": "map"}
        assert [one["pose"] for one in stamped] == array["poses"]
        assert all(one["header"] == array["header"] for one in stamped)
        for view, pose in zip(flight.views, array["poses"], strict=True):
            wanted = flight.frame.world_from_camera(view.pose)
            position, axes = _in_world(pose)
            right, down, forward = wanted.rotation.T
            error = np.abs(axes - np.column_stack([forward, -right, -down])).max()
            worst = np.maximum(worst, [np.abs(position - wanted.translation).max(), error])
    assert worst[0] < 1e-6
    assert worst[1] < 1e-9


def test_transforms_of_nerfstudio_are_of_opengl_cameras(flights: Any) -> None:
    for flight in flights[:100]:
        options = MissionOptions.model_validate({**flight.options, "format": "nerfstudio"})
        file = write_mission("t", flight.frame, flight.views, (), options, None, CAMERA)
        document = json.loads(file.content)
        assert file.name == "t.transforms.json"
        found = [document[name] for name in ("w", "h", "fl_x", "fl_y", "cx", "cy")]
        assert found == [640, 480, 600, 601, 320, 240]
        for view, frame in zip(flight.views, document["frames"], strict=True):
            wanted = flight.frame.world_from_camera(view.pose)
            matrix = np.array(frame["transform_matrix"])
            assert frame["file_path"] == f"images/{view.id}.jpg"
            np.testing.assert_allclose(matrix[:3, 3], wanted.translation, atol=1e-9)
            # OpenGL: the camera looks along -z, its image's up is y.
            np.testing.assert_allclose(-matrix[:3, 2], wanted.rotation[:, 2], atol=1e-9)
            np.testing.assert_allclose(matrix[:3, 1], -wanted.rotation[:, 1], atol=1e-9)
            assert np.linalg.det(matrix) == pytest.approx(1.0)


VIEW = MissionView(id="a", pose=FramePose(position=(1.0, 2.0, 3.0), orientation_wxyz=(1.0, 0.0, 0.0, 0.0)))


def _written(status: AlignmentStatus, **options: Any) -> bytes:
    frame = WorldFrame(None, Alignment(status=status))
    return write_mission("m", frame, [VIEW], (), MissionOptions.model_validate(options), None, CAMERA).content


def test_robots_need_metres_and_no_latitude() -> None:
    for name in ("ros-posearray", "ros-posestamped", "nerfstudio"):
        assert b"1.0" in _written(AlignmentStatus.ALIGNED, format=name)
        with pytest.raises(InvalidRequestError, match="not georeferenced"):
            _written(AlignmentStatus.ALIGNED, format=name, geofence="1,1;1,2;2,2")
    assert b"transform_matrix" in _written(AlignmentStatus.MODEL, format="nerfstudio")
    for name in ("ros-posearray", "ros-posestamped"):
        with pytest.raises(InvalidRequestError, match="The scene has no metres, which ROS needs") as refused:
            _written(AlignmentStatus.MODEL, format=name)
        assert "GPS" in refused.value.hint
    for name in (
        "qgc-plan",
        "qgc-wpl",
        "dji-kmz",
        "litchi-csv",
        "mavsdk",
        "kml",
        "briefing",
        "csv",
        "geojson",
    ):
        with pytest.raises(InvalidRequestError, match="not georeferenced"):
            _written(AlignmentStatus.ALIGNED, format=name)


def test_robots_get_only_what_can_be_flown(flights: Any) -> None:
    flight = next(one for one in flights if len(one.views) == 5)
    options = {"leave_out": True, "highest_height_m": 60.0, "transit_height_m": 20.0}
    ids = [row["id"] for row in csv.DictReader(flight.write(**options).decode().splitlines()) if row["id"]]
    assert 0 < len(ids) < 5
    assert len(json.loads(flight.write(format="ros-posearray", **options))["poses"]) == len(ids)


def test_a_ranking_without_its_snapshot_has_no_intrinsics(flights: Any) -> None:
    with pytest.raises(InvalidRequestError, match="the intrinsics"):
        flights[0].write(format="nerfstudio")


@pytest.mark.parametrize(
    ("longitudes", "lines"),
    [
        ((180.0, -180.0), [[-180.0, -180.0]]),
        ((-180.0, 180.0), [[180.0, 180.0]]),
        ((180.0, -179.9), [[-180.0, -179.9]]),
        ((179.9, -180.0), [[179.9, 180.0]]),
        ((179.9, 180.0, -180.0, -179.9), [[179.9, 180.0], [-180.0, -180.0, -179.9]]),
        ((179.9, -180.0, 180.0, 179.9), [[179.9, 180.0], [180.0, 180.0, 179.9]]),
        ((180.0,), [[180.0, 180.0]]),
    ],
)
def test_routes_that_touch_the_antimeridian_have_their_positions(
    longitudes: tuple[float, ...], lines: list[list[float]]
) -> None:
    places = [(float(number), longitude) for number, longitude in enumerate(longitudes)]
    route = geojson._route(places)
    found = [route["coordinates"]] if route["type"] == "LineString" else route["coordinates"]
    assert all(len(line) > 1 for line in found)
    assert {abs(a[0] - b[0]) > 1.0 for line in found for a, b in pairwise(line)} == {False}
    ends = [place for line in found for place in line]
    for latitude, longitude in places:
        assert any(place[1] == latitude and (place[0] - longitude) % 360.0 == 0.0 for place in ends)
    assert [[place[0] for place in line] for line in found] == lines


def test_routes_and_fences_across_the_antimeridian_are_cut_there(flights: Any) -> None:
    flight = next(one for one in flights if one.origin.longitude_deg == 179.9999 and len(one.views) == 5)
    fence = "-17,179;-17,-179;-16,-179;-16,179"
    document = json.loads(flight.write(format="geojson", geofence=fence))
    route = next(one for one in document["features"] if one["properties"]["kind"] == "route")["geometry"]
    assert route["type"] == "MultiLineString"
    for before, after in zip(route["coordinates"][:-1], route["coordinates"][1:], strict=True):
        assert abs(before[-1][0]) == 180.0
        assert (after[0][0], after[0][1]) == (-before[-1][0], before[-1][1])
    for line in route["coordinates"]:
        assert all(abs(a[0] - b[0]) < 1 for a, b in pairwise(line))
    (ring,) = document["features"][-1]["geometry"]["coordinates"]
    assert [corner[0] for corner in ring] in ([179.0, 181.0, 181.0, 179.0, 179.0], [179, 179, 181, 181, 179])
