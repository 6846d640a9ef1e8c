"""Missions over REST: files of rankings and of views."""

import csv
import json
from typing import Any

import pytest
from fvs_service.images.repository import in_order_of_capture

from fvs_schema.scenes import Alignment, AlignmentStatus

ORIGIN = {"latitude_deg": 46.02, "longitude_deg": 7.75, "altitude_m": 500.0, "altitude_datum": "sea-level"}
HOME = {"home_latitude_deg": 46.02, "home_longitude_deg": 7.75, "home_altitude_m": 495.0}
ORBIT = {"generator": {"kind": "orbit", "count": 4}}
ALIGNED = Alignment(status=AlignmentStatus.ALIGNED, scale=10.0)
ON_A_LINE = Alignment(status=AlignmentStatus.ILL_CONDITIONED, scale=10.0)


def _scene(gateway: Any, alignment: Alignment = ALIGNED) -> str:
    scene = gateway.scene(world={"kind": "enu", "origin": ORIGIN})
    gateway.model(scene, alignment=alignment)
    return scene


def _ranking(gateway: Any, scene: str, **request: Any) -> dict[str, Any]:
    answer = gateway.client.post(f"/v1/scenes/{scene}/rankings", json=request)
    assert answer.status_code == 201, answer.text
    return answer.json()


def _mission(gateway: Any, ranking: dict[str, Any], **options: Any) -> Any:
    return gateway.client.get(f"/v1/rankings/{ranking['id']}/mission", params=options)


@pytest.fixture(scope="module")
def scene(gateway: Any) -> str:
    return _scene(gateway)


@pytest.fixture(scope="module")
def ranking(gateway: Any, scene: str) -> dict[str, Any]:
    return _ranking(gateway, scene, **ORBIT)


def _rows(answer: Any) -> list[dict[str, str]]:
    assert answer.status_code == 200, answer.text
    return list(csv.DictReader(answer.text.splitlines()))


def test_a_file_has_a_name_a_type_and_the_ranked_candidates_in_order(gateway: Any, ranking: Any) -> None:
    for name, suffix, kind in (
        ("qgc-plan", "plan", "application/json"),
        ("qgc-wpl", "waypoints", "text/plain; charset=utf-8"),
        ("geojson", "geojson", "application/geo+json"),
        ("csv", "csv", "text/csv; charset=utf-8"),
        ("dji-kmz", "kmz", "application/vnd.google-earth.kmz"),
        ("litchi-csv", "litchi.csv", "text/csv; charset=utf-8"),
        ("mavsdk", "mavsdk.json", "application/json"),
        ("kml", "kml", "application/vnd.google-earth.kml+xml"),
        ("briefing", "briefing.svg", "image/svg+xml"),
        ("ros-posearray", "posearray.json", "application/json"),
        ("ros-posestamped", "posestamped.json", "application/json"),
        ("nerfstudio", "transforms.json", "application/json"),
    ):
        answer = _mission(gateway, ranking, format=name, autopilot="px4", **HOME)
        assert answer.status_code == 200, answer.text
        disposition = f'attachment; filename="{ranking["id"]}.{suffix}"'
        assert answer.headers["content-disposition"] == disposition
        assert answer.headers["content-type"] == kind
        assert int(answer.headers["mission-views"]) >= 2
        flown = name not in ("ros-posearray", "ros-posestamped", "nerfstudio")
        assert ("mission-duration-s" in answer.headers) == ("mission-length-m" in answer.headers) == flown
        assert "left-out" not in answer.headers
    rows = _rows(_mission(gateway, ranking, format="csv"))
    ranked = [item for item in ranking["candidates"] if item["status"] == "ranked"]
    assert 2 <= len(ranked) < len(ranking["candidates"])  # the others were photographed
    for row, item in zip(rows, ranked, strict=True):
        assert row["id"] == item["id"]
        for name in ("latitude_deg", "longitude_deg", "altitude_m", "yaw_deg", "pitch_deg"):
            assert float(row[name]) == pytest.approx(item["pose"][name], abs=1e-4)
    assert [row["id"] for row in _rows(_mission(gateway, ranking, format="csv", first=1))] == [
        row["id"] for row in rows[:1]
    ]


def test_the_capabilities_list_the_formats(gateway: Any, ranking: Any) -> None:
    for name in gateway.client.get("/v1/capabilities").json()["mission_formats"]:
        assert _mission(gateway, ranking, format=name, autopilot="px4", **HOME).status_code == 200
    assert _mission(gateway, ranking, format="pdf").status_code == 422
    assert _mission(gateway, ranking).json()["errors"][0]["field"] == "format"


def test_poses_of_any_frame_become_the_same_mission(gateway: Any, scene: str) -> None:
    files = [
        _rows(_mission(gateway, _ranking(gateway, scene, **ORBIT, frame=frame), format="csv"))
        for frame in ("world", "model", "geodetic")
    ]
    for file in files[1:]:
        for row, other in zip(file, files[0], strict=True):
            for name in ("latitude_deg", "longitude_deg", "altitude_m", "pitch_deg"):
                assert float(row[name]) == pytest.approx(float(other[name]), abs=1e-4)


def test_views_that_cannot_be_flown_are_named_or_left_out(gateway: Any, scene: str) -> None:
    at = {**ORIGIN, "altitude_m": 510.0, "yaw_deg": 0.0, "pitch_deg": -10.0}
    views = {
        "views": [{"id": "near", "pose": at}, {"id": "high", "pose": {**at, "altitude_m": 900.0}}],
    }
    address, options = f"/v1/scenes/{scene}/missions", {"format": "csv", **HOME, "highest_height_m": 120}
    refused = gateway.client.post(address, json=views, params=options)
    assert refused.status_code == 422
    problem = refused.json()
    assert [error["field"] for error in problem["errors"]] == ["high"]
    assert "leave_out" in problem["hint"]
    left = gateway.client.post(address, json=views, params={**options, "leave_out": "true"})
    assert [row["id"] for row in _rows(left)] == ["near"]
    assert left.headers["left-out"] == "high"
    reasons = json.loads(left.headers["left-out-reasons"])
    assert reasons == ["it is 405.0 m above home; the highest allowed is 120 m"]
    many = [{"id": f"high-{n}", "pose": {**at, "altitude_m": 900.0 + n}} for n in range(40)]
    views["views"] += [*many, {"id": "up", "pose": {**at, "pitch_deg": 60.0}}]
    left = gateway.client.post(address, json=views, params={**options, "leave_out": "true"})
    assert left.headers["left-out"].count(",") == 41
    assert len(json.loads(left.headers["left-out-reasons"])) == 16
    views["views"] = views["views"][:1] + views["views"][-1:]
    left = gateway.client.post(address, json=views, params={**options, "leave_out": "true"})
    assert json.loads(left.headers["left-out-reasons"]) == [
        "it needs a gimbal pitch of 60.0°; -90° to 30° are allowed"
    ]


def test_views_under_the_model_are_under_ground(gateway: Any, scene: str) -> None:
    """The model's points end 10 m below the origin."""
    at = {**ORIGIN, "altitude_m": 480.0, "yaw_deg": 0.0, "pitch_deg": -10.0}
    answer = gateway.client.post(
        f"/v1/scenes/{scene}/missions",
        json={"views": [{"id": "deep", "pose": at}]},
        params={"format": "csv"},
    )
    assert answer.status_code == 422
    assert answer.json()["errors"] == [
        {"field": "deep", "message": "it is under ground: 10.0 m below the lowest point of the model"}
    ]


def test_a_tour_of_a_plan_becomes_a_mission(gateway: Any, scene: str) -> None:
    request = {"generator": {"kind": "orbit", "count": 8, "height_m": 30.0}, "views": 3, "home": True}
    plan = gateway.client.post(f"/v1/scenes/{scene}/plans", json=request).json()
    (tour,) = plan["tours"]
    by_id = gateway.client.get(f"/v1/plans/{plan['id']}/mission", params={"format": "csv", **HOME})
    assert [row["id"] for row in _rows(by_id)] == [stop["id"] for stop in tour["stops"]]
    address = f"/v1/scenes/{scene}/missions"
    body = {"views": tour["stops"], "via_home": tour["via_home"], "snapshot_id": plan["snapshot_id"]}
    answer = gateway.client.post(address, json=body, params={"format": "csv", **HOME})
    assert _rows(answer) == _rows(by_id)
    wrong = gateway.client.post(
        address, json={"views": [{**tour["stops"][0], "vai": []}]}, params={"format": "csv"}
    )
    assert wrong.json()["errors"][0]["field"] == "views.0.vai"


def test_ranked_candidates_become_a_mission_as_they_are(gateway: Any, scene: str, ranking: Any) -> None:
    ranked = [item for item in ranking["candidates"] if item["rank"] is not None]
    answer = gateway.client.post(
        f"/v1/scenes/{scene}/missions", json={"views": ranked}, params={"format": "csv", **HOME}
    )
    assert _rows(answer) == _rows(_mission(gateway, ranking, format="csv", **HOME))


def test_a_plan_has_a_mission_for_each_vehicle(gateway: Any, scene: str, ranking: Any) -> None:
    candidates = [{"id": item["id"], "pose": item["pose"]} for item in ranking["candidates"]]
    request = {"candidates": candidates, "vehicles": [candidates[0]["pose"], candidates[2]["pose"]]}
    plan = gateway.client.post(f"/v1/scenes/{scene}/plans", json=request).json()
    path = f"/v1/plans/{plan['id']}/mission"
    flown = [
        [row["id"] for row in _rows(gateway.client.get(path, params={"format": "csv", "vehicle": number}))]
        for number in (1, 2)
    ]
    assert flown == [[stop["id"] for stop in tour["stops"]] for tour in plan["tours"]]
    beyond = gateway.client.get(path, params={"format": "csv", "vehicle": 3}).json()
    assert beyond["errors"] == [{"field": "vehicle", "message": "the plan is for 2 vehicles, counted from 1"}]


def test_photographs_are_taken_again(gateway: Any) -> None:
    scene = gateway.scene(world={"kind": "enu", "origin": ORIGIN})
    snapshot = gateway.model(scene, alignment=ALIGNED)
    cameras = gateway.client.get(f"/v1/snapshots/{snapshot}/artifacts/cameras.json").json()
    digests = [view["image"] for view in cameras["views"]]
    address, options = f"/v1/scenes/{scene}/missions", {"format": "csv", "lowest_height_m": -100, **HOME}

    def flown(document: Any) -> list[dict[str, str]]:
        return _rows(gateway.client.post(address, json=document, params=options))

    views = [
        {
            "id": view["image"],
            "pose": {
                "frame": "model",
                "position": view["position"],
                "orientation_wxyz": view["orientation_wxyz"],
            },
        }
        for view in cameras["views"]
    ]
    by_hand = flown({"views": views})
    assert [row["id"] for row in by_hand] == digests
    assert flown({"all_images": True, "snapshot_id": snapshot}) == by_hand
    two = flown({"images": [digests[3], digests[1]]})
    assert [row["id"] for row in two] == [digests[3], digests[1]]
    assert two[0]["latitude_deg"] == by_hand[3]["latitude_deg"]
    for wrong, field in (
        ({"images": [digests[0], f"sha256:{'0' * 64}"]}, "images"),
        ({"images": [digests[0], digests[0]]}, "images"),
        ({"images": []}, "images"),
        ({"images": ["all"]}, "images.0"),
        ({"images": digests, "all_images": True}, "images"),
        ({"views": views, "all_images": True}, "views"),
    ):
        refused = gateway.client.post(address, json=wrong, params=options)
        assert refused.status_code == 422
        assert refused.json()["errors"][0]["field"] == field


def test_all_photographs_are_in_the_order_of_capture(gateway: Any, photograph: Any) -> None:
    scene = gateway.scene(world={"kind": "enu", "origin": ORIGIN})
    at = {
        "first": "2026-05-01T10:00:00+02:00",
        "last": "2026-05-01T09:00:00Z",
        "second": "2026-05-01T08:30:00Z",
    }
    digests = {
        name: gateway.put(scene, photograph(seed), captured_at=time).json()["digest"]
        for seed, (name, time) in enumerate(at.items())
    }
    with gateway.application.storage.database.reading() as session:
        found = in_order_of_capture(session, scene)
    assert found == (digests["first"], digests["second"], digests["last"])
    without = gateway.put(scene, photograph(7)).json()["digest"]
    with gateway.application.storage.database.reading() as session:
        found = in_order_of_capture(session, scene)
    assert found == (*digests.values(), without)


def test_missions_outlive_the_snapshot(gateway: Any) -> None:
    scene = gateway.scene(world={"kind": "enu", "origin": ORIGIN})
    snapshot = gateway.model(scene, alignment=ALIGNED)
    paths = []
    for frame in ("model", "geodetic"):
        paths.append(f"/v1/rankings/{_ranking(gateway, scene, **ORBIT, frame=frame)['id']}/mission")
        plan = gateway.client.post(f"/v1/scenes/{scene}/plans", json={**ORBIT, "frame": frame}).json()
        paths.append(f"/v1/plans/{plan['id']}/mission")
    before = [_rows(gateway.client.get(path, params={"format": "csv", **HOME})) for path in paths]
    gateway.model(scene, alignment=Alignment(status=AlignmentStatus.ALIGNED, scale=20.0))
    assert gateway.client.delete(f"/v1/snapshots/{snapshot}").status_code == 204
    frames = gateway.application.missions._frames
    for name in ("_snapshot", "_cameras", "_geometry", "_frame"):  # a gateway that starts later has none
        getattr(frames, name).cache_clear()
    after = [_rows(gateway.client.get(path, params={"format": "csv", **HOME})) for path in paths]
    assert after == before
    refused = gateway.client.get(paths[0], params={"format": "nerfstudio"})
    assert "snapshot of the ranking was deleted" in refused.json()["detail"]


def test_tours_of_vehicles_are_cut_to_a_battery(gateway: Any, scene: str, ranking: Any) -> None:
    candidates = [{"id": item["id"], "pose": item["pose"]} for item in ranking["candidates"]]
    request = {"candidates": candidates, "vehicles": [candidates[0]["pose"], candidates[2]["pose"]]}
    plan = gateway.client.post(f"/v1/scenes/{scene}/plans", json=request).json()
    options = {"format": "csv", **HOME, "battery_s": 220, "battery_reserve": 0.5}
    for number, tour in enumerate(plan["tours"], start=1):
        flown, part, parts = [], 1, 1
        while part <= parts:
            answer = gateway.client.get(
                f"/v1/plans/{plan['id']}/mission", params={**options, "vehicle": number, "part": part}
            )
            flown += [row["id"] for row in _rows(answer)]
            parts = int(answer.headers["mission-parts"])
            name = f'attachment; filename="{plan["id"]}-{part}-of-{parts}.csv"'
            assert answer.headers["content-disposition"] == name
            part += 1
        assert flown == [stop["id"] for stop in tour["stops"]]
        beyond = gateway.client.get(
            f"/v1/plans/{plan['id']}/mission", params={**options, "vehicle": number, "part": part}
        )
        assert beyond.status_code == 422
        assert beyond.json()["errors"][0]["field"] == "part"


def test_a_scene_without_georeference_refuses_with_the_remedy(gateway: Any) -> None:
    scene = gateway.scene()
    gateway.model(scene)
    ranking = _ranking(gateway, scene, **ORBIT)
    for name in ("qgc-plan", "qgc-wpl", "geojson", "csv"):
        problem = _mission(gateway, ranking, format=name).json()
        assert problem["status"] == 422
        assert "not georeferenced" in problem["detail"]
        assert "GPS" in problem["hint"]
        assert "enu world" in problem["hint"]
    frames = _mission(gateway, ranking, format="nerfstudio").json()["frames"]
    assert len(frames) == sum(item["status"] == "ranked" for item in ranking["candidates"])


def test_axes_that_are_not_sure_are_not_flown(gateway: Any) -> None:
    scene = _scene(gateway, ON_A_LINE)
    problem = _mission(gateway, _ranking(gateway, scene, **ORBIT), format="csv").json()
    assert problem["status"] == 422
    assert "lie on a line" in problem["detail"]
    at = {**ORIGIN, "latitude_deg": 46.0197, "altitude_m": 510.0, "yaw_deg": 0.0, "pitch_deg": -10.0}
    given = _ranking(gateway, scene, candidates=[{"id": "a", "pose": at}])
    assert _mission(gateway, given, format="csv").status_code == 200
    for frame, status in (("model", 422), ("world", 200)):
        pose = {"frame": frame, "position": [0.0, -30.0, 10.0], "orientation_wxyz": [0.5, -0.5, 0.5, -0.5]}
        body = {"views": [{"id": "a", "pose": pose}]}
        answer = gateway.client.post(
            f"/v1/scenes/{scene}/missions",
            json=body,
            params={"format": "csv", "gimbal_lowest_deg": -180, "gimbal_highest_deg": 180},
        )
        assert answer.status_code == status, answer.text


def test_a_ranking_outlives_its_snapshot_and_so_do_its_missions(gateway: Any) -> None:
    scene = _scene(gateway)
    ranking = _ranking(gateway, scene, **ORBIT)
    before = _mission(gateway, ranking, format="csv").content
    gateway.model(scene, alignment=ALIGNED)
    assert gateway.client.delete(f"/v1/snapshots/{ranking['snapshot_id']}").status_code == 204
    assert _mission(gateway, ranking, format="csv").content == before


def test_the_plan_has_the_fence(gateway: Any, ranking: Any) -> None:
    fence = "46.01,7.74;46.03,7.74;46.03,7.76;46.01,7.76"
    plan = _mission(gateway, ranking, format="qgc-plan", geofence=fence, **HOME).json()
    assert len(json.loads(json.dumps(plan))["geoFence"]["polygons"][0]["polygon"]) == 4
    refused = _mission(gateway, ranking, format="qgc-plan", geofence="1,1;1,2;2,2", **HOME)
    assert refused.json()["errors"] == [{"field": "geofence", "message": "home is outside"}]
    assert _mission(gateway, ranking, format="csv", geofence="1,1").json()["errors"][0]["field"] == "geofence"


@pytest.mark.system
def test_options_at_and_beyond_their_limits_never_fail_the_service(gateway: Any, ranking: Any) -> None:
    document = gateway.client.get("/openapi.json").json()
    parameters = document["paths"]["/v1/rankings/{ranking_id}/mission"]["get"]["parameters"]
    tried = 0
    for parameter in parameters:
        schema = parameter["schema"]
        numbers = [one for one in (schema, *schema.get("anyOf", ())) if "maximum" in one]
        for low, high in ((one["minimum"], one["maximum"]) for one in numbers):
            assert parameter["description"], parameter
            for name in ("qgc-plan", "dji-kmz", "ros-posearray"):
                for value in (low, high, "1e-300"):
                    options = {"format": name, **HOME, parameter["name"]: value}
                    assert _mission(gateway, ranking, **options).status_code in (200, 422), options
                for value in (low - 1, high * 2 + 1, "NaN", "1e400", "north", ""):
                    options = {"format": name, **HOME, parameter["name"]: value}
                    answer = _mission(gateway, ranking, **options)
                    assert answer.status_code == 422, options
                    assert [one["field"] for one in answer.json()["errors"]] == [parameter["name"]], options
                    tried += 1
    assert tried >= 200
