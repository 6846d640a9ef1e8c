"""Compression of JSON, for links that carry little."""

import json
from typing import Any

import pytest


@pytest.fixture
def many_scenes(gateway: Any) -> Any:
    for number in range(12):
        gateway.client.post("/v1/scenes", json={"name": f"scene {number}"})
    return gateway


def raw(gateway: Any, path: str, accepted: str | None) -> tuple[Any, bytes]:
    """The response with its body as it came."""
    headers = {} if accepted is None else {"Accept-Encoding": accepted}
    with gateway.client.stream("GET", path, headers=headers) as response:
        return response, b"".join(response.iter_raw())


def test_a_long_answer_is_compressed_for_those_who_accept_it(many_scenes: Any) -> None:
    plain, content = raw(many_scenes, "/v1/scenes", "identity")
    assert "content-encoding" not in plain.headers
    response, compressed = raw(many_scenes, "/v1/scenes", "br;q=1, gzip;q=0.5")
    assert response.headers["content-encoding"] == "gzip"
    assert int(response.headers["content-length"]) == len(compressed) < 0.5 * len(content)
    assert response.headers["vary"] == "Accept-Encoding"
    assert many_scenes.client.get("/v1/scenes").json() == json.loads(content)


@pytest.mark.parametrize("accepted", ["identity", "gzip;q=0, identity", "gzip; q=0.0", "br, deflate", ""])
def test_others_get_it_as_it_is(many_scenes: Any, accepted: str) -> None:
    response, content = raw(many_scenes, "/v1/scenes", accepted)
    assert "content-encoding" not in response.headers
    assert len(json.loads(content)["items"]) >= 12


def test_short_answers_and_other_types_are_left_alone(gateway: Any) -> None:
    scene_id = gateway.client.post("/v1/scenes", json={"name": "yard"}).json()["id"]
    for path in ("/livez", "/metrics", f"/v1/scenes/{scene_id}"):
        response, _ = raw(gateway, path, "gzip")
        assert response.status_code == 200
        assert "content-encoding" not in response.headers


def test_files_with_a_tag_are_left_alone(gateway: Any) -> None:
    scene_id = gateway.client.post("/v1/scenes", json={"name": "yard"}).json()["id"]
    gateway.model(scene_id, images=30)
    snapshot = gateway.client.get(f"/v1/scenes/{scene_id}/snapshots").json()["items"][0]
    path = f"/v1/snapshots/{snapshot['id']}/artifacts/cameras.json"
    response, content = raw(gateway, path, "gzip")
    assert response.headers["content-type"].startswith("application/json")
    assert len(content) > 1_000
    assert "etag" in response.headers
    assert "content-encoding" not in response.headers


def test_a_large_answer_is_whole(gateway: Any) -> None:
    scene_id = gateway.client.post("/v1/scenes", json={"name": "yard"}).json()["id"]
    gateway.model(scene_id)
    asked = {"generator": {"kind": "orbit", "count": 1_000}}
    ranking = gateway.client.post(f"/v1/scenes/{scene_id}/rankings", json=asked).json()
    path = f"/v1/rankings/{ranking['id']}"
    _, content = raw(gateway, path, "identity")
    assert len(content) > 100_000
    response, compressed = raw(gateway, path, "gzip")
    assert len(compressed) < 0.6 * len(content)
    assert gateway.client.get(path).content == content
    assert response.headers["content-encoding"] == "gzip"
