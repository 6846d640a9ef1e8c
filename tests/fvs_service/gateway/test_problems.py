from typing import Any

import pytest
from fvs_service import errors

_FIELDS = {"type", "title", "status", "code", "detail", "hint", "retryable", "request_id", "errors"}


def _subclasses(kind: type[errors.ServiceError]) -> list[type[errors.ServiceError]]:
    return [kind, *[deeper for child in kind.__subclasses__() for deeper in _subclasses(child)]]


def test_every_error_has_a_code_of_its_own() -> None:
    subclasses = _subclasses(errors.ServiceError)
    kinds = [kind for kind in subclasses if kind.code != getattr(kind.__base__, "code", "internal")]
    codes = [kind.code for kind in kinds]
    assert len(set(codes)) == len(codes)
    for kind in kinds:
        assert 400 <= kind.status < 600
        assert kind.title


def test_every_error_has_a_hint() -> None:
    for kind in _subclasses(errors.ServiceError)[1:]:
        assert kind.usual_hint, kind


@pytest.mark.parametrize(
    ("method", "path", "options", "status", "code"),
    [
        ("GET", "/nothing", {}, 404, "not-found"),
        ("GET", "/v1/scenes/", {}, 404, "not-found"),
        ("GET", "/v1/scenes/scn_none", {}, 404, "not-found"),
        ("DELETE", "/v1/scenes", {}, 405, "method-not-allowed"),
        ("POST", "/v1/scenes", {"content": b"{"}, 400, "malformed-request"),
        ("POST", "/v1/scenes", {"content": b"\xff\xfe{}"}, 400, "malformed-request"),
        ("POST", "/v1/scenes", {"data": {"name": "a"}}, 415, "unsupported-media-type"),
        ("POST", "/v1/scenes", {"content": b"", "headers": {}}, 422, "invalid-request"),
        ("POST", "/v1/scenes", {"content": b"{}", "headers": {}}, 415, "unsupported-media-type"),
        ("GET", "/v1/scenes", {"params": {"limit": 0}}, 422, "invalid-request"),
        ("GET", "/v1/scenes", {"params": {"colour": "red"}}, 422, "invalid-request"),
        ("PUT", "/v1/scenes/x/images/sha256:xyz", {"content": b""}, 404, "not-found"),
        ("PUT", "/v1/scenes/{scene}/images/sha256:xyz", {"content": b""}, 422, "invalid-request"),
        ("PUT", f"/v1/scenes/x/images/sha256:{'0' * 64}", {"content": b""}, 404, "not-found"),
        ("GET", "/v1/jobs/job_none", {}, 404, "not-found"),
        ("GET", "/v1/snapshots/%00", {}, 404, "not-found"),
        ("GET", "/v1/scenes/..%2f..", {}, 404, "not-found"),
    ],
)
def test_every_error_is_a_problem_document(
    gateway: Any, method: str, path: str, options: dict[str, Any], status: int, code: str
) -> None:
    if "content" in options:
        options = {"headers": {"Content-Type": "application/json"}, **options}
        if method == "PUT":
            options["headers"] = {}
    scene = gateway.scene() if "{scene}" in path else ""
    answer = gateway.client.request(method, path.replace("{scene}", scene), **options)
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    problem = answer.json()
    assert set(problem) == _FIELDS
    assert (problem["status"], problem["code"]) == (status, code)
    assert problem["request_id"] == answer.headers["x-request-id"]
    if status == 405:
        assert answer.headers["allow"] == "GET, HEAD, POST"


_POSE = {"position": [0, 0, 0], "orientation_wxyz": [1, 1, 0, 0]}
_TWINS = [{"id": "a", "pose": {"position": [0, 0, 0], "orientation_wxyz": [1, 0, 0, 0]}}] * 2


@pytest.mark.parametrize(
    ("path", "body", "field", "detail"),
    [
        ("/v1/scenes", {"name": "a", "nmae": "b"}, "nmae", "nmae: there is no such field."),
        ("/v1/scenes", {}, "name", "`name` is missing."),
        (
            "/v1/scenes",
            {"name": "a", "world": {"kind": "enu"}},
            "world.origin",
            "`world.origin` is missing.",
        ),
        (
            "/v1/scenes/{scene}/rankings",
            {"candidates": [{"id": "a", "pose": {"frame": "world", **_POSE}}]},
            "candidates.0.pose.orientation_wxyz",
            "candidates.0.pose.orientation_wxyz: "
            "a unit quaternion, w first; the length of this one is 1.414.",
        ),
        (
            "/v1/scenes/{scene}/rankings",
            {"candidates": _TWINS},
            "candidates",
            "Two candidates have the id a.",
        ),
        (
            "/v1/scenes/{scene}/rankings",
            {"generator": {"kind": "orbit", "count": 0}},
            "generator.count",
            "`generator.count` must be at least 1.",
        ),
        (
            "/v1/scenes/{scene}/rankings",
            {"generator": {"kind": "spiral"}},
            "generator",
            "`generator`'s kind must be one of 'orbit', 'grid', 'dataset', 'around-current', 'in-volume'.",
        ),
        (
            "/v1/scenes/{scene}/rankings",
            {"generator": {"kind": "orbit", "count": "many"}, "radius_m": "x"},
            "generator.count",
            "`generator.count` must be a whole number.",
        ),
        (
            "/v1/scenes/{scene}/rankings",
            {"radius_m": 2},
            "current_pose",
            "radius_m needs a current_pose to be measured from.",
        ),
        (
            "/v1/scenes/{scene}/rankings",
            {"for_vehicle": "a vehicle"},
            "for_vehicle",
            "`for_vehicle` must be 1 to 64 letters, digits and . _ ~ : @ + -, of which the first is a letter "
            "or a digit.",
        ),
        (
            "/v1/scenes/{scene}/visits",
            {"vehicle": "a", "state": "going-to", "views": []},
            "views",
            "`views` must not be empty.",
        ),
        (
            "/v1/scenes/{scene}/visits",
            {"vehicle": "a", "state": "lost", "views": []},
            "state",
            "`state` must be 'going-to', 'taken' or 'failed'.",
        ),
    ],
)
def test_what_is_wrong_is_named_by_its_place_in_the_request(
    gateway: Any, path: str, body: dict[str, Any], field: str, detail: str
) -> None:
    problem = gateway.client.post(path.format(scene=gateway.scene()), json=body).json()
    assert problem["code"] == "invalid-request"
    assert problem["errors"][0]["field"] == field
    assert problem["detail"] == detail
    assert "openapi.json" in problem["hint"]


@pytest.mark.parametrize(
    ("method", "path", "options", "fields", "detail"),
    [
        (
            "POST",
            "rankings",
            {"json": {"candidates": _TWINS[:1], "generator": {"kind": "orbit"}}},
            ["candidates", "generator"],
            "Give either candidates or a generator, not both.",
        ),
        (
            "POST",
            "rankings",
            {"json": {"generator": {"kind": "around-current"}}},
            ["current_pose", "radius_m"],
            "around-current needs current_pose and radius_m.",
        ),
        (
            "POST",
            "jobs",
            {"json": {"kind": "update", "test_every": 8}},
            ["test_every"],
            "test_every is for fine models: updates train on all images.",
        ),
        ("PATCH", "", {"json": {}}, ["name", "policy", "retention"], "Give a name, a policy or a retention."),
        (
            "PUT",
            f"images/sha256:{'0' * 64}",
            {"params": {"latitude_deg": "46"}},
            ["longitude_deg", "altitude_m"],
            "latitude_deg, longitude_deg and altitude_m belong together.",
        ),
        (
            "POST",
            "missions",
            {"json": {"views": []}, "params": {"format": "qgc-plan", "home_latitude_deg": 1.0}},
            ["home_longitude_deg"],
            "home_latitude_deg and home_longitude_deg belong together.",
        ),
    ],
)
def test_fields_that_belong_together_are_named(
    gateway: Any,
    method: str,
    path: str,
    options: dict[str, Any],
    fields: list[str] | None,
    detail: str | None,
) -> None:
    scene = gateway.scene()
    if path == "rankings":
        gateway.model(scene)
    url = f"/v1/scenes/{scene}/{path}".rstrip("/")
    problem = gateway.client.request(method, url, **options).json()
    assert problem["code"] == "invalid-request"
    assert [error["field"] for error in problem["errors"]] == fields
    assert problem["detail"] == detail


def test_a_pose_that_is_no_object_is_named(gateway: Any) -> None:
    body = {"candidates": [{"id": "a", "pose": 3}]}
    problem = gateway.client.post(f"/v1/scenes/{gateway.scene()}/rankings", json=body).json()
    assert problem["code"] == "invalid-request"
    assert problem["errors"][0]["field"] == "candidates.0.pose"
    assert problem["detail"] == "`candidates.0.pose` must be an object."
    assert "openapi.json" in problem["hint"]


def test_broken_json_is_pointed_at(gateway: Any) -> None:
    headers = {"Content-Type": "application/json"}
    problem = gateway.client.post("/v1/scenes", content=b'{"name": }', headers=headers).json()
    assert problem["detail"].startswith("The body is not JSON: ")
    assert problem["detail"].endswith(", at character 9.")


def test_a_byte_order_mark_is_no_part_of_a_body(gateway: Any) -> None:
    content = '{"name": "of a file that an editor saved"}'.encode("utf-8-sig")
    headers = {"Content-Type": "application/json"}
    answer = gateway.client.post("/v1/scenes", content=content, headers=headers)
    assert answer.json()["name"] == "of a file that an editor saved"


def test_a_request_keeps_its_own_id(gateway: Any) -> None:
    answer = gateway.client.get("/nothing", headers={"X-Request-Id": "mission-7.1"})
    assert answer.json()["request_id"] == "mission-7.1"
    evil = gateway.client.get("/nothing", headers={"X-Request-Id": "a b<script>"})
    assert evil.json()["request_id"].startswith("req_")


def test_a_defect_is_a_problem_too(gateway: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_arguments: Any) -> None:
        raise RuntimeError("a secret of the inside")

    with monkeypatch.context() as patch:
        patch.setattr(gateway.application.scenes, "all", broken, raising=True)
        answer = gateway.client.get("/v1/scenes")
    assert answer.status_code == 500
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.json()["code"] == "internal"
    assert "secret" not in answer.text


def test_long_lists_and_pages_are_refused(gateway: Any) -> None:
    assert gateway.client.get("/v1/scenes", params={"limit": 1000}).status_code == 200
    refused = gateway.client.get("/v1/scenes", params={"limit": 1001})
    assert (refused.status_code, refused.json()["errors"][0]["field"]) == (422, "limit")
    path = f"/v1/scenes/{gateway.scene()}/images:check"
    digests = [f"sha256:{number:064x}" for number in range(10_001)]
    refused = gateway.client.post(path, json={"digests": digests})
    assert (refused.status_code, refused.json()["errors"][0]["field"]) == (422, "digests")
    assert "10000 are allowed" in refused.json()["errors"][0]["message"]
    assert gateway.client.post(path, json={"digests": digests[1:]}).status_code == 200


def test_the_service_tells_how_it_is(gateway: Any) -> None:
    assert gateway.client.get("/livez").json() == {"status": "ok"}
    assert gateway.client.get("/readyz").json() == {"status": "ok"}
    capabilities = gateway.client.get("/v1/capabilities").json()
    assert {"median-frequency", "kriging"} < {*capabilities["methods"]}
    assert capabilities["limits"]["image_pixels"] == 2_000_000
    gateway.client.get("/v1/scenes/scn_none")
    metrics = gateway.client.get("/metrics").text
    assert 'fvs_requests_total{method="GET",route="/v1/scenes/{scene_id}",status="404"}' in metrics


def test_a_usual_hint_gives_way_to_that_of_an_error() -> None:
    assert "Check the id" in errors.NotFoundError("There is no such job.").hint
    assert errors.NotFoundError("There is no such job.", hint="Look elsewhere.").hint == "Look elsewhere."
    assert "fewer at once" in errors.LimitExceededError("Too many are open.").hint
