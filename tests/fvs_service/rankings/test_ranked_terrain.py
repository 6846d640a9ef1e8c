"""Rankings over a terrain: candidates under it have no rank."""

from typing import Any

from fvs_schema.scenes import Alignment, AlignmentStatus

ORIGIN = {"latitude_deg": 46.02, "longitude_deg": 7.75, "altitude_m": 500.0}
TERRAIN: dict[str, Any] = {
    "kind": "heights",
    **{"south_deg": 46.01, "west_deg": 7.74, "latitude_step_deg": 0.02, "longitude_step_deg": 0.01},
    **{"columns": 2, "heights_m": [490.0, 510.0, 490.0, 510.0]},
}
"""500 m high at the middle, 10 m up to the east; it ends at the origin's meridian."""


def _candidate(name: str, longitude_deg: float, altitude_m: float) -> dict[str, Any]:
    pose = {
        **ORIGIN,
        "longitude_deg": longitude_deg,
        "altitude_m": altitude_m,
        "yaw_deg": 0.0,
        "pitch_deg": 0.0,
    }
    return {"id": name, "pose": pose}


CANDIDATES = [
    *(_candidate("above", 7.745, 500.5), _candidate("under", 7.745, 499.5)),
    _candidate("beside", 7.751, 400.0),
]


def _rank(gateway: Any, **request: Any) -> Any:
    scene = gateway.scene(world={"kind": "enu", "origin": ORIGIN})
    gateway.model(scene, alignment=Alignment(status=AlignmentStatus.ALIGNED, scale=100.0))
    return gateway.client.post(
        f"/v1/scenes/{scene}/rankings", json={"candidates": CANDIDATES, "rank_all": True, **request}
    )


def test_candidates_under_the_terrain_are_told(gateway: Any) -> None:
    answer = _rank(gateway, terrain=TERRAIN)
    assert answer.status_code == 201, answer.text
    ranking = answer.json()
    found = {item["id"]: (item["status"], item["rank"], item["pose"]) for item in ranking["candidates"]}
    assert found.keys() == {"above", "under", "beside"}
    assert found["under"] == ("under-ground", None, CANDIDATES[1]["pose"] | found["under"][2])
    assert "under-ground" not in (found["above"][0], found["beside"][0])
    (unknown,) = [one for one in ranking["warnings"] if one["code"] == "ground-unknown"]
    assert unknown["candidates"] == ["beside"]
    assert "no height at 1 of the 3 candidates" in unknown["message"]
    assert ranking["request"]["terrain"] is None
    assert gateway.client.get(answer.headers["location"]).json() == ranking


def test_a_terrain_of_another_place_is_refused(gateway: Any) -> None:
    answer = _rank(gateway, terrain={**TERRAIN, "south_deg": 7.74, "west_deg": 46.01})
    assert answer.status_code == 422
    assert "no height at any of the 3 candidates, around 46.02" in answer.json()["detail"]
    assert [error["field"] for error in answer.json()["errors"]] == ["terrain"]


def test_without_a_candidate_above_the_ground_a_warning_says_so(gateway: Any) -> None:
    answer = _rank(gateway, candidates=CANDIDATES[1:2], terrain=TERRAIN).json()
    assert [one["message"] for one in answer["warnings"] if one["code"] == "none-feasible"] == [
        "None of the 1 candidates is feasible: 1 under the ground."
    ]


def test_a_terrain_above_another_datum_is_refused(gateway: Any) -> None:
    answer = _rank(gateway, terrain={**TERRAIN, "altitude_datum": "ellipsoid"})
    assert answer.status_code == 422
    assert "above the ellipsoid, the scene's altitudes above sea level" in answer.json()["detail"]
    assert [error["field"] for error in answer.json()["errors"]] == ["terrain.altitude_datum"]
    scene = gateway.scene()
    gateway.model(scene)
    nowhere = gateway.client.post(f"/v1/scenes/{scene}/rankings", json={"terrain": TERRAIN})
    assert nowhere.status_code == 422
