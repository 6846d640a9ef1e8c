"""Conditional requests, and HEAD."""

from typing import Any

import pytest


def test_a_scene_is_sent_only_to_who_does_not_have_it(gateway: Any) -> None:
    made = gateway.client.post("/v1/scenes", json={"name": "a"})
    path, tag = made.headers["location"], made.headers["etag"]
    assert tag == f'"{made.json()["etag"]}"'
    for same in (tag, f"W/{tag}", f'"other", {tag}', "*"):
        answer = gateway.client.get(path, headers={"If-None-Match": same})
        assert (answer.status_code, answer.content, answer.headers["etag"]) == (304, b"", tag)
    for other in ('"other"', tag.strip('"'), "nonsense"):
        answer = gateway.client.get(path, headers={"If-None-Match": other})
        assert (answer.status_code, answer.headers["etag"]) == (200, tag)


def test_every_change_of_a_scene_changes_its_tag(gateway: Any, photograph: Any) -> None:
    scene = gateway.scene()
    tags = []

    def seen() -> None:
        tags.append(gateway.client.get(f"/v1/scenes/{scene}").headers["etag"])

    seen()
    renamed = gateway.client.patch(f"/v1/scenes/{scene}", json={"name": "b"})
    seen()
    assert renamed.headers["etag"] == tags[-1]
    gateway.put(scene, photograph())
    seen()
    gateway.model(scene)
    seen()
    assert len(set(tags)) == len(tags)
    seen()
    assert tags[-1] == tags[-2]


@pytest.mark.parametrize("method", ["PATCH", "DELETE"])
def test_a_scene_that_has_changed_is_left_as_it_is(gateway: Any, method: str) -> None:
    scene = gateway.scene(name="a")
    path = f"/v1/scenes/{scene}"
    old = gateway.client.get(path).headers["etag"]
    new = gateway.client.patch(path, json={"name": "b"}).headers["etag"]
    body = {"json": {"name": "c"}} if method == "PATCH" else {}
    for lost in (old, f"W/{new}", '"other"'):
        refused = gateway.client.request(method, path, headers={"If-Match": lost}, **body)
        assert refused.status_code == 412
        assert refused.json()["code"] == "precondition-failed"
        assert refused.json()["hint"]
    malformed = gateway.client.request(method, path, headers={"If-Match": new.strip('"')}, **body)
    assert malformed.status_code == 422
    assert malformed.json()["errors"][0]["field"] == "If-Match"
    assert gateway.client.get(path).json()["name"] == "b"
    done = gateway.client.request(method, path, headers={"If-Match": f"{old}, {new}"}, **body)
    assert done.is_success


def test_head_is_get_without_the_body(gateway: Any, photograph: Any) -> None:
    scene = gateway.scene()
    snapshot = gateway.model(scene)
    image = gateway.put(scene, photograph()).json()["digest"]
    ranking = gateway.client.post(f"/v1/scenes/{scene}/rankings", json={}).json()
    plan = gateway.client.post(f"/v1/scenes/{scene}/plans", json={}).json()["id"]
    job = gateway.client.get(f"/v1/scenes/{scene}/jobs").json()["items"][0]["id"]
    webhook, upload = "whk_none", "upl_none"
    known = {
        "scene_id": scene,
        "snapshot_id": snapshot,
        "hexadecimal": image.removeprefix("sha256:"),
        "ranking_id": ranking["id"],
        "candidate_id": ranking["candidates"][0]["id"],
        "image": "render",
        "name": "cameras.json",
        "plan_id": plan,
        "job_id": job,
        "webhook_id": webhook,
        "upload_id": upload,
    }
    paths = gateway.client.get("/openapi.json").json()["paths"]
    got = [path.format(**known) for path, operations in paths.items() if "get" in operations]
    for path in (*got, "/", "/docs", "/openapi.json", "/v1/scenes?limit=0"):
        if path.endswith("/events"):
            continue
        get, head = gateway.client.get(path), gateway.client.head(path)
        assert (head.status_code, head.content) == (get.status_code, b""), path
        for name in ("content-type", "etag", "location"):
            assert head.headers.get(name) == get.headers.get(name), path
        if path != "/metrics" and get.is_success:
            assert head.headers["content-length"] == get.headers["content-length"], path


def test_head_of_a_stream_ends(serve: Any) -> None:
    gateway = serve()
    scene = gateway.scene()
    for _ in range(3):
        answer = gateway.client.head(f"/v1/scenes/{scene}/events")
        assert answer.status_code == 200
        assert answer.headers["content-type"].startswith("text/event-stream")
    assert gateway.client.get(f"/v1/scenes/{scene}").status_code == 200
    assert gateway.client.head("/v1/scenes/scn_none/events").status_code == 404
