"""Rankings of candidates in a volume: clear of matter and of zones, in the world frame."""

import math
from typing import Any

import numpy as np
import pytest

from fvs_engine.geometry import matrix_from_quaternion
from fvs_engine.score.feasibility import matter_of
from fvs_schema.scenes import Alignment, AlignmentStatus

LOOK = {"frame": "world", "position": [0.0, 0.0, -4.0], "orientation_wxyz": [1.0, 0.0, 0.0, 0.0]}


def _rank(gateway: Any, scene: str, **request: Any) -> Any:
    return gateway.client.post(f"/v1/scenes/{scene}/rankings", json=request)


@pytest.fixture(scope="module")
def scene(gateway: Any) -> str:
    scene = gateway.scene()
    gateway.model(scene)
    return scene


SHELL = {"kind": "shell", "centre": [0.0, 0.0, 0.0], "inner": 3.0, "outer": 5.0}


def _in(volume: dict[str, Any], **more: Any) -> dict[str, Any]:
    return {"kind": "in-volume", "volume": volume, **more}


def test_candidates_of_a_volume_are_ranked(gateway: Any, scene: str) -> None:
    gateway.runners.generated.clear()
    answer = _rank(gateway, scene, generator=_in(SHELL, count=40))
    assert answer.status_code == 201, answer.text
    ranking = answer.json()
    assert ranking["total"] == len(ranking["candidates"]) == 40
    assert len(gateway.runners.generated) == 1
    for place in ranking["candidates"]:
        position = np.array(place["pose"]["position"])
        assert place["id"].startswith("shell-")
        assert 3.0 <= np.linalg.norm(position) <= 5.0
        viewing = matrix_from_quaternion(np.array(place["pose"]["orientation_wxyz"]))[:, 2]
        assert viewing @ -position > 0.9 * np.linalg.norm(position)
    ranks = [place["rank"] for place in ranking["candidates"] if place["rank"] is not None]
    assert ranks == list(range(1, len(ranks) + 1))
    assert len(ranks) > 0
    assert gateway.client.get(answer.headers["location"]).json() == ranking
    picture = f"/v1/rankings/{ranking['id']}/candidates/{ranking['candidates'][0]['id']}/render.png"
    assert gateway.client.get(picture).status_code == 200
    planned = gateway.client.post(f"/v1/scenes/{scene}/plans", json={"generator": _in(SHELL, count=40)})
    assert {term["id"] for term in planned.json()["candidates"]} == {p["id"] for p in ranking["candidates"]}


def _positions(ranking: dict[str, Any]) -> Any:
    return np.array([place["pose"]["position"] for place in ranking["candidates"]])


def _free(gateway: Any, scene: str, positions: Any) -> Any:
    """Distance of each position to the model's matter, in a scene whose world frame is the model frame."""
    snapshot = gateway.client.get(f"/v1/scenes/{scene}").json()["snapshot_id"]
    matter = matter_of(gateway.runners._gaussians(scene, snapshot))
    apart = np.linalg.norm(positions[:, None] - matter.centres[None], axis=-1)
    return (apart - matter.radii).min(axis=1)


def test_candidates_of_a_volume_are_clear_of_matter_and_of_zones(gateway: Any, scene: str) -> None:
    """In a ball around the model, with a share of it inside matter."""
    ball = {**SHELL, "inner": 0.0, "outer": 3.0}
    outside = _positions(_rank(gateway, scene, generator=_in(ball, count=300)).json())
    assert (_free(gateway, scene, outside) > 0.0).all()
    assert _free(gateway, scene, outside).min() < 0.5
    clear = _positions(_rank(gateway, scene, generator=_in(ball, count=300), safety_m=0.5).json())
    assert (_free(gateway, scene, clear) > 0.5).all()
    zone = {"kind": "box", "centre": [5.0, 0.0, 0.0], "size": [10.0, 100.0, 100.0]}
    half = _positions(_rank(gateway, scene, generator=_in(ball, count=300), no_fly=[zone]).json())
    assert (half[:, 0] < 0.0).all()
    assert (outside[:, 0] > 0.0).any()


def test_fewer_candidates_than_requested_are_a_warning(gateway: Any, scene: str) -> None:
    ball = {**SHELL, "inner": 0.0, "outer": 3.0}
    zone = {"kind": "box", "centre": [-2.5, 0.0, 0.0], "size": [10.0, 100.0, 100.0]}  # free: 2.5 < x < 3
    asked = {"generator": _in(ball, count=300), "no_fly": [zone]}
    ranking = _rank(gateway, scene, **asked).json()
    (warning,) = (one for one in ranking["warnings"] if one["code"] == "fewer-candidates")
    assert 0 < ranking["total"] < 300
    assert warning["message"] == f"The volume has room for {ranking['total']} of the 300 candidates."
    vehicle = {"position": [2.9, 0.0, 0.0], "orientation_wxyz": [1.0, 0.0, 0.0, 0.0]}
    plan = gateway.client.post(f"/v1/scenes/{scene}/plans", json={**asked, "vehicles": [vehicle]}).json()
    assert "fewer-candidates" in [one["code"] for one in plan["warnings"]]
    enough = _rank(gateway, scene, generator=_in(ball, count=30)).json()
    assert "fewer-candidates" not in [one["code"] for one in enough["warnings"]]


def test_of_a_volume_what_is_beyond_the_radius_is_not_scored(gateway: Any, scene: str) -> None:
    gateway.runners.asked.clear()
    asked = {"generator": _in(SHELL, count=60), "current_pose": LOOK, "radius_m": 4.0}
    ranking = _rank(gateway, scene, **asked).json()
    status = {place["id"]: place["status"] for place in ranking["candidates"]}
    near = {place["id"] for place in ranking["candidates"] if place["distance_m"] <= 4.0}
    assert {name for name, found in status.items() if found == "out-of-range"} == status.keys() - near
    (question,) = gateway.runners.asked
    assert {view.name for view in question.views} == near
    assert 0 < len(near) < 60
    far = _rank(gateway, scene, generator=_in(SHELL, count=9), current_pose=LOOK, radius_m=0.01)
    assert {place["status"] for place in far.json()["candidates"]} == {"out-of-range"}


def test_what_was_generated_counts_against_the_time(gateway: Any, scene: str) -> None:
    gateway.runners.asked.clear()
    headers = {"X-Timeout-S": "30"}
    path = f"/v1/scenes/{scene}/rankings"
    answer = gateway.client.post(path, json={"generator": _in(SHELL, count=5)}, headers=headers)
    assert answer.status_code == 201
    assert gateway.runners.asked[0].timeout_s < gateway.runners.generated[-1].timeout_s <= 30.0


def test_volumes_of_rankings_are_of_the_world(gateway: Any) -> None:
    scene = gateway.scene(world={"kind": "local"})
    turned = Alignment(
        status=AlignmentStatus.ALIGNED,
        scale=10.0,
        rotation_wxyz=(math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0),
        translation=(100.0, 0.0, 50.0),
    )
    gateway.model(scene, alignment=turned)
    box = {"kind": "box", "centre": [100.0, 0.0, 90.0], "size": [40.0, 40.0, 10.0]}
    asked = {"generator": _in(box, count=30), "safety_m": 5.0, "frame": "world"}
    ranking = _rank(gateway, scene, **asked).json()
    assert (np.abs(_positions(ranking) - [100.0, 0.0, 90.0]) <= [20.0, 20.0, 5.0]).all()
    assert gateway.runners.generated[-1].clearance.safety == pytest.approx(0.5)


def test_a_view_that_another_vehicle_flies_to_is_taken_also_in_a_volume(gateway: Any) -> None:
    scene = gateway.scene()
    gateway.model(scene)
    asked = {"generator": _in(SHELL, count=20)}
    first = _rank(gateway, scene, **asked).json()["candidates"][0]
    report = {"vehicle": "one", "state": "going-to", "views": [{"id": first["id"], "pose": first["pose"]}]}
    assert gateway.client.post(f"/v1/scenes/{scene}/visits", json=report).status_code == 200
    status = {p["id"]: p["status"] for p in _rank(gateway, scene, **asked).json()["candidates"]}
    assert status[first["id"]] == "taken"


@pytest.mark.parametrize(
    ("request_", "words"),
    [
        (
            {"generator": _in({**SHELL, "inner": 0.0, "outer": 0.1})},
            "inside a solid part of the model, or within the safety",
        ),
        ({"generator": _in(SHELL), "safety_m": 1e3}, "shorter safety distance"),
        (
            {"generator": _in(SHELL), "no_fly": [{**SHELL, "inner": 0.0, "outer": 9.0}]},
            "zones cover the whole",
        ),
        ({"generator": _in({"kind": "pyramid"})}, "'box', 'cylinder', 'prism', 'shell', 'corridor'"),
        ({"generator": _in(SHELL, count=2_001)}, "at most 2000"),
        ({"generator": _in(SHELL, look="nearest", aim=[0, 0, 0])}, "not both"),
        ({"generator": _in(SHELL), "no_fly": [SHELL] * 21}, "20 are allowed"),
        ({"generator": _in(SHELL), "safety_m": -1.0}, "at least 0"),
    ],
)
def test_volumes_that_cannot_be_ranked_say_what_to_change(
    gateway: Any, scene: str, request_: dict[str, Any], words: str
) -> None:
    answer = _rank(gateway, scene, **request_)
    assert answer.status_code == 422, answer.text
    assert words in answer.text
    assert answer.json()["hint"]
