import io
import math
import shutil
from typing import Any

import numpy as np
import pytest
from fvs_service.rankings.warnings import warnings_of
from PIL import Image

from fvs_schema.scenes import Alignment, AlignmentStatus

LOOK = {"frame": "world", "position": [0.0, 0.0, -4.0], "orientation_wxyz": [1.0, 0.0, 0.0, 0.0]}
AWAY = {"frame": "world", "position": [0.0, 0.0, -4.0], "orientation_wxyz": [0.0, 1.0, 0.0, 0.0]}


def _rank(gateway: Any, scene: str, **request: Any) -> Any:
    return gateway.client.post(f"/v1/scenes/{scene}/rankings", json=request)


@pytest.fixture(scope="module")
def scene(gateway: Any) -> str:
    scene = gateway.scene()
    gateway.model(scene)
    return scene


def test_candidates_are_ranked_by_the_engine(gateway: Any, scene: str) -> None:
    candidates = [
        {"id": "near", "pose": {**LOOK, "position": [0.0, 0.0, -2.5]}},
        {"id": "far", "pose": LOOK},
        {"id": "away", "pose": AWAY},
    ]
    answer = _rank(gateway, scene, candidates=candidates)
    assert answer.status_code == 201, answer.text
    ranking = answer.json()
    assert answer.headers["location"] == f"/v1/rankings/{ranking['id']}"
    assert ranking["request"]["candidates"] == candidates
    by_id = {place["id"]: place for place in ranking["candidates"]}
    assert by_id["away"]["status"] == "out-of-model"
    assert by_id["away"]["rank"] is None
    ranked = [place for place in ranking["candidates"] if place["status"] == "ranked"]
    assert [place["rank"] for place in ranked] == list(range(1, len(ranked) + 1))
    scores = [place["score"] for place in ranked]
    assert scores == sorted(scores)
    assert gateway.client.get(answer.headers["location"]).json() == ranking


def test_rankings_are_listed_without_their_candidates(gateway: Any) -> None:
    scene = gateway.scene()
    gateway.model(scene)
    path = f"/v1/scenes/{scene}/rankings"
    made = [gateway.client.post(path, json={"generator": {"kind": "orbit", "count": n}}) for n in (3, 4, 5)]
    page = gateway.client.get(path, params={"limit": 2}).json()
    rest = gateway.client.get(path, params={"after": page["next"]}).json()
    assert rest["next"] is None
    for item, answer in zip((*page["items"], *rest["items"]), reversed(made), strict=True):
        ranking = answer.json()
        best = next((one["id"] for one in ranking["candidates"] if one["rank"] == 1), None)
        assert item == {
            **{name: ranking[name] for name in ("id", "scene_id", "snapshot_id", "total", "created_at")},
            **{"method": "median-frequency", "generator": "orbit", "best": best},
        }


def test_a_replayed_ranking_gives_the_same(gateway: Any, scene: str) -> None:
    first = _rank(gateway, scene, generator={"kind": "orbit", "count": 7}).json()
    replay = gateway.client.post(
        f"/v1/scenes/{scene}/rankings",
        json={**first["request"], "snapshot_id": first["snapshot_id"]},
    ).json()
    assert replay["candidates"] == first["candidates"]
    assert replay["id"] != first["id"]


def test_what_is_out_of_range_or_visited_is_not_rendered(gateway: Any, scene: str) -> None:
    here = gateway.application.rankings._frames.cameras(
        gateway.client.get(f"/v1/scenes/{scene}").json()["snapshot_id"]
    ).views[0]
    visited = {"position": list(here.position), "orientation_wxyz": list(here.orientation_wxyz)}
    candidates = [
        {"id": "visited", "pose": visited},
        {"id": "beyond", "pose": {**LOOK, "position": [0.0, 0.0, -40.0]}},
        {"id": "good", "pose": LOOK},
    ]
    gateway.runners.asked.clear()
    ranking = _rank(gateway, scene, candidates=candidates, current_pose=LOOK, radius_m=10.0).json()
    assert [view.name for view in gateway.runners.asked[0].views] == ["good"]
    status = {place["id"]: (place["status"], place["distance_m"]) for place in ranking["candidates"]}
    assert status["beyond"] == ("out-of-range", 36.0)
    assert status["visited"][0] == "visited"
    assert status["good"][1] == 0.0
    assert ranking["candidates"][0]["id"] == "good"


def test_when_nothing_is_in_range_nobody_is_asked(gateway: Any, scene: str) -> None:
    far = {"id": "beyond", "pose": {**LOOK, "position": [0.0, 0.0, -40.0]}}
    gateway.runners.asked.clear()
    answer = _rank(gateway, scene, candidates=[far], current_pose=LOOK, radius_m=1.0)
    assert answer.status_code == 201
    assert gateway.runners.asked == []


@pytest.mark.parametrize(
    ("generator", "count"),
    [
        ({"kind": "orbit", "count": 5, "radius_m": 3.0, "height_m": 1.0}, 5),
        ({"kind": "grid", "columns": 3, "rows": 2}, 6),
        ({"kind": "grid", "columns": 2, "rows": 2, "look": "down"}, 4),
        ({"kind": "dataset"}, 6),
        ({"kind": "around-current", "count": 9}, 9),
    ],
)
def test_generators_make_candidates(gateway: Any, scene: str, generator: dict[str, Any], count: int) -> None:
    request = {"generator": generator, "current_pose": LOOK, "radius_m": 100.0}
    if generator["kind"] == "around-current":
        request["radius_m"] = 2.0
    ranking = _rank(gateway, scene, **request).json()
    assert ranking["total"] == count
    for place in ranking["candidates"]:
        assert math.isclose(np.linalg.norm(place["pose"]["orientation_wxyz"]), 1.0, abs_tol=1e-6)
        assert place["distance_m"] <= request["radius_m"] + 1e-9
    assert _rank(gateway, scene, **request, top_k=2).json()["candidates"] == ranking["candidates"][:2]


def test_an_orbit_has_the_requested_radius_and_height(gateway: Any, scene: str) -> None:
    generator = {"kind": "orbit", "count": 5, "radius_m": 3.0, "height_m": 1.0}
    ranking = _rank(gateway, scene, generator=generator, current_pose=LOOK, radius_m=100.0).json()
    assert len(ranking["candidates"]) == 5
    for candidate in ranking["candidates"]:
        x, y, z = candidate["pose"]["position"]
        assert (math.hypot(x, y), z) == (pytest.approx(3.0), pytest.approx(1.0))


def test_the_world_is_where_the_alignment_says(gateway: Any) -> None:
    """The same cameras, given in a world that is scaled, rotated and translated, get the same score."""
    plain, moved = gateway.scene(), gateway.scene(world={"kind": "local"})
    gateway.model(plain)
    half = math.sqrt(0.5)
    alignment = Alignment(
        status=AlignmentStatus.ALIGNED,
        scale=2.0,
        rotation_wxyz=(half, 0.0, 0.0, half),
        translation=(100.0, 0.0, 0.0),
        rms_m=0.1,
        inliers=6,
        positions=6,
    )
    gateway.model(moved, alignment=alignment)
    looked = _rank(gateway, plain, candidates=[{"id": "a", "pose": LOOK}]).json()["candidates"][0]
    pose = {"position": [100.0, 0.0, -8.0], "orientation_wxyz": [half, 0.0, 0.0, half]}
    found = _rank(gateway, moved, candidates=[{"id": "a", "pose": pose}]).json()["candidates"][0]
    assert found["score"] == pytest.approx(looked["score"], abs=1e-4)
    assert found["pose"]["position"] == pytest.approx(pose["position"])
    in_model = _rank(
        gateway, moved, candidates=[{"id": "a", "pose": {**LOOK, "frame": "model"}}], frame="world"
    ).json()
    assert in_model["candidates"][0]["pose"]["position"] == pytest.approx(pose["position"])


def test_candidates_are_rendered(gateway: Any, scene: str) -> None:
    ranking = _rank(gateway, scene, candidates=[{"id": "a", "pose": LOOK}]).json()
    path = f"/v1/rankings/{ranking['id']}/candidates/a/render.png"
    drawn = gateway.client.get(path)
    assert drawn.headers["content-type"] == "image/png"
    image = np.asarray(Image.open(io.BytesIO(drawn.content)))
    assert image.shape == (24, 32, 3)
    assert image.max() > 50
    gateway.runners.reachable = False
    try:
        assert gateway.client.get(path).content == drawn.content
    finally:
        gateway.runners.reachable = True
    assert gateway.client.get(path.replace("/a/", "/b/")).status_code == 404
    assert gateway.client.get(path.replace("render", "photograph")).status_code == 422


def test_without_a_model_nothing_is_ranked(gateway: Any) -> None:
    answer = _rank(gateway, gateway.scene(), generator={"kind": "orbit"})
    assert answer.status_code == 409
    assert (answer.json()["code"], answer.json()["retryable"]) == ("no-snapshot", True)


def test_without_a_runner_the_answer_says_when_to_ask_again(gateway: Any, scene: str) -> None:
    gateway.runners.reachable = False
    try:
        answer = _rank(gateway, scene, generator={"kind": "orbit"})
    finally:
        gateway.runners.reachable = True
    assert (answer.status_code, answer.headers["retry-after"]) == (503, "3")
    assert answer.json()["retryable"] is True


def test_the_same_idempotency_key_ranks_once(gateway: Any, scene: str) -> None:
    path, headers = f"/v1/scenes/{scene}/rankings", {"Idempotency-Key": f"rank {scene}".replace(" ", "-")}
    body = {"generator": {"kind": "orbit", "count": 3}}
    first = gateway.client.post(path, json=body, headers=headers).json()
    assert gateway.client.post(path, json=body, headers=headers).json() == first


@pytest.mark.parametrize(
    ("request_body", "field"),
    [
        ({"candidates": [{"id": "a", "pose": LOOK}], "generator": {"kind": "orbit"}}, ""),
        ({"frame": "camera"}, "frame"),
        ({"candidates": []}, "candidates"),
        ({"candidates": [{"id": "../a", "pose": LOOK}]}, "candidates.0.id"),
        ({"candidates": [{"id": "a", "pose": LOOK}, {"id": "a", "pose": LOOK}]}, ""),
        ({"candidates": [{"id": "a", "pose": {**LOOK, "orientation_wxyz": [2, 0, 0, 0]}}]}, "orientation"),
        ({"candidates": [{"id": "a", "pose": {**LOOK, "position": [0, 0]}}]}, "candidates.0.pose"),
        ({"candidates": [{"id": "a", "pose": {**LOOK, "speed": 3}}]}, "speed"),
        ({"generator": {"kind": "orbit"}, "radius_m": 3}, ""),
        ({"generator": {"kind": "orbit"}, "radius_m": -3, "current_pose": LOOK}, "radius_m"),
        ({"generator": {"kind": "around-current"}, "current_pose": LOOK}, ""),
        ({"generator": {"kind": "orbit"}, "method": "guess"}, "method"),
        ({"generator": {"kind": "orbit", "count": 100_000}}, "generator.count"),
        ({"generator": {"kind": "orbit"}, "top_k": 0}, "top_k"),
    ],
)
def test_what_is_wrong_with_a_ranking_is_named(
    gateway: Any, scene: str, request_body: dict[str, Any], field: str
) -> None:
    answer = _rank(gateway, scene, **request_body)
    assert answer.status_code == 422, answer.text
    assert field in "".join(error["field"] for error in answer.json()["errors"])


@pytest.mark.parametrize("value", ["0", "-1", "nan", "inf", "soon"])
def test_a_timeout_without_sense_is_refused(gateway: Any, scene: str, value: str) -> None:
    path, headers = f"/v1/scenes/{scene}/rankings", {"X-Timeout-S": value}
    answer = gateway.client.post(path, json={"generator": {"kind": "orbit"}}, headers=headers)
    assert answer.status_code == 422, answer.text
    assert answer.json()["errors"][0]["field"].lower() == "x-timeout-s"


def test_without_candidates_an_orbit_is_ranked(gateway: Any, scene: str) -> None:
    ranking = _rank(gateway, scene, top_k=3).json()
    assert len(ranking["candidates"]) == 3
    assert ranking["total"] == 24
    assert ranking["request"]["generator"]["kind"] == "orbit"


def test_rankings_leave_half_of_the_reserve(open_gateway: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    gateway = open_gateway(reserve_bytes=1_000)
    if not gateway.settings.on_one_machine:
        pytest.skip("the database has another disk")
    scene = gateway.scene()
    gateway.model(scene)
    ranking = _rank(gateway, scene).json()
    candidate = f"/v1/rankings/{ranking['id']}/candidates/{ranking['candidates'][0]['id']}"
    usage = shutil.disk_usage(gateway.settings.root)
    monkeypatch.setattr(shutil, "disk_usage", lambda _path: usage._replace(free=499))
    # A candidate that is out of range costs no computation, but its ranking a row.
    far = _rank(gateway, scene, generator={"kind": "grid"}, current_pose=LOOK, radius_m=1e-6)
    for refused in (_rank(gateway, scene), far, gateway.client.get(f"{candidate}/render.png")):
        assert (refused.status_code, refused.json()["code"]) == (507, "out-of-space")
    monkeypatch.setattr(shutil, "disk_usage", lambda _path: usage._replace(free=501))
    assert _rank(gateway, scene).status_code == 201


def test_the_runner_is_told_where_the_vehicle_is_and_what_is_out_of_range(gateway: Any) -> None:
    scene = gateway.scene()
    gateway.model(scene, alignment=Alignment(status=AlignmentStatus.ALIGNED, scale=2.0, rms_m=0.1))
    orbit = {"kind": "orbit", "count": 24, "radius_m": 8.0, "height_m": 2.0}
    here = {**LOOK, "position": [4.0, 6.9, 2.0]}
    gateway.runners.asked.clear()
    ranking = _rank(gateway, scene, generator=orbit, current_pose=here, radius_m=5.0).json()
    (asked,) = gateway.runners.asked
    by_status = {
        status: {place["id"] for place in ranking["candidates"] if place["status"] == status}
        for status in ("out-of-range", "visited")
    }
    assert {view.name for view in asked.later} == by_status["out-of-range"]
    assert len(by_status["out-of-range"]) > 12
    assert asked.reach == pytest.approx(2.5)  # half of it in the model frame
    assert asked.here == pytest.approx([2.0, 3.45, 1.0])


@pytest.mark.parametrize(
    ("registrable", "candidates", "said"),
    [
        (None, 40, None),
        (3, 40, None),
        (2, 2, None),
        (2, 40, "Likely to be registered are only 2 of the 40 candidates"),
        (1, 40, "Likely to be registered are only 1 of the 40 candidates"),
        (0, 1, "Likely to be registered are only 0 of the 1 candidates"),
    ],
)
def test_a_warning_says_when_hardly_any_candidate_can_be_registered(
    registrable: int | None, candidates: int, said: str | None
) -> None:
    found = warnings_of(Alignment(), in_model=False, candidates=candidates, registrable=registrable)
    assert [warning.code for warning in found] == ([] if said is None else ["few-registrable"])
    assert all(warning.message.startswith(said or "") and "nearer" in warning.hint for warning in found)


@pytest.mark.parametrize(("positions", "in_model", "warned"), [(0, False, 0), (9, False, 1), (9, True, 0)])
def test_positions_that_align_nothing_are_warned_of_where_the_world_frame_is_asked_for(
    positions: int, in_model: bool, warned: int
) -> None:
    alignment = Alignment(positions=positions)
    found = warnings_of(alignment, in_model=in_model, candidates=9, registrable=9)
    assert [warning.code for warning in found] == ["positions-unused"] * warned


def test_a_ranking_has_the_warning(gateway: Any, scene: str, monkeypatch: pytest.MonkeyPatch) -> None:
    rank = gateway.runners._rank
    monkeypatch.setattr(
        gateway.runners, "_rank", lambda request: rank(request).model_copy(update={"registrable": 1})
    )
    ranking = _rank(gateway, scene, generator={"kind": "orbit", "count": 7}).json()
    assert [warning["code"] for warning in ranking["warnings"]] == ["few-registrable"]
