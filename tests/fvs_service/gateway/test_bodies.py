"""JSON bodies: the caller comes first, and the worst body costs little."""

import json
import socket
from collections.abc import Iterator
from functools import partial
from typing import Any, get_args
from urllib.parse import urlsplit

import pytest
from fastapi.routing import APIRoute, iter_route_contexts
from fvs_service.errors import InvalidRequestError, MalformedRequestError
from fvs_service.gateway.rest.bodies import parse
from fvs_service.gateway.rest.routing import JsonRoute
from fvs_service.principal import Scope
from loop_watchdog import ALLOWED_S, watched_loops
from pydantic import BaseModel

from fvs_schema.images import DigestCheck
from fvs_schema.rankings import RankingRequest
from fvs_schema.scenes import SceneRequest
from fvs_schema.service import Limits

_LIMITS = Limits()
_MOST = _LIMITS.json_bytes
_JSON = {"Content-Type": "application/json"}
_POSTS = (
    "/v1/scenes",
    "/v1/scenes/{scene}/images:check",
    "/v1/scenes/{scene}/jobs",
    "/v1/scenes/{scene}/rankings",
)


def _filled(start: bytes, item: bytes, end: bytes) -> bytes:
    """A body of the largest allowed size."""
    return start + item * ((_MOST - len(start) - len(end)) // len(item)) + end


WORST = {
    "wrong digests": _filled(b'{"digests":[', b"1,", b"1]}"),
    "empty candidates": _filled(b'{"candidates":[', b"{},", b"{}]}"),
    "few wrong digests": b'{"digests":[' + b",".join([b"1"] * 10_000) + b"]}",
    "few empty candidates": b'{"candidates":[' + b",".join([b"{}"] * 2_000) + b"]}",
    "long numbers": _filled(b'{"digests":[', b"9" * 4_000 + b",", b"1]}"),
    "a long number": _filled(b'{"name":', b"9", b"}"),
    "a long fraction": _filled(b'{"name":0.', b"3", b"}"),
    "a large exponent": b'{"name":1e400}',
    "a long exponent": _filled(b'{"name":1e', b"9", b"}"),
    "infinity": b'{"name":Infinity}',
    "deep lists": _filled(b"", b"[", b""),
    "deep objects": _filled(b"", b'{"a":', b""),
    "spaces": _filled(b"", b" ", b"{"),
    "a long string": _filled(b'{"name":"', b"a", b'"}'),
    "a long kind": _filled(b'{"name":"a","world":{"kind":"', b"a", b'"}}'),
    "escapes": _filled(b'{"name":"', b"\\n", b'"}'),
    "a long key": _filled(b'{"', b"a", b'":1}'),
    "many keys": b"{" + b",".join(b'"k%d":1' % number for number in range(40_000)) + b"}",
    "a key many times": _filled(b"{", b'"name":"a",', b'"name":"a"}'),
    "a surrogate": b'{"name":"\\ud800"}',
    "not UTF-8": _filled(b'{"name":"', b"\xff", b'"}'),
}


@pytest.mark.parametrize("name", WORST)
@pytest.mark.parametrize("kind", [SceneRequest, DigestCheck, RankingRequest])
def test_the_worst_bodies_are_refused_with_few_short_errors(kind: Any, name: str) -> None:
    with pytest.raises((MalformedRequestError, InvalidRequestError)) as refused:
        parse(kind, WORST[name], _LIMITS)
    assert len(refused.value.errors) <= 16
    assert len(refused.value.message) <= 1_000
    assert all(len(error.field) + len(error.message) <= 1_000 for error in refused.value.errors)


def test_a_list_ends_at_its_limit_before_its_items_are_validated() -> None:
    limits = Limits(candidates_per_ranking=3)
    content = json.dumps({"candidates": [{}] * 4}).encode()
    with pytest.raises(InvalidRequestError, match=r"candidates: there are 4, and 3 are allowed") as refused:
        parse(RankingRequest, content, limits)
    assert len(refused.value.errors) == 1


def test_an_allowed_list_ends_at_its_first_invalid_item() -> None:
    content = json.dumps({"digests": ["sha256:" + "0" * 64, 1, 2, 3]}).encode()
    with pytest.raises(InvalidRequestError) as refused:
        parse(DigestCheck, content, _LIMITS)
    assert [error.field for error in refused.value.errors] == ["digests.1"]


def test_the_largest_honest_bodies_are_read() -> None:
    pose = {"frame": "world", "position": [-123.45678901234567] * 3, "orientation_wxyz": [0.5, 0.5, 0.5, 0.5]}
    candidates = [{"id": f"candidate-{number:04}", "pose": pose} for number in range(2_000)]
    indented = json.dumps({"candidates": candidates}, indent=2).encode()
    assert len(indented) <= _MOST
    assert len(parse(RankingRequest, indented, _LIMITS).candidates or ()) == 2_000
    digests = [f"sha256:{number:064x}" for number in range(10_000)]
    assert len(parse(DigestCheck, json.dumps({"digests": digests}).encode(), _LIMITS).digests) == 10_000


def _lists(model: type[BaseModel], seen: set[type]) -> list[tuple[type, str, Any]]:
    """The fields of a model and of those within it that are lists of any length."""
    found: list[tuple[type, str, Any]] = []
    if model in seen:
        return found
    seen.add(model)
    for name, field in model.model_fields.items():
        pending: list[tuple[Any, tuple[Any, ...]]] = [(field.annotation, tuple(field.metadata))]
        while pending:
            annotation, metadata = pending.pop()
            if isinstance(annotation, type) and issubclass(annotation, BaseModel):
                found += _lists(annotation, seen)
            elif getattr(annotation, "__metadata__", None):
                pending.append((annotation.__origin__, tuple(annotation.__metadata__)))
            else:
                if Ellipsis in get_args(annotation) or getattr(annotation, "__origin__", None) in (
                    list,
                    dict,
                    set,
                ):
                    found.append((model, name, metadata))
                pending += [(part, ()) for part in get_args(annotation)]
    return found


def _routes(app: Any) -> list[APIRoute]:
    found = [context.original_route for context in iter_route_contexts(app.routes)]
    return [route for route in found if isinstance(route, APIRoute) and route.include_in_schema]


def test_a_thousand_control_points_are_read(gateway: Any) -> None:
    marks = [{"image": "DJI_0021.JPG", "x_px": 1102.7, "y_px": 2208.0}]
    points = [
        {"name": f"G{n}", "x": 537_653.198 + n, "y": 5_260_847.354, "z": 410.1, "marks": marks}
        for n in range(1000)
    ]
    path = f"/v1/scenes/{gateway.scene()}/control-points"
    answer = gateway.client.put(path, json={"crs": "EPSG:25832", "points": points})
    assert answer.status_code == 200, answer.text


def test_every_list_of_a_body_ends_early(gateway: Any) -> None:
    kinds = [route.body for route in _routes(gateway.app) if isinstance(route, JsonRoute) and route.body]
    assert len(kinds) >= 4
    seen: set[type] = set()
    lists = [found for kind in kinds for found in _lists(kind, seen)]
    assert {name for _, name, _ in lists} >= {"digests", "candidates"}
    for model, name, metadata in lists:
        assert "fail_fast" in repr(metadata).lower().replace("failfast", "fail_fast"), (model, name)
        # A limit of the service's settings; or, in the engine's types, a fixed one.
        assert "within" in repr(metadata) or "MaxLen" in repr(metadata), (model, name)


def test_the_framework_reads_no_body_and_serialises_nothing(gateway: Any) -> None:
    routes = _routes(gateway.app)
    assert len(routes) >= 24
    for route in routes:
        assert route.body_field is None, route.path
        assert isinstance(route, JsonRoute), route.path


@pytest.fixture(scope="module")
def locked(tmp_path_factory: pytest.TempPathFactory, running: Any, settings_of: Any) -> Iterator[Any]:
    settings = settings_of(tmp_path_factory.mktemp("locked"), {"require_keys": True})
    with running(settings) as gateway:
        yield gateway


@pytest.mark.parametrize("path", _POSTS)
@pytest.mark.parametrize("content", [b"{", b"[1,2]", b'{"digests":[1]}'])
def test_the_caller_is_known_before_the_body_is_parsed(locked: Any, path: str, content: bytes) -> None:
    gateway = locked
    owner = gateway.key("owner")
    scene = gateway.scene(owner)

    def status(headers: dict[str, str], scene_id: str) -> int:
        sent = {**_JSON, **headers}
        return gateway.client.post(path.format(scene=scene_id), content=content, headers=sent).status_code

    assert status({}, scene) == 401
    assert status(gateway.key("owner", scopes=frozenset({Scope.READ})), scene) == 403
    assert status(owner, scene) in (400, 422)
    if "{scene}" in path:
        assert status(owner, "scn_none") == 404
        assert status(gateway.key("stranger"), scene) == 404


def test_a_large_body_is_not_read_before_the_permission_is_known(serve: Any) -> None:
    url = urlsplit(str(serve().client.base_url))
    head = (
        "POST /v1/scenes/scn_none/rankings HTTP/1.1\r\nHost: localhost\r\n"
        "Content-Type: application/json\r\nContent-Length: 1000000\r\n\r\n"
    )
    with socket.create_connection((url.hostname, url.port), 30) as connection:
        connection.sendall(head.encode())  # and nothing of the body
        assert connection.recv(64).startswith(b"HTTP/1.1 404 ")


def _worst_requests(app: Any, scene: str) -> Iterator[tuple[str, str, bytes, str]]:
    """Method, path, body and its type: every route with every worst body, query and form."""
    values = {"scene_id": scene, "hexadecimal": "0" * 64, "job_id": "job_a", "snapshot_id": "snp_a"}
    values |= {
        "upload_id": "upl_a",
        "name": "a",
        "ranking_id": "rnk_a",
        "plan_id": "pln_a",
        "webhook_id": "whk_a",
        "candidate_id": "a",
        "image": "render",
    }
    query = "&".join(f"k{number}" for number in range(2_000))
    parts = "".join(
        f'--b\r\nContent-Disposition: form-data; name="f"; filename="{n}"\r\n\r\nx\r\n' for n in range(300)
    )
    forms = [
        parts.encode(),
        b"--b\r\n" + b"a: b\r\n" * 100_000,
        b"--b\r\nA" + b"a" * 500_000,
        b"\r\n--" * 100_000,
    ]
    for route in _routes(app):
        path = route.path_format.format(**values)
        if path.endswith("/events"):
            continue
        bodies: list[tuple[bytes, str]] = [(content, "application/json") for content in WORST.values()]
        if path.endswith("/images"):
            bodies += [(form, "multipart/form-data; boundary=b") for form in forms]
        for method in sorted(route.methods):
            if method not in ("PATCH", "POST", "PUT"):
                bodies = []
            elif not (isinstance(route, JsonRoute) and route.body):
                bodies = bodies[:1] + bodies[len(WORST) :]
            for content, kind in bodies:
                yield method, path, content, kind
            yield method, f"{path}?{query}", b"", "application/json"


def test_no_request_holds_the_event_loop(serve: Any) -> None:
    """Every route with every worst body, query and form: before, one of them took up to 34 s."""
    holds: dict[tuple[str, str, bytes], float] = {}
    with watched_loops() as watchdog:
        gateway = serve()
        for method, path, content, kind in _worst_requests(gateway.app, gateway.scene()):
            send = partial(
                gateway.client.request, method, path, content=content, headers={"Content-Type": kind}
            )
            answer, holds[method, path[:80], content[:40]] = watchdog.hold_of(send)
            assert answer.status_code < 500, (method, path, content[:40], answer.text)
            if "?" in path:
                assert answer.status_code == 422, (method, path, answer.text)
    assert len(holds) > 80
    assert not {request: held for request, held in holds.items() if held > ALLOWED_S}
