"""The frames of poses in rankings."""

from typing import Any

import numpy as np
import pytest

from fvs_schema.scenes import Alignment, AlignmentStatus

LOOK = {"frame": "world", "position": [0.0, 0.0, -4.0], "orientation_wxyz": [1.0, 0.0, 0.0, 0.0]}
ORIGIN = {"latitude_deg": 48.0, "longitude_deg": 7.0, "altitude_m": 400.0}


def _rank(gateway: Any, scene: str, **request: Any) -> Any:
    return gateway.client.post(f"/v1/scenes/{scene}/rankings", json=request)


@pytest.fixture(scope="module")
def scene(gateway: Any) -> str:
    scene = gateway.scene()
    gateway.model(scene)
    return scene


def test_vehicle_poses_need_a_georeferenced_scene(gateway: Any, scene: str) -> None:
    pose = {
        "latitude_deg": 48.0,
        "longitude_deg": 7.0,
        "altitude_m": 400.0,
        "yaw_deg": 0.0,
        "pitch_deg": -30.0,
    }
    answer = _rank(gateway, scene, candidates=[{"id": "a", "pose": pose}])
    assert answer.status_code == 422
    assert "georeferenced" in answer.json()["detail"]


@pytest.fixture(scope="module")
def georeferenced(gateway: Any) -> str:
    scene = gateway.scene(world={"kind": "enu", "origin": ORIGIN})
    alignment = Alignment(
        status=AlignmentStatus.ALIGNED, scale=2.0, translation=(5.0, 0.0, 0.0), rms_m=0.1, inliers=6
    )
    gateway.model(scene, alignment=alignment)
    return scene


def test_vehicle_poses_are_placed_about_the_origin(gateway: Any, georeferenced: str) -> None:
    pose = {**ORIGIN, "altitude_m": 410.0, "yaw_deg": 90.0, "pitch_deg": -90.0}
    request = {"candidates": [{"id": "a", "pose": pose}]}
    (place,) = _rank(gateway, georeferenced, **request, frame="world").json()["candidates"]
    assert place["pose"]["position"] == pytest.approx([0.0, 0.0, 10.0], abs=1e-6)
    wrong_datum = {**pose, "altitude_datum": "ellipsoid"}
    answer = _rank(gateway, georeferenced, candidates=[{"id": "a", "pose": wrong_datum}])
    assert answer.status_code == 422


def test_a_ranking_on_an_ill_conditioned_alignment_says_so(gateway: Any) -> None:
    origin = {"latitude_deg": 48.3, "longitude_deg": 7.25, "altitude_m": 400.0}
    scene = gateway.scene(world={"kind": "enu", "origin": origin})
    gateway.model(scene, alignment=Alignment(status=AlignmentStatus.ILL_CONDITIONED))
    vehicle = {**origin, "altitude_m": 404.0, "yaw_deg": 0.0, "pitch_deg": -90.0}
    for pose in (vehicle, LOOK):
        (warning,) = _rank(gateway, scene, candidates=[{"id": "a", "pose": pose}]).json()["warnings"]
        assert warning["code"] == "ill-conditioned"
        assert "second line" in warning["hint"]
    in_model = [{"id": "a", "pose": {**LOOK, "frame": "model"}}]
    assert _rank(gateway, scene, candidates=in_model).json()["warnings"] == []
    assert _rank(gateway, scene, generator={"kind": "orbit", "count": 2}).json()["warnings"]
    gateway.model(scene, alignment=Alignment(status=AlignmentStatus.ALIGNED))
    assert _rank(gateway, scene, candidates=[{"id": "a", "pose": vehicle}]).json()["warnings"] == []


def test_poses_come_back_as_they_were_asked(gateway: Any, georeferenced: str) -> None:
    geodetic = {
        **ORIGIN,
        "altitude_m": 410.1,
        "altitude_datum": "sea-level",
        "yaw_deg": 190.5,
        "pitch_deg": -61.0,
        "roll_deg": 0.0,
    }
    asked = {"geodetic": geodetic, "world": LOOK, "model": {**LOOK, "frame": "model"}}
    candidates = [{"id": name, "pose": pose} for name, pose in asked.items()]
    ranking = _rank(gateway, georeferenced, candidates=candidates).json()
    assert {place["id"]: place["pose"] for place in ranking["candidates"]} == asked
    assert ranking["origin"] == {**ORIGIN, "altitude_datum": "sea-level"}


def test_poses_of_generators_are_geodetic_in_a_georeferenced_scene(
    gateway: Any, scene: str, georeferenced: str
) -> None:
    def poses(scene: str, **request: Any) -> dict[str, Any]:
        ranking = _rank(gateway, scene, generator={"kind": "orbit", "count": 5}, **request).json()
        return {place["id"]: place["pose"] for place in ranking["candidates"]}

    geodetic, world, model = (
        poses(georeferenced, **more) for more in ({}, {"frame": "world"}, {"frame": "model"})
    )
    for name, pose in geodetic.items():
        assert abs(pose["latitude_deg"] - 48.0) < 0.01
        assert pose["pitch_deg"] < 0
        assert world[name]["position"] == pytest.approx(
            [2 * x + shift for x, shift in zip(model[name]["position"], (5, 0, 0), strict=True)]
        )
        again = _rank(gateway, georeferenced, candidates=[{"id": name, "pose": pose}], frame="world").json()[
            "candidates"
        ][0]["pose"]
        assert again["position"] == pytest.approx(world[name]["position"], abs=1e-5)
        np.testing.assert_allclose(
            np.abs(np.dot(again["orientation_wxyz"], world[name]["orientation_wxyz"])), 1.0, atol=1e-9
        )
    here = {"frame": "world", **world["orbit-0000"]}
    assert set(poses(georeferenced, current_pose=here)["orbit-0001"]) == set(here)
    assert poses(scene)["orbit-0000"]["frame"] == "world"


def test_a_scene_without_a_place_on_earth_has_no_geodetic_poses(gateway: Any, scene: str) -> None:
    gateway.runners.asked.clear()
    answer = _rank(gateway, scene, frame="geodetic")
    assert (answer.status_code, gateway.runners.asked) == (422, [])
    assert "georeferenced" in answer.json()["detail"]


def test_poses_beyond_the_atmosphere_have_no_geodetic_pose(gateway: Any, georeferenced: str) -> None:
    generator = {"kind": "orbit", "count": 2, "height_m": 1e6}
    assert _rank(gateway, georeferenced, generator=generator).status_code == 422
    assert _rank(gateway, georeferenced, generator=generator, frame="world").status_code == 201


def test_renders_are_those_of_the_pose_in_any_frame(gateway: Any, georeferenced: str) -> None:
    def render(**request: Any) -> bytes:
        generator = {"kind": "orbit", "count": 5}
        ranking = _rank(gateway, georeferenced, generator=generator, **request).json()
        return gateway.client.get(f"/v1/rankings/{ranking['id']}/candidates/orbit-0001/render.png").content

    assert render()[:8] == render(frame="model")[:8] == b"\x89PNG\r\n\x1a\n"
