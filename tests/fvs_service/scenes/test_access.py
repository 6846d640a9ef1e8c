"""Who may do what: keys, scopes, tenants."""

from base64 import b64encode
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import timedelta
from typing import Any

import pytest
from fvs_service.principal import Scope

_PUBLIC = {"/livez", "/readyz"}
_POSE = {"position": [0.0, 0.0, -4.0], "orientation_wxyz": [1.0, 0.0, 0.0, 0.0]}
_BODIES: dict[str, Any] = {
    "change_scene": {"name": "another"},
    "change_snapshot": {"pinned": True},
    "create_scene": {"name": "a"},
    "check_images": {"digests": [f"sha256:{'0' * 64}"]},
    "create_job": {"kind": "update"},
    "create_mission": {"views": [{"id": "a", "pose": _POSE}]},
    "create_webhook": {"url": "https://hooks.example/", "events": ["job.failed"]},
    "plan_views": {"generator": {"kind": "orbit", "count": 3}},
    "rank_views": {"generator": {"kind": "orbit", "count": 3}},
    "report_visits": {
        **{"vehicle": "a", "state": "taken"},
        "views": [{"id": "b", "pose": {"position": [0, 0, 9], "orientation_wxyz": [1, 0, 0, 0]}}],
    },
}
_TUS = {"Tus-Resumable": "1.0.0", "Upload-Offset": "0", "Content-Type": "application/offset+octet-stream"}


@dataclass(frozen=True)
class Route:
    """One operation of the OpenAPI document, with the ids of somebody's resources filled in."""

    method: str
    template: str
    path: str
    operation: dict[str, Any]

    def call(self, gateway: Any, headers: dict[str, str], photograph: bytes) -> Any:
        name = next((key for key in _BODIES if self.operation["operationId"].startswith(key)), None)
        more: dict[str, Any] = {"json": _BODIES[name]} if name else {}
        if self.operation["operationId"].endswith("_mission"):
            more["params"] = {"format": "csv"}
        if self.method == "put":
            more = {"content": photograph}
        if self.operation["operationId"].startswith("upload_images"):
            more = {"files": {"file": ("a.jpg", photograph)}}
        if self.template.startswith("/v1/uploads"):
            headers = {**headers, **_TUS}
            more = {"content": photograph} if self.method == "patch" else {}
        return gateway.client.request(self.method, self.path, headers=headers, **more)


@pytest.fixture(scope="module")
def locked(tmp_path_factory: pytest.TempPathFactory, running: Any, settings_of: Any) -> Iterator[Any]:
    settings = settings_of(
        tmp_path_factory.mktemp("locked"), {"require_keys": True, "webhook_hosts": ("hooks.example",)}
    )
    with running(settings) as gateway:
        yield gateway


@pytest.fixture(scope="module")
def owned(locked: Any, photograph: Any) -> dict[str, str]:
    """Resources of one tenant, one of each kind."""
    owner = locked.key("owner")
    scene = locked.scene(owner)
    image = locked.put(scene, photograph(3), owner).json()
    snapshot = locked.model(scene, owner)
    ranking = locked.client.post(
        f"/v1/scenes/{scene}/rankings", json={"generator": {"kind": "orbit", "count": 3}}, headers=owner
    ).json()
    return {
        "scene_id": scene,
        "hexadecimal": image["digest"].removeprefix("sha256:"),
        "job_id": locked.client.get(f"/v1/snapshots/{snapshot}", headers=owner).json()["job_id"],
        "snapshot_id": snapshot,
        "name": "cameras.json",
        "ranking_id": ranking["id"],
        "plan_id": locked.client.post(
            f"/v1/scenes/{scene}/plans", json={"generator": {"kind": "orbit", "count": 9}}, headers=owner
        ).json()["id"],
        "webhook_id": locked.client.post(
            f"/v1/scenes/{scene}/webhooks", json=_BODIES["create_webhook"], headers=owner
        ).json()["id"],
        "candidate_id": ranking["candidates"][0]["id"],
        "image": "render",
        "upload_id": _upload(locked, scene, owner),
    }


def _upload(gateway: Any, scene: str, headers: dict[str, str]) -> str:
    """A new upload's id."""
    given = {"scene": scene, "sha256": "0" * 64}
    metadata = ",".join(f"{name} {b64encode(value.encode()).decode()}" for name, value in given.items())
    new = {**_TUS, **headers, "Upload-Length": "9", "Upload-Metadata": metadata}
    made = gateway.client.post("/v1/uploads", headers=new)
    assert made.status_code == 201, made.text
    return made.headers["location"].rpartition("/")[2]


@pytest.fixture(scope="module")
def routes(locked: Any, owned: dict[str, str]) -> list[Route]:
    document = locked.client.get("/openapi.json").json()
    return [
        Route(method, template, template.format(**owned), operation)
        for template, operations in document["paths"].items()
        for method, operation in operations.items()
    ]


def test_there_are_routes_of_every_kind(routes: list[Route], owned: dict[str, str]) -> None:
    assert len(routes) >= 24
    for name in owned:
        assert any(f"{{{name}}}" in route.template for route in routes), name


def test_nobody_gets_anything_without_a_key(locked: Any, routes: list[Route], photograph: Any) -> None:
    for route in routes:
        if route.template in _PUBLIC:
            continue
        answer = route.call(locked, {}, photograph(3))
        assert answer.status_code == 401, route
        assert answer.headers["www-authenticate"] == "Bearer"


def test_another_tenants_ids_answer_like_unknown_ones(
    locked: Any, routes: list[Route], owned: dict[str, str], photograph: Any
) -> None:
    stranger = locked.key("stranger")
    tried = 0
    for route in routes:
        if "{" not in route.template:
            continue
        foreign = route.call(locked, stranger, photograph(3))
        unknown = Route(
            route.method,
            route.template,
            route.template.format(**{**owned, **_UNKNOWN}),
            route.operation,
        ).call(locked, stranger, photograph(3))
        assert foreign.status_code == unknown.status_code == 404, route
        if route.method == "head":
            continue
        mine, theirs = foreign.json(), unknown.json()
        mine.pop("request_id")
        theirs.pop("request_id")
        assert mine == theirs, route
        tried += 1
    assert tried >= 18
    assert locked.client.get("/v1/scenes", headers=stranger).json()["items"] == []


_UNKNOWN = {
    "scene_id": "scn_00000000000000000000000000",
    "job_id": "job_00000000000000000000000000",
    "snapshot_id": "snp_00000000000000000000000000",
    "ranking_id": "rnk_00000000000000000000000000",
    "plan_id": "pln_00000000000000000000000000",
    "webhook_id": "whk_00000000000000000000000000",
    "upload_id": f"upl_{'0' * 32}",
}


def test_a_device_key_reaches_only_its_scene(locked: Any, owned: dict[str, str], photograph: Any) -> None:
    owner = locked.key("owner")
    other = locked.scene(owner)
    device = locked.key("owner", scopes=frozenset({Scope.UPLOAD}), scene_id=owned["scene_id"])
    assert locked.put(owned["scene_id"], photograph(4), device).status_code == 201
    assert locked.put(other, photograph(4), device).status_code == 404
    assert locked.client.get(f"/v1/scenes/{owned['scene_id']}", headers=device).status_code == 403
    assert locked.client.post("/v1/scenes", json={"name": "a"}, headers=device).status_code == 403


def test_a_key_of_one_scene_lists_that_scene(locked: Any, owned: dict[str, str]) -> None:
    other = locked.scene(locked.key("owner"))
    bound = locked.key("owner", scopes=frozenset({Scope.READ}), scene_id=owned["scene_id"])
    listed = locked.client.get("/v1/scenes", headers=bound).json()["items"]
    assert [scene["id"] for scene in listed] == [owned["scene_id"]] != [other]
    device = locked.key("owner", scopes=frozenset({Scope.UPLOAD}), scene_id=owned["scene_id"])
    refused = locked.client.get(f"/v1/scenes/{owned['scene_id']}", headers=device).json()
    assert refused["detail"] == "This needs a key with the scope 'read'."


def test_scopes_limit_what_a_key_does(locked: Any, owned: dict[str, str], photograph: Any) -> None:
    reader = locked.key("owner", scopes=frozenset({Scope.READ}))
    scene = f"/v1/scenes/{owned['scene_id']}"
    assert locked.client.get(scene, headers=reader).status_code == 200
    refused = [
        locked.client.post("/v1/scenes", json={"name": "a"}, headers=reader),
        locked.client.post(f"{scene}/jobs", json={"kind": "update"}, headers=reader),
        locked.client.post(f"/v1/jobs/{owned['job_id']}:cancel", headers=reader),
        locked.client.post(f"{scene}/rankings", json=_BODIES["rank_views"], headers=reader),
        locked.put(owned["scene_id"], photograph(5), reader),
    ]
    assert [answer.status_code for answer in refused] == [403] * len(refused)


def test_keys_expire_and_are_revoked(locked: Any) -> None:
    keys = locked.application.storage.keys
    expired = locked.key("owner", valid_for=timedelta(seconds=-1))
    assert locked.client.get("/v1/scenes", headers=expired).status_code == 401
    good = locked.key("owner")
    assert locked.client.get("/v1/scenes", headers=good).status_code == 200
    keys.revoke(good["Authorization"].split("_")[1])
    assert locked.client.get("/v1/scenes", headers=good).status_code == 401


def test_a_stream_ends_when_its_key_is_revoked(locked: Any) -> None:
    key, other = locked.key("owner"), locked.key("owner")
    scene = locked.scene(other)
    with locked.client.stream("GET", f"/v1/scenes/{scene}/events", headers=key) as stream:
        lines = stream.iter_lines()
        assert "event: scene.created" in lines
        locked.application.storage.keys.revoke(key["Authorization"].split("_")[1])
        locked.queue(scene, headers=other)
        assert not any(line.startswith("event:") for line in lines)


def test_credentials_of_another_kind_are_refused_even_where_none_are_needed(gateway: Any) -> None:
    assert gateway.client.get("/v1/scenes").status_code == 200
    for authorization in ("Basic dTpw", "Bearer", "Bearer fvs_x_y", "fvs_x_y"):
        answer = gateway.client.get("/v1/scenes", headers={"Authorization": authorization})
        assert answer.status_code == 401, authorization


@pytest.mark.parametrize("key", ["", "x", "fvs_", "fvs_unknown_secret", "fvs__", "a" * 5000])
def test_keys_that_are_none_are_refused(locked: Any, key: str) -> None:
    answer = locked.client.get("/v1/scenes", headers={"Authorization": f"Bearer {key}"})
    assert answer.status_code == 401
    assert answer.json()["code"] == "unauthenticated"


def test_the_secret_of_a_key_is_not_stored(locked: Any) -> None:
    secret = locked.key("owner")["Authorization"].split("_", 2)[2]
    files = [file for file in locked.settings.root.glob("fvs.sqlite3*") if file.is_file()]
    assert "fvs.sqlite3" in {file.name for file in files}
    assert any(b"owner" in file.read_bytes() for file in files), "the key's record is in one of them"
    for file in files:
        assert secret.encode() not in file.read_bytes()


def test_a_known_key_id_with_another_secret_is_refused(locked: Any) -> None:
    good = locked.key("owner")["Authorization"]
    answer = locked.client.get("/v1/scenes", headers={"Authorization": good[:-1] + "?"})
    assert answer.status_code == 401
