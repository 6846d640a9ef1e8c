"""Plans, visits, rankings and missions directly, over REST and over gRPC: the same results and errors."""

import json
from typing import Any

import pytest
from contract_scenarios import LOOK, ORIGIN, Compare, model_of, refused

from fvs_schema.scenes import Alignment, AlignmentStatus


def test_flights_are_planned(compare: Compare) -> None:
    def scenario(tenant: Any) -> None:
        scene = tenant.scene()
        refused(tenant.call("PlanViews", {}, scene_id=scene), "no-snapshot")
        snapshot = model_of(tenant, scene)
        tenant.call("PlanViews", {}, scene_id=scene)
        candidates = [{"id": f"c{y}", "pose": {**LOOK, "position": [0.0, y + 0.5, -4.0]}} for y in range(4)]
        here = {"candidates": candidates, "vehicles": [LOOK, {**LOOK, "position": [0.0, 4.0, -4.0]}]}
        planned = tenant.call(
            "PlanViews",
            {**here, "views": 3, "distance_m": 9.0, "home": True, "snapshot_id": snapshot},
            scene_id=scene,
        )
        assert len(planned.result["tours"]) == 2
        targets = [{"id": "door", "pose": {**LOOK, "position": [0.0, 3.0, -4.0]}}]
        tenant.call("PlanViews", {**here, "targets": targets, "frame": "model"}, scene_id=scene)
        refused(tenant.call("PlanViews", {**here, "distance_m": 1e-3}, scene_id=scene), "invalid-request")
        refused(
            tenant.call("PlanViews", {"generator": {"kind": "around-current"}}, scene_id=scene),
            "invalid-request",
        )
        refused(tenant.call("PlanViews", {"views": 0}, scene_id=scene), "invalid-request")
        made = planned.result["id"]
        assert tenant.call("GetPlan", plan_id=made).result == planned.result
        listed = tenant.call("ListPlans", scene_id=scene, limit=2).result
        assert [one["id"] for one in listed["items"]][1] == made
        assert len(tenant.call("ListPlans", scene_id=scene, after=listed["next"]).result["items"]) == 1
        refused(tenant.call("ListPlans", scene_id=scene, after="zzz"), "invalid-request")
        key = {"scene_id": scene, "idempotency_key": "p"}
        once = tenant.call("PlanViews", here, **key).result["id"]
        assert tenant.call("PlanViews", here, **key).result["id"] == once
        refused(tenant.call("PlanViews", {}, **key), "idempotency-key-reused")
        tenant.call("DeletePlan", plan_id=once)
        refused(tenant.call("GetPlan", plan_id=once), "not-found")
        refused(tenant.call("PlanViews", here, **key), "gone")
        refused(tenant.call("DeletePlan", plan_id=once), "not-found")

    compare(scenario)


def test_what_is_not_known_is_forecast(compare: Compare) -> None:
    def scenario(tenant: Any) -> None:
        scene = tenant.scene()
        refused(tenant.call("ForecastViews", {}, scene_id=scene), "no-snapshot")
        snapshot = model_of(tenant, scene)
        assert len(tenant.call("ForecastViews", {}, scene_id=scene).result["samples"]) == 24
        grid = {"kind": "grid", "columns": 3, "rows": 2, "look": "down", "margin_m": 4.0}
        asked = {"generator": grid, "snapshot_id": snapshot, "frame": "model"}
        before = tenant.call("ForecastViews", asked, scene_id=scene).result["samples"]
        after = [{"id": one["id"], "pose": one["pose"]} for one in before[:2]]
        then = tenant.call("ForecastViews", {**asked, "after": after}, scene_id=scene).result["samples"]
        assert all(one["variance"] < other["variance"] for one, other in zip(then, before, strict=True))
        places = tenant.call("ForecastViews", {"surface": {"count": 4}}, scene_id=scene).result["samples"]
        assert {one["position"]["frame"] for one in places} == {"world"}
        for wrong in ({"surface": {"count": 0}}, {**asked, "surface": {}}, {"frame": "geodetic"}):
            refused(tenant.call("ForecastViews", wrong, scene_id=scene), "invalid-request")

    compare(scenario)


def test_vehicles_get_different_views(compare: Compare) -> None:
    def scenario(tenant: Any) -> None:
        scene = tenant.scene()
        views = [{"id": f"c{y}", "pose": {**LOOK, "position": [0.0, y + 0.5, -4.0]}} for y in range(3)]
        report = {"vehicle": "north", "state": "going-to", "views": views[:1], "expires_in_s": 3600}
        refused(tenant.call("ReportVisits", report, scene_id=scene), "no-snapshot")
        model_of(tenant, scene)
        tenant.call("ReportVisits", report, scene_id=scene)
        again = {**report, "vehicle": "south", "views": views}
        refused(tenant.call("ReportVisits", again, scene_id=scene), "conflict")
        tenant.call("ReportVisits", {**report, "state": "taken", "views": views[1:2]}, scene_id=scene)
        south = {"vehicle": "south", "state": "failed", "views": views[2:]}
        tenant.call("ReportVisits", south, scene_id=scene)
        tenant.call("ListVisits", scene_id=scene)
        ranking = {"candidates": views}
        taken = {
            vehicle: {
                item["id"]
                for item in tenant.call("RankViews", asked, scene_id=scene).result["candidates"]
                if item["status"] == "taken"
            }
            for vehicle, asked in (
                ("anybody", ranking),
                ("north", {**ranking, "for_vehicle": "north"}),
                ("south", {**ranking, "for_vehicle": "south"}),
            )
        }
        assert taken == {"anybody": {"c0", "c1"}, "north": {"c1"}, "south": {"c0", "c1", "c2"}}
        planned = tenant.call("PlanViews", {"candidates": views, "for_vehicle": "north"}, scene_id=scene)
        assert {stop["id"] for stop in planned.result["tours"][0]["stops"]} == {"c0", "c2"}
        all_taken = {"candidates": views, "for_vehicle": "south"}
        refused(tenant.call("PlanViews", all_taken, scene_id=scene), "invalid-request")
        for wrong in (
            {"vehicle": ""},
            {"views": []},
            {"views": [views[0], views[0]]},
            {"views": [{**view, "id": f"{k}"} for k, view in enumerate(views * 40)]},
            {"expires_in_s": 0},
        ):
            refused(tenant.call("ReportVisits", {**report, **wrong}, scene_id=scene), "invalid-request")

    compare(scenario)


SQUARE = [[x, y, 0.0] for x, y in ((-5.0, -5.0), (5.0, -5.0), (5.0, 5.0), (-5.0, 5.0))]
VOLUMES: list[dict[str, Any]] = [
    {"kind": "box", "centre": [4.0, 0.0, 0.0], "size": [2.0, 8.0, 2.0], "along": [1.0, 1.0, 0.0]},
    {"kind": "cylinder", "base": [0.0, 0.0, 3.0], "radius": 4.0, "height": 2.0, "up": [0.0, 0.1, 1.0]},
    {"kind": "prism", "corners": SQUARE, "lower": 3.0, "upper": 5.0},
    {"kind": "shell", "centre": [0.0, 0.0, 0.0], "inner": 3.0, "outer": 5.0, "above": -1.0},
    {"kind": "corridor", "path": [[-5.0, 4.0, 2.0], [5.0, 4.0, 2.0]], "radius": 1.0},
]


@pytest.mark.system
def test_flights_are_planned_in_volumes(compare: Compare) -> None:
    def scenario(tenant: Any) -> None:
        scene = tenant.scene()
        model_of(tenant, scene)
        for volume in VOLUMES:
            generator = {"kind": "in-volume", "volume": volume, "count": 30}
            made = tenant.call("PlanViews", {"generator": generator, "views": 3}, scene_id=scene)
            assert len(made.result["tours"][0]["stops"]) == 3
        more = {**generator, "level": True, "look": "nearest"}
        zone = {"kind": "box", "centre": [0.0, 4.0, 2.0], "size": [0.5, 1.0, 9.0]}
        asked = {"generator": more, "safety_m": 0.2, "no_fly": [zone], "home": True}
        made = tenant.call("PlanViews", asked, scene_id=scene)
        stops = made.result["tours"][0]["stops"]
        assert any(stop["via"] for stop in stops)
        aimed = {**generator, "aim": [0.0, 0.0, 0.5]}
        tenant.call("PlanViews", {"generator": aimed, "frame": "model"}, scene_id=scene)
        for wrong in (
            {"safety_m": -1.0},
            {"no_fly": [{**zone, "size": [0.0, 1.0, 1.0]}]},
            {"no_fly": [zone] * 21},
            {"generator": {**generator, "count": 0}},
            {"generator": {**more, "aim": [0.0, 0.0, 0.0]}},
            {"generator": {"kind": "in-volume"}},
            {"generator": generator, "safety_m": 1e5},
        ):
            refused(tenant.call("PlanViews", wrong, scene_id=scene), "invalid-request")

    compare(scenario)


@pytest.mark.system
def test_candidates_of_volumes_are_ranked(compare: Compare) -> None:
    shell = {"kind": "shell", "centre": [0.0, 0.0, 0.0], "inner": 3.0, "outer": 5.0}
    zone = {"kind": "box", "centre": [4.0, 0.0, 0.0], "size": [2.0, 9.0, 9.0]}
    generator = {"kind": "in-volume", "volume": shell, "count": 12}

    def scenario(tenant: Any) -> None:
        scene = tenant.scene()
        model_of(tenant, scene)
        made = tenant.call("RankViews", {"generator": generator}, scene_id=scene).result
        assert len(made["candidates"]) == 12
        for volume in VOLUMES:
            asked = {"generator": {**generator, "volume": volume, "aim": [0.0, 0.0, 0.5], "level": True}}
            assert tenant.call("RankViews", {**asked, "no_fly": [zone]}, scene_id=scene).result["total"] > 0
        asked = {"generator": {**generator, "look": "nearest"}, "safety_m": 0.2, "no_fly": [zone], "top_k": 5}
        clear = tenant.call("RankViews", asked, scene_id=scene).result
        assert len(clear["candidates"]) == 5
        assert tenant.call("GetRanking", ranking_id=clear["id"]).result == clear
        *_, last = tenant.call("StreamRankViews", asked, scene_id=scene).result
        assert [place["id"] for place in last["ranking"]["candidates"]] == [
            place["id"] for place in clear["candidates"]
        ]
        for wrong in (
            {"generator": generator, "safety_m": -1.0},
            {"generator": generator, "safety_m": 1e5},
            {"generator": generator, "no_fly": [zone] * 21},
            {"generator": {"kind": "in-volume"}},
        ):
            refused(tenant.call("RankViews", wrong, scene_id=scene), "invalid-request")
            refused(tenant.call("StreamRankViews", wrong, scene_id=scene), "invalid-request")

    compare(scenario)


def test_views_are_ranked_and_rendered(compare: Compare) -> None:
    def scenario(tenant: Any) -> None:
        scene = tenant.scene()
        refused(tenant.call("RankViews", {}, scene_id=scene), "no-snapshot")
        snapshot = model_of(tenant, scene)
        candidates = [
            {"id": name, "pose": {**LOOK, "position": [0.0, y, -4.0]}} for name, y in (("a", 0.0), ("b", 1.0))
        ]
        near = {"current_pose": LOOK, "radius_m": 0.5}
        ranking = tenant.call(
            "RankViews", {"candidates": candidates, **near}, scene_id=scene, idempotency_key="r"
        )
        made = ranking.result["id"]
        again = tenant.call(
            "RankViews", {"candidates": candidates, **near}, scene_id=scene, idempotency_key="r"
        )
        assert again.result["id"] == made
        tenant.call(
            "RankViews",
            {"generator": {"kind": "grid", "columns": 2, "rows": 2, "look": "down"}},
            scene_id=scene,
        )
        tenant.call(
            "RankViews", {"generator": {"kind": "orbit", "count": 3}, "frame": "model"}, scene_id=scene
        )
        tenant.call("RankViews", {"top_k": 2, "snapshot_id": snapshot}, scene_id=scene)
        tenant.call("GetRanking", ranking_id=made)
        listed = tenant.call("ListRankings", scene_id=scene, limit=3).result
        assert [one["total"] for one in listed["items"]] == [24, 3, 4]
        (first,) = tenant.call("ListRankings", scene_id=scene, after=listed["next"]).result["items"]
        assert (first["id"], first["generator"], first["best"]) == (made, None, "a")
        refused(tenant.call("ListRankings", scene_id=scene, after="zzz"), "invalid-request")
        assert tenant.call("RenderCandidate", ranking_id=made, candidate_id="a").result.startswith(b"\x89PNG")
        refused(tenant.call("RenderCandidate", ranking_id=made, candidate_id="z"), "not-found")
        tenant.call("DeleteRanking", ranking_id=made)
        refused(tenant.call("GetRanking", ranking_id=made), "not-found")

    compare(scenario)


def test_a_snapshot_is_rendered_at_any_pose(compare: Compare) -> None:
    def scenario(tenant: Any) -> None:
        scene = tenant.scene()
        refused(tenant.call("RenderView", {"pose": LOOK}, snapshot_id="snp_none"), "not-found")
        snapshot = model_of(tenant, scene)
        png = tenant.call("RenderView", {"pose": LOOK}, snapshot_id=snapshot).result
        assert png.startswith(b"\x89PNG")
        asked = {"pose": {**LOOK, "frame": "model"}, "long_side_px": 96, "format": "jpeg"}
        assert tenant.call("RenderView", asked, snapshot_id=snapshot).result.startswith(b"\xff\xd8")
        spectrum = tenant.call("RenderView", {**asked, "image": "spectrum"}, snapshot_id=snapshot)
        assert spectrum.result.startswith(b"\xff\xd8")
        vehicle = {**_PLACE, "yaw_deg": 0.0, "pitch_deg": -45.0}
        for wrong in ({}, {"pose": vehicle}, {"pose": LOOK, "long_side_px": 63}):
            refused(tenant.call("RenderView", wrong, snapshot_id=snapshot), "invalid-request")

    compare(scenario)


_PLACE = {"latitude_deg": 46.02, "longitude_deg": 7.75, "altitude_m": 500.0, "altitude_datum": "sea-level"}


def test_candidates_under_the_ground_are_named(compare: Compare) -> None:
    corner = {"south_deg": 46.01, "west_deg": 7.74, "latitude_step_deg": 0.02, "longitude_step_deg": 0.01}
    terrain = {"kind": "heights", **corner, "columns": 3, "heights_m": [-3500.0, 500.0, 4500.0] * 2}
    over = {"generator": {"kind": "orbit", "count": 12}, "terrain": terrain}

    def scenario(tenant: Any) -> None:
        scene = tenant.scene(world={"kind": "enu", "origin": _PLACE})
        model_of(tenant, scene, Alignment(status=AlignmentStatus.ALIGNED, scale=10.0))
        plan = tenant.call("PlanViews", over, scene_id=scene).result
        (found,) = [one for one in plan["warnings"] if one["code"] == "under-ground"]
        ranking = tenant.call("RankViews", over, scene_id=scene).result
        statuses = {one["id"]: one["status"] for one in ranking["candidates"]}
        assert {name for name, status in statuses.items() if status == "under-ground"} == set(
            found["candidates"]
        )
        of_points = {**over, "terrain": {"kind": "points"}}
        for call in ("PlanViews", "RankViews"):
            few = refused(tenant.call(call, of_points, scene_id=scene), "invalid-request")
            assert "sparse points" in few.message

    compare(scenario)


@pytest.mark.system
def test_views_become_missions(compare: Compare) -> None:
    origin, aligned = _PLACE, Alignment(status=AlignmentStatus.ALIGNED, scale=10.0)

    def scenario(tenant: Any) -> None:
        flat = tenant.scene()
        model_of(tenant, flat)
        local = tenant.call("RankViews", {"candidates": [{"id": "a", "pose": LOOK}]}, scene_id=flat)
        flat_mission = tenant.call("GetRankingMission", ranking_id=local.result["id"], format="csv")
        refused(flat_mission, "invalid-request")
        assert "not georeferenced" in flat_mission.message
        scene = tenant.scene(world={"kind": "enu", "origin": origin})
        model_of(tenant, scene, aligned)
        candidates = [
            {"id": name, "pose": {**origin, "altitude_m": 530.0, "yaw_deg": yaw, "pitch_deg": -30.0}}
            for name, yaw in (("a", 0.0), ("b", 90.0))
        ]
        orbit = {"generator": {"kind": "orbit", "count": 4}}
        ranking = tenant.call("RankViews", orbit, scene_id=scene).result["id"]
        home = {"home_latitude_deg": 46.02, "home_longitude_deg": 7.75, "home_altitude_m": 495.0}
        fenced = {"geofence": "46,7;46,8;47,8;47,7", "highest_height_m": 50.0, "leave_out": True}
        for name in ("qgc-wpl", "geojson", "csv", "dji-kmz"):
            file = tenant.call("GetRankingMission", ranking_id=ranking, format=name, **home, **fenced)
            assert not file.code, file
            assert len(file.result) > 300
            views = {"views": candidates, "via_home": [candidates[0]["pose"]]}
            again = tenant.call(
                "CreateMission", views, scene_id=scene, format=name, takeoff=False, drone="m30", **home
            )
            assert len(again.result) > 300
        for options in (
            {"format": "csv", "speed_m_s": 1e9},
            {"format": "csv", "geofence": "46,7;46,8"},
            {"format": "csv", "highest_height_m": 10.0},
            {"format": "csv", "highest_height_m": 10.0, "home_altitude_m": 495.0},
            {"format": "qgc-wpl", "altitude_datum": "ellipsoid"},
            {"format": "qgc-wpl", "altitude_datum": "takeoff"},
        ):
            refused(tenant.call("GetRankingMission", ranking_id=ranking, **options), "invalid-request")
            refused(
                tenant.call("CreateMission", {"views": candidates}, scene_id=scene, **options),
                "invalid-request",
            )
        refused(tenant.call("CreateMission", {}, scene_id=scene, format="csv"), "invalid-request")
        passed = [candidates[0]["pose"]] * 40
        long = {"views": [{**candidates[0], "id": f"a{number}", "via": passed} for number in range(20)]}
        assert len(json.dumps(long)) > 65_536  # as much as a body without lists may have
        again = tenant.call("CreateMission", long, scene_id=scene, format="csv", takeoff=False, **home)
        assert again.result, again
        refused(tenant.call("GetRankingMission", ranking_id="rnk_0", format="csv"), "not-found")
        here = {"candidates": candidates, "vehicles": [one["pose"] for one in candidates]}
        plan = tenant.call("PlanViews", here, scene_id=scene).result["id"]
        for vehicle in (1, 2):
            assert tenant.call("GetPlanMission", plan_id=plan, format="csv", vehicle=vehicle, **home).result
        refused(tenant.call("GetPlanMission", plan_id=plan, format="csv", vehicle=3), "invalid-request")
        cut = {"format": "csv", "battery_s": 1000.0, **home}
        assert tenant.call("GetPlanMission", plan_id=plan, **cut).result
        refused(tenant.call("GetPlanMission", plan_id=plan, **cut, part=2), "invalid-request")
        refused(tenant.call("GetRankingMission", ranking_id=ranking, **cut, part=0), "invalid-request")
        refused(tenant.call("GetPlanMission", plan_id=plan, format="csv", vehicle=0), "invalid-request")
        refused(tenant.call("GetPlanMission", plan_id="pln_0", format="csv"), "not-found")

    compare(scenario)


def test_candidates_are_streamed_as_they_are_scored(compare: Compare) -> None:
    def scenario(tenant: Any) -> None:
        scene = tenant.scene()
        refused(tenant.call("StreamRankViews", {}, scene_id=scene), "no-snapshot")
        model_of(tenant, scene)
        candidates = [
            {"id": f"c{number}", "pose": {**LOOK, "position": [0.0, 0.2 * number, -4.0]}}
            for number in range(5)
        ]
        near = {"candidates": candidates, "current_pose": LOOK, "radius_m": 0.5, "top_k": 2}
        *scored, last = tenant.call("StreamRankViews", near, scene_id=scene, idempotency_key="s").result
        assert {one["id"] for part in scored for one in part["candidates"]} == {"c0", "c1", "c2"}
        assert [part["ranking"] for part in scored] == [None] * len(scored)
        made = last["ranking"]
        assert last["candidates"] == []
        assert made == tenant.call("RankViews", near, scene_id=scene, idempotency_key="s").result
        assert made == tenant.call("GetRanking", ranking_id=made["id"]).result
        (again,) = tenant.call("StreamRankViews", near, scene_id=scene, idempotency_key="s").result
        assert again == last
        refused(tenant.call("StreamRankViews", {"method": "no-method"}, scene_id=scene), "invalid-request")
        far = {"candidates": candidates[3:], "current_pose": LOOK, "radius_m": 0.5}
        (only,) = tenant.call("StreamRankViews", far, scene_id=scene).result
        assert {one["status"] for one in only["ranking"]["candidates"]} == {"out-of-range"}

    compare(scenario)


@pytest.mark.parametrize(
    "request_document",
    [
        {"candidates": []},
        {"candidates": [{"id": "a", "pose": {**LOOK, "position": [0.0, 0.0]}}]},
        {"candidates": [{"id": "a", "pose": {**LOOK, "orientation_wxyz": [2.0, 0.0, 0.0, 0.0]}}]},
        {"candidates": [{"id": "a", "pose": LOOK}, {"id": "a", "pose": LOOK}]},
        {"candidates": [{"id": f"c{number}", "pose": LOOK} for number in range(41)]},
        {"candidates": [{"id": "a", "pose": {**ORIGIN, "yaw_deg": 0.0, "pitch_deg": 0.0}}]},
        {"generator": {"kind": "orbit", "count": 41}},
        {"generator": {"kind": "around-current"}},
        {"radius_m": 1.0},
        {"method": "no-method"},
        {"candidates": [{"id": "a", "pose": LOOK}], "generator": {"kind": "dataset"}},
    ],
)
def test_rankings_that_cannot_be_made_are_refused(compare: Compare, request_document: Any) -> None:
    def scenario(tenant: Any) -> None:
        scene = tenant.scene()
        model_of(tenant, scene)
        refused(tenant.call("RankViews", request_document, scene_id=scene), "invalid-request")

    compare(scenario)
