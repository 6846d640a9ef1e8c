from collections.abc import Callable
from typing import Any

import pytest


def test_a_scene_is_made_and_shown(gateway: Any) -> None:
    made = gateway.client.post("/v1/scenes", json={"name": "quarry", "policy": {"trigger": "each-image"}})
    assert made.status_code == 201
    scene = made.json()
    assert made.headers["location"] == f"/v1/scenes/{scene['id']}"
    assert scene["name"] == "quarry"
    assert scene["world"] == {"kind": "automatic"}
    assert set(scene["image_counts"].values()) == {0}
    assert set(scene["image_counts"]) == {
        "received",
        "accepted",
        "rejected",
        "pending",
        "excluded",
        "quarantined",
    }
    assert scene["snapshot_id"] is None
    assert gateway.client.get(made.headers["location"]).json() == scene


def test_the_same_idempotency_key_makes_one_scene(open_gateway: Callable[..., Any]) -> None:
    gateway = open_gateway()
    headers = {"Idempotency-Key": "a-1"}
    first = gateway.client.post("/v1/scenes", json={"name": "quarry"}, headers=headers)
    second = gateway.client.post("/v1/scenes", json={"name": "quarry"}, headers=headers)
    assert first.json() == second.json()
    other = gateway.client.post("/v1/scenes", json={"name": "castle"}, headers=headers)
    assert other.status_code == 422
    assert other.json()["code"] == "idempotency-key-reused"
    assert len(gateway.client.get("/v1/scenes").json()["items"]) == 1


def test_lists_continue_where_the_page_ended(open_gateway: Callable[..., Any]) -> None:
    gateway = open_gateway()
    made = [gateway.scene() for _ in range(5)]
    seen: list[str] = []
    after: dict[str, str] = {}
    while True:
        page = gateway.client.get("/v1/scenes", params={"limit": 2, **after}).json()
        seen += [scene["id"] for scene in page["items"]]
        if page["next"] is None:
            break
        after = {"after": page["next"]}
    assert seen == made[::-1]


def test_a_page_follows_the_last_one_whatever_happens_meanwhile(gateway: Any) -> None:
    made = [gateway.scene(name="followed") for _ in range(4)]
    named = {"name": "followed", "limit": 2}
    first = gateway.client.get("/v1/scenes", params=named).json()
    assert [scene["id"] for scene in first["items"]] == [made[3], made[2]]
    gateway.client.delete(f"/v1/scenes/{made[2]}")
    gateway.scene(name="followed")
    second = gateway.client.get("/v1/scenes", params={**named, "after": first["next"]}).json()
    assert [scene["id"] for scene in second["items"]] == [made[1], made[0]]
    assert second["next"] is None


def test_scenes_are_found_by_name(gateway: Any) -> None:
    twins = [gateway.scene(name="twins' yard") for _ in range(2)]
    gateway.scene(name="twins' yard, again")
    found = gateway.client.get("/v1/scenes", params={"name": "twins' yard"}).json()
    assert [scene["id"] for scene in found["items"]] == twins[::-1]
    assert gateway.client.get("/v1/scenes", params={"name": "nobody's yard"}).json()["items"] == []
    assert gateway.client.get("/v1/scenes", params={"name": ""}).status_code == 422


def test_scenes_are_found_by_a_part_of_their_name(gateway: Any) -> None:
    names = ("Zürich 100%", "STRASSE_7", "Ωmega site", "Cafe\u0301")
    made = {name: gateway.scene(name=name) for name in names}

    def found(text: str) -> set[str]:
        answer = gateway.client.get("/v1/scenes", params={"search": text})
        return {one["name"] for one in answer.json()["items"]}

    for text, name in (
        *(("züRI", "Zürich 100%"), ("0%", "Zürich 100%"), ("straße_", "STRASSE_7"), ("ΩME", "Ωmega site")),
        ("CAFÉ", "Cafe\u0301"),
    ):
        assert found(text) == {name}
    for text in ("z_rich", "Z%h", "\\", "*"):
        assert found(text) == set()
    gateway.client.patch(f"/v1/scenes/{made['STRASSE_7']}", json={"name": "Gasse 7"})
    assert found("strasse") == set()
    assert found("GASSE") == {"Gasse 7"}
    assert gateway.client.get("/v1/scenes", params={"search": ""}).status_code == 422
    both = {"search": "gasse", "name": "Zürich 100%"}
    assert gateway.client.get("/v1/scenes", params=both).json()["items"] == []


def test_the_list_says_what_is_done_with_a_scene(gateway: Any, photograph: Callable[..., bytes]) -> None:
    scene, idle = gateway.scene(name="busy yard"), gateway.scene(name="idle yard")

    def listed(scene_id: str) -> dict[str, Any]:
        items = gateway.client.get("/v1/scenes", params={"search": "yard"}).json()["items"]
        (one,) = (item for item in items if item["id"] == scene_id)
        assert one == gateway.client.get(f"/v1/scenes/{scene_id}").json()
        return one

    assert listed(idle)["job"] is listed(idle)["snapshot_created_at"] is None
    snapshot = gateway.model(scene)
    made = gateway.client.get(f"/v1/snapshots/{snapshot}").json()
    assert (listed(scene)["snapshot_id"], listed(scene)["snapshot_created_at"]) == (
        snapshot,
        made["created_at"],
    )
    assert listed(scene)["job"] is None
    fine = gateway.queue(scene, "fine")
    assert listed(scene)["job"] == {"id": fine, "kind": "fine", "state": "queued"}
    update = gateway.queue(scene)
    assert listed(scene)["job"]["id"] == fine  # it has waited longest
    lease = gateway.lease(scene)
    gateway.application.storage.ledger.start(lease, update, 1)
    gateway.application.storage.leases.release(lease)
    assert listed(scene)["job"] == {"id": update, "kind": "update", "state": "running"}
    assert listed(idle)["job"] is None
    tag = listed(scene)["etag"]
    gateway.client.post(f"/v1/jobs/{fine}:cancel")
    assert listed(scene)["etag"] == tag
    gateway.put(idle, photograph())
    assert listed(idle)["image_counts"]["received"] == 1
    assert listed(scene)["image_counts"]["received"] == 0


def test_a_cursor_of_another_list_is_refused(gateway: Any, photograph: Callable[..., bytes]) -> None:
    scene, other = gateway.scene(), gateway.scene()
    for seed in range(2):
        gateway.put(scene, photograph(seed))
        gateway.model(scene)

    def page(path: str, **params: Any) -> Any:
        return gateway.client.get(path, params=params)

    lists = {
        name: page(f"/v1/scenes/{scene}/{name}", limit=1).json()["next"]
        for name in ("images", "jobs", "snapshots")
    }
    lists["scenes"] = page("/v1/scenes", limit=1).json()["next"]
    for name, cursor in lists.items():
        path = "/v1/scenes" if name == "scenes" else f"/v1/scenes/{scene}/{name}"
        assert len(page(path, limit=1, after=cursor).json()["items"]) == 1
        others = {one: wrong for one, wrong in lists.items() if one != name}.values()
        for wrong in ("zzz", "", "ä", "A" * 22, cursor[:-1], f"{cursor}A", *others):
            answer = page(path, after=wrong)
            assert answer.status_code == 422, (name, wrong)
            assert answer.json()["errors"] == [
                {"field": "after", "message": "it is not a cursor of this list"}
            ]
            assert "`next`" in answer.json()["hint"]
        if name != "scenes":
            assert page(f"/v1/scenes/{other}/{name}", after=cursor).status_code == 422
    assert page("/v1/scenes", after=lists["scenes"], name="another").status_code == 422
    jobs = f"/v1/scenes/{scene}/jobs"
    assert page(jobs, after=lists["jobs"], state="failed").status_code == 422


def test_no_more_scenes_than_allowed(open_gateway: Callable[..., Any]) -> None:
    gateway = open_gateway(limits={"scenes_per_tenant": 1})
    gateway.scene()
    refused = gateway.client.post("/v1/scenes", json={"name": "another"})
    assert refused.status_code == 429
    assert int(refused.headers["retry-after"]) > 0
    assert refused.json()["retryable"] is True


@pytest.mark.parametrize(
    ("body", "field"),
    [
        ('{"name": "a", "colour": "red"}', "colour"),
        ('{"name": ""}', "name"),
        ('{"name": 7}', "name"),
        ('{"name": "a\\u0000b"}', "name"),
        ('{"name": "a", "camera": {"focal_length_px": "9", "width_px": 640}}', "camera.focal_length_px"),
        ('{"name": "a", "world": {"kind": "enu"}}', "world.origin"),
        ('{"name": "a", "world": {"kind": "flat"}}', "world"),
    ],
)
def test_what_is_wrong_with_a_scene_is_named(gateway: Any, body: str, field: str) -> None:
    answer = gateway.client.post("/v1/scenes", content=body, headers={"Content-Type": "application/json"})
    assert answer.status_code == 422
    assert answer.headers["content-type"] == "application/problem+json"
    problem = answer.json()
    assert problem["code"] == "invalid-request"
    assert [error["field"] for error in problem["errors"]] == [field]


@pytest.mark.parametrize("number", ["NaN", "Infinity", "1e400"])
def test_numbers_that_json_does_not_have_are_located(gateway: Any, number: str) -> None:
    body = f'{{"name": "a", "camera": {{"focal_length_px": {number}, "width_px": 640}}}}'
    answer = gateway.client.post("/v1/scenes", content=body, headers={"Content-Type": "application/json"})
    assert answer.status_code == 400
    assert answer.json()["code"] == "malformed-request"
    assert f"at character {body.index(number)}" in answer.json()["detail"]
