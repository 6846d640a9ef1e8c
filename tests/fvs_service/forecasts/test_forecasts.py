"""Forecasts over REST: at poses, over the ground and over the surface."""

from typing import Any

import numpy as np
import pytest

from fvs_schema.scenes import Alignment, AlignmentStatus

LOOK = {"frame": "world", "position": [0.0, 0.0, -4.0], "orientation_wxyz": [1.0, 0.0, 0.0, 0.0]}
ORIGIN = {"latitude_deg": 48.3, "longitude_deg": 7.25, "altitude_m": 412.0}
ALIGNED = Alignment(status=AlignmentStatus.ALIGNED, scale=2.0, translation=(10.0, 20.0, 5.0))


def _forecast(gateway: Any, scene: str, **request: Any) -> Any:
    return gateway.client.post(f"/v1/scenes/{scene}/forecasts", json=request)


def _at(x: float) -> dict[str, Any]:
    return {"id": f"x{x:g}", "pose": {**LOOK, "position": [x, 0.0, -4.0]}}


def _variances(answer: Any) -> list[float]:
    assert answer.status_code == 200, answer.text
    return [sample["variance"] for sample in answer.json()["samples"]]


@pytest.fixture(scope="module")
def scene(gateway: Any) -> str:
    scene: str = gateway.scene()
    gateway.model(scene)
    return scene


@pytest.fixture(scope="module")
def on_earth(gateway: Any) -> str:
    scene: str = gateway.scene(world={"kind": "enu", "origin": ORIGIN})
    gateway.model(scene, alignment=ALIGNED)
    return scene


def test_the_farther_a_pose_from_the_images_the_less_is_known(gateway: Any, scene: str) -> None:
    answer = _forecast(gateway, scene, candidates=[_at(0.0), _at(20.0), _at(200.0)])
    near, far, farther = _variances(answer)
    assert near < far < farther <= 1.0
    forecast = answer.json()
    assert [(one["id"], one["position"]) for one in forecast["samples"]] == [
        ("x0", None),
        ("x20", None),
        ("x200", None),
    ]
    assert forecast["samples"][1]["pose"] == _at(20.0)["pose"]
    assert forecast["calibrated"] is False
    assert {one["psnr_db"] for one in forecast["samples"]} == {None}


def test_a_pose_has_the_same_variance_whatever_else_is_asked(gateway: Any, scene: str) -> None:
    alone = _variances(_forecast(gateway, scene, candidates=[_at(3.0)]))
    assert _variances(_forecast(gateway, scene, candidates=[_at(3.0), _at(5_000.0)]))[:1] == alone


def test_views_that_count_as_photographed_lower_the_variance_near_them(gateway: Any, scene: str) -> None:
    asked = [_at(30.0), _at(900.0)]
    before = _variances(_forecast(gateway, scene, candidates=asked))
    after = _variances(_forecast(gateway, scene, candidates=asked, after=[_at(30.0), _at(31.0)]))
    assert after[0] < before[0] - 0.3
    assert after[1] == pytest.approx(before[1], abs=1e-3)


def test_an_orbit_by_default_and_candidates_of_a_volume(gateway: Any, scene: str) -> None:
    assert len(_variances(_forecast(gateway, scene))) == 24
    shell = {"kind": "shell", "centre": [0.0, 0.0, 0.0], "inner": 3.0, "outer": 5.0}
    answer = _forecast(gateway, scene, generator={"kind": "in-volume", "volume": shell, "count": 7})
    assert len(_variances(answer)) == 7


def test_the_ground_beyond_the_model_is_known_least(gateway: Any, on_earth: str) -> None:
    grid = {"kind": "grid", "columns": 9, "rows": 9, "look": "down", "margin_m": 60.0}
    answer = _forecast(gateway, on_earth, generator=grid)
    found = np.reshape(_variances(answer), (9, 9))
    assert found[4, 4] < min(found[0, 0], found[0, 8], found[8, 0], found[8, 8])
    first, last = (answer.json()["samples"][number]["pose"] for number in (0, -1))
    assert first["pitch_deg"] == pytest.approx(-90.0)
    assert last["latitude_deg"] - first["latitude_deg"] > 100.0 / 111_000
    assert answer.json()["origin"]["latitude_deg"] == ORIGIN["latitude_deg"]


def test_the_surface_has_positions_in_the_frame_of_the_answer(gateway: Any, on_earth: str) -> None:
    asked = {"surface": {"count": 5}}
    places = {}
    for frame in (None, "world", "model"):
        answer = _forecast(gateway, on_earth, **asked, **({"frame": frame} if frame else {}))
        samples = answer.json()["samples"]
        assert 0 < len(samples) <= 5
        assert samples[0]["id"] == "surface-00000"
        assert {one["pose"] for one in samples} == {None}
        places[frame] = [one["position"] for one in samples]
    assert {one["frame"] for one in places["model"]} == {"model"}
    in_world = [np.array(one["position"]) * 2.0 + (10.0, 20.0, 5.0) for one in places["model"]]
    np.testing.assert_allclose([one["position"] for one in places["world"]], in_world)
    heights = [one["altitude_m"] - ORIGIN["altitude_m"] for one in places[None]]
    np.testing.assert_allclose(heights, [z for _, _, z in in_world], atol=1e-3)


def test_forecasts_have_a_psnr_once_three_updates_have_measured_theirs(gateway: Any) -> None:
    scene = gateway.scene()
    for images, psnr_db in ((3, None), (5, 20.0), (7, 22.0)):
        gateway.model(scene, images=images, new_images_psnr_db=psnr_db)
    assert _forecast(gateway, scene).json()["calibrated"] is False
    gateway.model(scene, images=9, new_images_psnr_db=23.0)
    forecast = _forecast(gateway, scene, candidates=[_at(0.0), _at(50.0)]).json()
    assert forecast["calibrated"] is True
    near, far = forecast["samples"]
    assert near["low_db"] < near["psnr_db"] < near["high_db"]
    assert near["psnr_db"] > far["psnr_db"]


def test_what_cannot_be_forecast_is_refused(gateway: Any, scene: str) -> None:
    assert _forecast(gateway, gateway.scene()).json()["code"] == "no-snapshot"
    for wrong in (
        {"surface": {"count": 0}},
        {"surface": {"count": 20_001}},
        {"surface": {}, "generator": {"kind": "orbit"}},
        {"surface": {}, "candidates": [_at(0.0)]},
        {"candidates": [_at(0.0)], "generator": {"kind": "orbit"}},
        {"candidates": [_at(0.0), _at(0.0)]},
        {"generator": {"kind": "around-current"}},
        {"generator": {"kind": "grid", "margin_m": -1.0}},
        {"generator": {"kind": "grid", "columns": 100, "rows": 100}},
        {"frame": "geodetic"},
        {"after": [{"id": "far", "pose": {**LOOK, "frame": "model", "position": [1e7, 0.0, 0.0]}}] * 2_001},
    ):
        answer = _forecast(gateway, scene, **wrong)
        assert (answer.status_code, answer.json()["code"]) == (422, "invalid-request"), (wrong, answer.text)
        assert answer.json()["hint"]
