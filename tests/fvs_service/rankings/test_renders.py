"""Renders of a snapshot at any pose."""

import io
from typing import Any

import numpy as np
import pytest
from fvs_service.principal import Scope
from PIL import Image

from fvs_schema.scenes import Alignment, AlignmentStatus

LOOK = {"frame": "world", "position": [0.0, 0.0, -4.0], "orientation_wxyz": [1.0, 0.0, 0.0, 0.0]}
ALIGNED = Alignment(status=AlignmentStatus.ALIGNED, scale=2.0, rms_m=0.1)


@pytest.fixture(scope="module")
def snapshot(gateway: Any) -> str:
    return str(gateway.model(gateway.scene(), alignment=ALIGNED))


def _answer(gateway: Any, snapshot: str, **request: Any) -> Any:
    return gateway.client.post(f"/v1/snapshots/{snapshot}/renders", json={"pose": LOOK, **request})


def _pixels(answer: Any) -> Any:
    assert answer.status_code == 200, answer.text
    return np.asarray(Image.open(io.BytesIO(answer.content)))


def test_a_pose_is_rendered_as_a_candidate_there_is(gateway: Any) -> None:
    scene = gateway.scene()
    snapshot = gateway.model(scene, alignment=ALIGNED)
    asked = {"candidates": [{"id": "there", "pose": LOOK}], "rank_all": True}
    ranking = gateway.client.post(f"/v1/scenes/{scene}/rankings", json=asked).json()
    for image in ("render", "spectrum"):
        candidate = gateway.client.get(f"/v1/rankings/{ranking['id']}/candidates/there/{image}.png")
        rendered = _answer(gateway, snapshot, image=image)
        assert rendered.headers["content-type"] == "image/png"
        assert _pixels(rendered).std() > 1
        assert rendered.content == candidate.content
    assert not [*gateway.settings.root.rglob(f"*{snapshot}*.png")]


def test_world_and_model_name_the_same_view(gateway: Any, snapshot: str) -> None:
    there = {**LOOK, "frame": "model", "position": [0.0, 0.0, -2.0]}
    assert _answer(gateway, snapshot, pose=there).content == _answer(gateway, snapshot).content
    elsewhere = _answer(gateway, snapshot, pose={**LOOK, "frame": "model"})
    assert elsewhere.content != _answer(gateway, snapshot).content


@pytest.mark.parametrize("long_side_px", [64, 321])
def test_the_camera_is_scaled_to_the_wanted_size(gateway: Any, snapshot: str, long_side_px: int) -> None:
    usual = _pixels(_answer(gateway, snapshot))
    height, width = usual.shape[:2]
    answer = _answer(gateway, snapshot, long_side_px=long_side_px, format="jpeg")
    assert answer.headers["content-type"] == "image/jpeg"
    scaled = Image.open(io.BytesIO(answer.content))
    assert scaled.format == "JPEG"
    factor = long_side_px / max(width, height)
    assert scaled.size == (round(width * factor), round(height * factor))
    same = np.asarray(scaled.resize((width, height)), dtype=float)
    assert np.abs(same - usual).mean() < 0.5 * usual.astype(float).std()


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"pose": None}, "pose"),
        ({"pose": {**LOOK, "orientation_wxyz": [0.0, 0.0, 0.0, 0.0]}}, "pose"),
        ({"long_side_px": 63}, "long_side_px"),
        ({"long_side_px": 4097}, "long_side_px"),
        ({"format": "gif"}, "format"),
        ({"image": "depth"}, "image"),
    ],
)
def test_wrong_requests_are_refused(gateway: Any, snapshot: str, change: Any, field: str) -> None:
    answer = _answer(gateway, snapshot, **change)
    assert (answer.status_code, answer.json()["code"]) == (422, "invalid-request")
    assert any(error["field"].startswith(field) for error in answer.json()["errors"])


def test_a_geodetic_pose_needs_a_place_on_earth(gateway: Any, snapshot: str) -> None:
    place = {"latitude_deg": 46.0, "longitude_deg": 7.0, "altitude_m": 900.0}
    pose = {**place, "yaw_deg": 0.0, "pitch_deg": -30.0}
    answer = _answer(gateway, snapshot, pose=pose)
    assert answer.status_code == 422, answer.text


def test_a_deleted_snapshot_is_not_found(gateway: Any) -> None:
    scene = gateway.scene()
    first = gateway.model(scene, seed=1)
    gateway.model(scene, seed=2)
    assert _answer(gateway, first).status_code == 200
    assert gateway.client.delete(f"/v1/snapshots/{first}").status_code == 204
    for gone in (first, "snp_none"):
        answer = _answer(gateway, gone)
        assert (answer.status_code, answer.json()["code"]) == (404, "not-found")


def test_a_key_that_may_read_renders(open_gateway: Any) -> None:
    gateway = open_gateway(require_keys=True)
    scene = gateway.scene(headers=(owner := gateway.key("renders")))
    snapshot = gateway.model(scene, headers=owner)
    path, asked = f"/v1/snapshots/{snapshot}/renders", {"pose": LOOK}
    statuses = [
        gateway.client.post(
            path, json=asked, headers=gateway.key(tenant, scopes=frozenset({scope}))
        ).status_code
        for tenant, scope in (("renders", Scope.READ), ("renders", Scope.UPLOAD), ("another", Scope.READ))
    ]
    assert statuses == [200, 403, 404]
