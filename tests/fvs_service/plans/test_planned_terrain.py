"""Plans over a terrain: candidates under it are named and not planned, whatever made them."""

from typing import Any

import pytest

from fvs_schema.scenes import Alignment, AlignmentStatus
from fvs_schema.terrain import Terrain

ORIGIN = {"latitude_deg": 46.02, "longitude_deg": 7.75, "altitude_m": 500.0}
TERRAIN: dict[str, Any] = {
    "kind": "heights",
    **{"south_deg": 46.01, "west_deg": 7.74, "latitude_step_deg": 0.02, "longitude_step_deg": 0.01},
    **{"columns": 3, "heights_m": [-3500.0, 500.0, 4500.0] * 2},
}
"""500 m high at the origin, and 52 m more each 10 m to the east."""
ALIGNED = Alignment(status=AlignmentStatus.ALIGNED, scale=10.0)
VOLUME = {"kind": "cylinder", "base": [0.0, 0.0, -20.0], "radius": 50.0, "height": 40.0}


def _geodetic(name: str, altitude_m: float) -> dict[str, Any]:
    pose = {**ORIGIN, "longitude_deg": 7.7505, "altitude_m": altitude_m, "yaw_deg": 270.0, "pitch_deg": -70.0}
    return {"id": name, "pose": pose}


GIVEN = [_geodetic("over", 701.0), _geodetic("under", 699.0)]
"""Where the ground is 700 m high."""


@pytest.fixture(scope="module")
def scene(gateway: Any) -> str:
    scene = gateway.scene(world={"kind": "enu", "origin": ORIGIN})
    gateway.model(scene, alignment=ALIGNED, terrain=Terrain(**TERRAIN))
    return scene


def _plan(gateway: Any, scene: str, **request: Any) -> Any:
    return gateway.client.post(
        f"/v1/scenes/{scene}/plans", json={"terrain": TERRAIN, "views": 100, **request}
    )


@pytest.mark.parametrize(
    "source",
    [
        {"candidates": GIVEN},
        {"generator": {"kind": "orbit", "count": 12, "height_m": 3.0}},
        {"generator": {"kind": "grid", "columns": 4, "rows": 3, "height_m": 35.0}},
        {"generator": {"kind": "in-volume", "volume": VOLUME, "count": 20}},
    ],
    ids=["given", "orbit", "grid", "in-volume"],
)
def test_rankings_and_plans_agree_on_what_is_under_the_ground(
    gateway: Any, scene: str, source: dict[str, Any]
) -> None:
    answer = _plan(gateway, scene, **source)
    assert answer.status_code == 201, answer.text
    plan = answer.json()
    (found,) = [one for one in plan["warnings"] if one["code"] == "under-ground"]
    ranking = gateway.client.post(f"/v1/scenes/{scene}/rankings", json={"terrain": TERRAIN, **source}).json()
    under = {one["id"] for one in ranking["candidates"] if one["status"] == "under-ground"}
    assert 0 < len(under) < ranking["total"] == found["numbers"]["of"]
    assert set(found["candidates"]) == under
    assert not under & {term["id"] for term in plan["candidates"]}
    ground = Terrain(**TERRAIN)
    poses = [stop["pose"] for tour in plan["tours"] for stop in tour["stops"]]
    assert poses
    for pose in poses:
        assert pose["altitude_m"] >= ground.height_m((pose["latitude_deg"], pose["longitude_deg"]))
    assert plan["request"]["terrain"] is None
    assert gateway.client.get(answer.headers["location"]).json() == plan


def test_a_plan_says_where_the_terrain_has_no_height(gateway: Any, scene: str) -> None:
    hole = {**TERRAIN, "heights_m": [-3500.0, 500.0, -32768.0] * 2}
    plan = _plan(gateway, scene, terrain=hole, generator={"kind": "orbit", "count": 12}).json()
    (unknown,) = [one for one in plan["warnings"] if one["code"] == "ground-unknown"]
    assert 0 < len(unknown["candidates"]) < 12


def test_without_a_candidate_above_the_ground_there_is_no_plan(gateway: Any, scene: str) -> None:
    answer = _plan(gateway, scene, candidates=GIVEN[1:])
    assert answer.status_code == 422
    assert "are under the ground (1)" in answer.json()["detail"]
    other = _plan(gateway, scene, terrain={**TERRAIN, "altitude_datum": "ellipsoid"})
    assert [error["field"] for error in other.json()["errors"]] == ["terrain.altitude_datum"]


def test_the_ground_may_be_that_of_the_points(gateway: Any, scene: str) -> None:
    orbit = {"generator": {"kind": "orbit", "count": 12}}
    by_heights, by_points = (
        _plan(gateway, scene, terrain=terrain, **orbit).json() for terrain in (TERRAIN, {"kind": "points"})
    )
    assert by_points["warnings"] == by_heights["warnings"]
    assert by_points["tours"] == by_heights["tours"]
    assert by_points["request"]["terrain"] == {"kind": "points"}
    snapshot = gateway.client.get(f"/v1/snapshots/{by_points['snapshot_id']}/artifacts/terrain.json")
    again = _plan(gateway, scene, terrain=snapshot.json(), **orbit).json()
    assert again["tours"] == by_heights["tours"]


def test_a_model_of_few_points_has_no_ground(gateway: Any) -> None:
    few, nowhere = gateway.scene(world={"kind": "enu", "origin": ORIGIN}), gateway.scene()
    gateway.model(few, alignment=ALIGNED)
    gateway.model(nowhere)
    for scene, said in ((few, "needs 100 sparse points"), (nowhere, "not georeferenced")):
        for made in ("plans", "rankings"):
            answer = gateway.client.post(f"/v1/scenes/{scene}/{made}", json={"terrain": {"kind": "points"}})
            assert answer.status_code == 422
            assert said in answer.json()["detail"]
