"""Plans over REST: flights through candidates, and what cannot be flown."""

from typing import Any

import numpy as np
import pytest

from fvs_engine.geometry import matrix_from_quaternion
from fvs_schema.scenes import Alignment, AlignmentStatus

LOOK = {"frame": "world", "position": [0.0, 0.0, -4.0], "orientation_wxyz": [1.0, 0.0, 0.0, 0.0]}


def _plan(gateway: Any, scene: str, **request: Any) -> Any:
    return gateway.client.post(f"/v1/scenes/{scene}/plans", json=request)


def _at(x: float, y: float = 0.0, z: float = -4.0) -> dict[str, Any]:
    return {**LOOK, "position": [x, y, z]}


def _row(count: int) -> list[dict[str, Any]]:
    return [{"id": f"c{number}", "pose": _at(0.5 + number)} for number in range(count)]


@pytest.fixture(scope="module")
def scene(gateway: Any) -> str:
    scene = gateway.scene()
    gateway.model(scene)
    return scene


def test_a_flight_through_an_orbit(gateway: Any, scene: str) -> None:
    answer = _plan(gateway, scene, generator={"kind": "orbit", "count": 12}, views=4)
    assert answer.status_code == 201, answer.text
    plan = answer.json()
    (tour,) = plan["tours"]
    assert len(tour["stops"]) == 4
    assert plan["summary"].startswith("4 more photographs, ")
    assert tour["length_m"] == pytest.approx(sum(stop["distance_m"] for stop in tour["stops"]))
    variances = [plan["now"]["variance"], *(stop["after"]["variance"] for stop in tour["stops"])]
    assert variances == sorted(variances, reverse=True)
    assert plan["end"] == tour["stops"][-1]["after"]
    planned = {term["id"] for term in plan["candidates"] if term["planned"]}
    assert planned == {stop["id"] for stop in tour["stops"]}
    assert [term["planned"] for term in plan["candidates"]][:5] == [True] * 4 + [False]
    places = [stop["pose"]["position"] for stop in tour["stops"]]
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert steps.tolist() == pytest.approx([stop["distance_m"] for stop in tour["stops"][1:]])


def test_a_plan_is_kept_with_its_inputs(gateway: Any, scene: str) -> None:
    answer = _plan(gateway, scene, views=2)
    plan = answer.json()
    assert answer.headers["location"] == f"/v1/plans/{plan['id']}"
    assert gateway.client.get(answer.headers["location"]).json() == plan
    assert plan["request"]["generator"]["kind"] == "orbit"
    again = _plan(gateway, scene, **{**plan["request"], "snapshot_id": plan["snapshot_id"]}).json()
    same = ("tours", "candidates", "now", "end", "summary")
    assert {name: again[name] for name in same} == {name: plan[name] for name in same}
    listed = gateway.client.get(f"/v1/scenes/{scene}/plans").json()["items"]
    assert [item["id"] for item in listed][:2] == [again["id"], plan["id"]]
    assert listed[1] == {name: plan[name] for name in listed[1]}
    assert gateway.client.delete(f"/v1/plans/{plan['id']}").status_code == 204
    assert gateway.client.get(f"/v1/plans/{plan['id']}").status_code == 404


def test_a_plan_without_anything_is_an_orbit_from_the_last_image(gateway: Any, scene: str) -> None:
    plan = _plan(gateway, scene).json()
    assert len(plan["tours"][0]["stops"]) == 10
    assert plan["tours"][0]["stops"][0]["id"].startswith("orbit-")
    assert plan["now"]["psnr_db"] is None  # no update has measured anything


def test_vehicles_distance_and_home(gateway: Any, scene: str) -> None:
    candidates = _row(8)
    request = {"candidates": candidates, "views": 8, "vehicles": [_at(0.0), _at(9.0)]}
    both = _plan(gateway, scene, **request).json()["tours"]
    assert [tour["vehicle"] for tour in both] == [1, 2]
    assert {stop["id"] for tour in both for stop in tour["stops"]} == {item["id"] for item in candidates}
    assert both[0]["stops"][0]["id"] == "c0"
    assert both[1]["stops"][0]["id"] == "c7"
    near = _plan(gateway, scene, **request, distance_m=4.0, home=True).json()["tours"]
    assert all(0 < tour["length_m"] <= 4.0 * 1.001 for tour in near)


def test_targets_say_what_the_model_is_for(gateway: Any, scene: str) -> None:
    targets = [{"id": "door", "pose": _at(6.4)}, {"id": "gate", "pose": _at(6.6)}]
    plan = _plan(gateway, scene, candidates=_row(8), views=1, targets=targets, vehicles=[_at(0.0)]).json()
    assert plan["tours"][0]["stops"][0]["id"] == "c6"
    assert set(plan["candidates"][0]["helps"]) == {"door", "gate"}


def test_candidates_that_were_photographed_are_left_out(gateway: Any, scene: str) -> None:
    here = gateway.client.get(f"/v1/scenes/{scene}").json()["snapshot_id"]
    view = gateway.application.plans._frames.cameras(here).views[0]
    taken = {
        "id": "taken",
        "pose": {
            "frame": "model",
            "position": list(view.position),
            "orientation_wxyz": list(view.orientation_wxyz),
        },
    }
    plan = _plan(gateway, scene, candidates=[taken, *_row(2)], views=3).json()
    assert plan["photographed"] == ["taken"]
    assert {term["id"] for term in plan["candidates"]} == {"c0", "c1"}
    nothing = _plan(gateway, scene, candidates=[taken])
    assert nothing.status_code == 422
    assert "photographed already" in nothing.json()["detail"]


def test_updates_that_measured_their_new_images_make_a_forecast(gateway: Any) -> None:
    scene = gateway.scene()
    for images, psnr_db in ((6, None), (8, 18.0), (9, 19.0), (11, 20.0)):
        gateway.model(scene, images=images, new_images_psnr_db=psnr_db)
    plan = _plan(gateway, scene, views=3).json()
    assert plan["now"]["low_db"] < plan["now"]["psnr_db"] < plan["now"]["high_db"]
    assert plan["end"]["psnr_db"] > plan["now"]["psnr_db"]
    assert " dB instead of " in plan["summary"]


SHELL = {"kind": "shell", "centre": [0.0, 0.0, 0.0], "inner": 3.0, "outer": 5.0}
FENCE = {"kind": "box", "centre": [0.0, 0.0, 0.0], "size": [0.2, 100.0, 100.0]}


def _in(volume: dict[str, Any], **more: Any) -> dict[str, Any]:
    return {"kind": "in-volume", "volume": volume, **more}


def _position(stop: dict[str, Any]) -> Any:
    return np.array(stop["pose"]["position"])


def _viewing(stop: dict[str, Any]) -> Any:
    return matrix_from_quaternion(np.array(stop["pose"]["orientation_wxyz"]))[:, 2]


def test_candidates_come_from_a_volume(gateway: Any, scene: str) -> None:
    answer = _plan(gateway, scene, generator=_in(SHELL, count=40), views=4, vehicles=[_at(0.0)], home=True)
    assert answer.status_code == 201, answer.text
    plan = answer.json()
    (tour,) = plan["tours"]
    assert len(tour["stops"]) == 4
    for stop in tour["stops"]:
        assert stop["id"].startswith("shell-")
        assert 3.0 <= np.linalg.norm(_position(stop)) <= 5.0
        assert _viewing(stop) @ -_position(stop) > 0.9 * np.linalg.norm(_position(stop))
    assert len(plan["candidates"]) == 40
    known = {term["id"] for term in plan["candidates"]}
    assert all(
        name in known or name.startswith("sha256:") for term in plan["candidates"] for name in term["helps"]
    )


def test_candidates_of_a_volume_look_where_they_are_told(gateway: Any, scene: str) -> None:
    box = {"kind": "box", "centre": [4.0, 0.0, 1.0], "size": [1.0, 4.0, 1.0]}
    beside = np.array([0.0, 3.0, 0.0])
    aimed = _plan(gateway, scene, generator=_in(box, aim=beside.tolist()), views=3).json()
    for stop in aimed["tours"][0]["stops"]:
        across = beside - _position(stop)
        assert _viewing(stop) @ across == pytest.approx(np.linalg.norm(across))
    level = _plan(gateway, scene, generator=_in(box, look="nearest", level=True), views=3).json()
    assert [_viewing(stop)[2] for stop in level["tours"][0]["stops"]] == pytest.approx([0.0] * 3, abs=1e-9)


def test_legs_go_around_matter_and_name_the_way(gateway: Any, scene: str) -> None:
    opposite = [
        {"id": "there", "pose": _at(6.0, 0.0, 0.0)},
        {"id": "beside", "pose": _at(0.0, 6.0, 0.0)},
    ]
    asked = {"candidates": opposite, "views": 2, "vehicles": [_at(-6.0, 0.0, 0.0)]}
    targets = [{"id": "door", "pose": _at(6.1, 0.0, 0.0)}]
    straight = _plan(gateway, scene, **{**asked, "views": 1}, targets=targets).json()["tours"][0]
    assert [stop["id"] for stop in straight["stops"]] == ["there"]
    assert straight["length_m"] == pytest.approx(12.0)
    assert straight["stops"][0]["via"] == [] == straight["via_home"]
    around = _plan(gateway, scene, **{**asked, "views": 1}, targets=targets, safety_m=0.3, home=True)
    (tour,) = around.json()["tours"]
    (stop,) = tour["stops"]
    (passed,) = stop["via"]
    assert passed["position"] == pytest.approx([0.0, 6.0, 0.0])
    assert passed["orientation_wxyz"] == pytest.approx(stop["pose"]["orientation_wxyz"])
    assert stop["distance_m"] == pytest.approx(2 * 6.0 * np.sqrt(2))
    assert tour["via_home"] == [passed]
    assert tour["length_m"] == pytest.approx(2 * stop["distance_m"])


def test_what_is_behind_a_fence_is_not_planned(gateway: Any, scene: str) -> None:
    rows = [
        {"id": f"{side}{y}", "pose": _at(x, y, 6.0)}
        for side, x in (("w", -3.0), ("e", 3.0))
        for y in range(3)
    ]
    plan = _plan(
        gateway, scene, candidates=rows, views=6, no_fly=[FENCE], vehicles=[_at(-3.0, 9.0, 6.0)]
    ).json()
    assert {stop["id"] for stop in plan["tours"][0]["stops"]} == {"w0", "w1", "w2"}
    behind = [term for term in plan["candidates"] if term["id"].startswith("e")]
    assert len(behind) == 3
    assert all(term["distance_m"] is None for term in behind)
    warnings = {warning["code"]: warning["message"] for warning in plan["warnings"]}
    assert warnings["unreachable"].startswith("3 of the 6 candidates cannot be reached")
    assert warnings["nothing-in-view"] == "None of the planned views shows anything of the model."


def test_a_vehicle_that_cannot_fly_is_named_and_the_others_fly(gateway: Any, scene: str) -> None:
    zone = {"kind": "box", "centre": [0.0, 0.0, -6.0], "size": [0.2, 0.2, 0.2]}
    vehicles = [_at(0.0, 0.0, -6.0), _at(4.0, 0.0, -6.0)]
    rows = [{"id": f"c{y}", "pose": _at(3.0, y, -6.0)} for y in range(3)]
    asked = {"candidates": rows, "views": 3, "no_fly": [zone]}
    plan = _plan(gateway, scene, **asked, vehicles=vehicles).json()
    assert [len(tour["stops"]) for tour in plan["tours"]] == [0, 3]
    (warning,) = plan["warnings"]
    assert warning["code"] == "vehicle-blocked"
    assert warning["message"] == "Vehicle 1 of 2 gets no tour: its start is in a no-fly zone."
    assert (warning["numbers"], warning["texts"]) == ({"vehicle": 1, "of": 2}, {"status": "no-fly"})
    assert warning["hint"] == "Give it another start, or smaller zones."
    none = _plan(gateway, scene, **asked, vehicles=vehicles[:1])
    assert none.status_code == 422
    assert "The start of the vehicle is in a no-fly zone" in none.text


def test_one_photograph_is_planned_of_each_pose(gateway: Any, scene: str) -> None:
    copies = [{"id": f"c{number}", "pose": _at(0.5)} for number in range(3)]
    plan = _plan(gateway, scene, candidates=copies, views=3).json()
    assert len(plan["tours"][0]["stops"]) == 1
    assert [warning["code"] for warning in plan["warnings"]] == ["same-pose"]


def test_volumes_are_of_the_world(gateway: Any) -> None:
    turned = Alignment(
        status=AlignmentStatus.ALIGNED,
        scale=10.0,
        rotation_wxyz=(np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0),
        translation=(100.0, 0.0, 50.0),
    )
    scene = gateway.scene()
    gateway.model(scene, alignment=turned)
    prism = {
        **{"kind": "prism", "lower": 55.0, "upper": 60.0},
        "corners": [[70.0, -30.0, 0.0], [130.0, -30.0, 0.0], [130.0, 30.0, 0.0], [70.0, 30.0, 0.0]],
    }
    zone = {"kind": "cylinder", "base": [100.0, 0.0, 0.0], "radius": 20.0, "height": 100.0}
    asked = {
        "generator": _in(prism, count=50),
        "safety_m": 1.0,
        "no_fly": [zone],
        "views": 5,
        "frame": "world",
    }
    plan = _plan(gateway, scene, **asked, vehicles=[_at(60.0, 0.0, 57.0)]).json()
    for stop in plan["tours"][0]["stops"]:
        x, y, z = _position(stop)
        assert 70.0 <= x <= 130.0
        assert -30.0 <= y <= 30.0
        assert 55.0 <= z <= 60.0
        assert np.hypot(x - 100.0, y) > 20.0


def test_a_distance_that_is_too_short_is_answered_in_metres(gateway: Any) -> None:
    scene = gateway.scene()
    gateway.model(scene, alignment=Alignment(status=AlignmentStatus.ALIGNED, scale=10.0))
    asked = {"candidates": [{"id": "c", "pose": _at(25.0)}], "vehicles": [_at(0.0)], "frame": "world"}
    short = _plan(gateway, scene, **asked, distance_m=2.0).json()
    assert "A distance of 2 does not reach any candidate: the nearest is 25 away" in short["detail"]
    assert short["hint"].startswith("Give at least 25 ")
    assert _plan(gateway, scene, **asked, distance_m=25.0).json()["tours"][0]["length_m"] == pytest.approx(25)


SQUARE = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]


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
        ({"generator": _in({**SHELL, "centre": [1e6, 0, 0]}, level=True, aim=[2e6, 0, 0])}, "in its frame"),
        ({"generator": _in({"kind": "pyramid"})}, "'box', 'cylinder', 'prism', 'shell', 'corridor'"),
        ({"generator": _in({**SHELL, "radius": 1.0})}, "generator.volume.radius"),
        ({"generator": _in({**SHELL, "outer": 2.0})}, "needs a thickness"),
        ({"generator": _in(SHELL, count=2_001)}, "must be at most 2000"),
        ({"generator": _in(SHELL, look="nearest", aim=[0, 0, 0])}, "not both"),
        (
            {"generator": _in({"kind": "prism", "corners": SQUARE * 51, "lower": 0, "upper": 1})},
            "at most 200",
        ),
        (
            {"generator": _in({"kind": "prism", "corners": SQUARE * 2, "lower": 0, "upper": 1})},
            "crosses itself",
        ),
        ({"no_fly": [FENCE] * 21}, "20 are allowed"),
        ({"no_fly": FENCE}, "`no_fly` must be a list"),
        ({"safety_m": -1.0}, "`safety_m` must be at least 0"),
        ({"candidates": _row(2), "no_fly": [FENCE], "vehicles": [_at(-2.0)]}, "Something is in the way"),
    ],
)
def test_volumes_that_cannot_be_used_say_what_to_change(
    gateway: Any, scene: str, request_: dict[str, Any], words: str
) -> None:
    answer = _plan(gateway, scene, **request_)
    assert answer.status_code == 422, answer.text
    assert words in answer.text
    assert answer.json()["hint"]


@pytest.mark.parametrize(
    ("request_", "words"),
    [
        ({"candidates": _row(3), "distance_m": 0.01, "vehicles": [_at(0.0)]}, "nearest is 0.5 away"),
        ({"candidates": [_row(1)[0], _row(1)[0]]}, "two candidates have the id c0"),
        ({"candidates": []}, "`candidates` must not be empty"),
        ({"candidates": _row(1), "generator": {"kind": "orbit"}}, "not both"),
        ({"views": 0}, "`views` must be at least 1"),
        ({"views": 10_000}, "`views` must be at most 100"),
        ({"vehicles": []}, "`vehicles` must not be empty"),
        ({"vehicles": [_at(0.0)] * 21}, "20 are allowed"),
        ({"distance_m": -1.0}, "`distance_m` must be at least"),
        ({"generator": {"kind": "around-current"}}, "kind must be one of 'orbit'"),
        ({"candidates": [{"id": "far", "pose": _at(1e12)}]}, "2"),
        ({"snapshot_id": "snp_none"}, ""),
    ],
)
def test_what_cannot_be_planned_is_refused(
    gateway: Any, scene: str, request_: dict[str, Any], words: str
) -> None:
    answer = _plan(gateway, scene, **request_)
    assert answer.status_code in (404, 422), answer.text
    problem = answer.json()
    assert words in answer.text
    assert problem["code"]


@pytest.mark.system
def test_two_thousand_candidates_are_planned(gateway: Any, scene: str) -> None:
    draw = np.random.default_rng(0)
    many = [
        {"id": f"m{number}", "pose": _at(*draw.uniform(-5.0, 5.0, 3).tolist())} for number in range(2_000)
    ]
    plan = _plan(gateway, scene, candidates=many, views=20).json()
    assert len(plan["tours"][0]["stops"]) == 20
    assert len(plan["candidates"]) == 200
    assert [term["coverage"] is None for term in plan["candidates"]] == [False] * 100 + [True] * 100
    refused = _plan(gateway, scene, candidates=[*many, {"id": "one more", "pose": LOOK}])
    assert refused.status_code == 422


def test_a_scene_without_a_model_and_without_a_runner(gateway: Any, scene: str) -> None:
    empty = gateway.scene()
    assert _plan(gateway, empty).json()["code"] == "no-snapshot"
    gateway.runners.reachable = False
    try:
        away = _plan(gateway, scene)
        assert away.status_code == 503
        assert away.headers["retry-after"] == "3"
    finally:
        gateway.runners.reachable = True
