"""Every number of the API is sent at its extremes: it has a range, and nothing in it fails the service.

The numbers are found in the OpenAPI document, so a new field is tested as soon as one of the requests below
has it, and a test fails until one has.
"""

import copy
import itertools
import json
import math
from collections.abc import Iterator, Mapping
from typing import Any

import pytest
from fvs_service.rankings.port import RankedViews, RankViews

from fvs_engine.candidates import RankedCandidate
from fvs_schema.candidates import CandidateStatus
from fvs_schema.scenes import Alignment, AlignmentStatus

ORIGIN = {"latitude_deg": 48.3, "longitude_deg": 7.25, "altitude_m": 400.0}
FRAME = {"frame": "world", "position": [120.0, 0.5, -4.0], "orientation_wxyz": [1.0, 0.0, 0.0, 0.0]}
VEHICLE = {**ORIGIN, "latitude_deg": 48.301, "yaw_deg": 10.0, "pitch_deg": -20.0, "roll_deg": 0.0}
FULL = {"top_k": 2, "budget": 1, "seed": 0, "current_pose": FRAME, "radius_m": 50.0}
UP = {"up": [0.0, 0.0, 1.0]}
VOLUMES: list[dict[str, Any]] = [
    {**UP, "kind": "box", "centre": [150.0, 0.0, 0.0], "size": [60.0, 90.0, 60.0], "along": [1.0, 0.0, 0.0]},
    {**UP, "kind": "cylinder", "base": [150.0, 0.0, -90.0], "radius": 30.0, "height": 90.0},
    {
        **UP,
        **{"kind": "prism", "lower": -30.0, "upper": 60.0},
        "corners": [[90.0, 0.0, 3.0], [180.0, 30.0, 2.0], [180.0, 90.0, 4.0]],
    },
    {**UP, "kind": "shell", "centre": [0.0, 0.0, 0.0], "inner": 120.0, "outer": 180.0, "above": 30.0},
    {**UP, "kind": "corridor", "path": [[120.0, 0.0, 90.0], [120.0, 150.0, 90.0]], "radius": 30.0},
]
"""Beside the model of the georeferenced scene, whose images are 120 m from its middle."""
ZONE = {"kind": "box", "centre": [-300.0, 0.0, 0.0], "size": [9.0, 9.0, 9.0]}
TERRAIN = {
    "kind": "heights",
    **{"south_deg": 48.0, "west_deg": 7.0, "latitude_step_deg": 1.0, "longitude_step_deg": 1.0},
    **{"columns": 2, "heights_m": [300.0, 300.0, 300.0, 300.0]},
}
REQUESTS: Mapping[str, list[dict[str, Any]]] = {
    "/v1/scenes": [
        {
            "name": "numbers",
            "world": {"kind": "enu", "origin": ORIGIN},
            "camera": {"focal_length_px": 3000.0, "width_px": 4000},
            "policy": {"trigger": "every-k-images", "k": 10, "first": 8},
            "retention": {
                **{"snapshots": 10, "snapshot_days": 30, "rankings": 10, "ranking_days": 30},
                **{"plans": 10, "plan_days": 30},
            },
        }
    ],
    "/v1/scenes/{scene_id}/jobs": [
        {"kind": "fine", "iterations": 100, "long_side_px": 640, "test_every": 8},
    ],
    "/v1/scenes/{scene_id}/rankings": [
        {**FULL, "candidates": [{"id": "a", "pose": FRAME}]},
        {**FULL, "candidates": [{"id": "a", "pose": {**FRAME, "frame": "model"}}]},
        {"candidates": [{"id": "a", "pose": VEHICLE}], "current_pose": VEHICLE},
        {"candidates": [{"id": "a", "pose": VEHICLE}], "terrain": TERRAIN},
        {
            **FULL,
            "generator": {
                **{"kind": "orbit", "count": 2, "radius_m": 4.0, "height_m": 1.0},
                "centre": [0.0, 0.0, 0.0],
            },
        },
        {**FULL, "generator": {"kind": "grid", "columns": 1, "rows": 1, "height_m": 4.0, "look": "down"}},
        {**FULL, "generator": {"kind": "grid", "columns": 1, "rows": 1, "height_m": 4.0, "margin_m": 1.0}},
        {**FULL, "generator": {"kind": "around-current", "count": 2}},
        *(
            {
                "generator": {"kind": "in-volume", "volume": volume, "count": 2, "aim": [0.0, 0.0, 0.0]},
                **{**FULL, "safety_m": 3.0, "no_fly": [ZONE]},
            }
            for volume in VOLUMES
        ),
    ],
    "/v1/scenes/{scene_id}/control-points": [
        {
            "crs": "EPSG:25832",
            "points": [
                {
                    **{"name": "a", "x": 370_000.0, "y": 5_350_000.0, "z": 400.0},
                    "marks": [{"image": "a.jpg", "x_px": 100.5, "y_px": 200.5}],
                }
            ],
        },
    ],
    "/v1/scenes/{scene_id}/visits": [
        {
            **{"vehicle": "a", "state": "failed", "expires_in_s": 60},
            "views": [{"id": "a", "pose": FRAME}, {"id": "b", "pose": VEHICLE}],
        },
    ],
    "/v1/scenes/{scene_id}/plans": [
        {
            **{"candidates": [{"id": "a", "pose": FRAME}], "targets": [{"id": "b", "pose": FRAME}]},
            **{"vehicles": [FRAME], "views": 2, "distance_m": 1e4, "home": True},
        },
        {"candidates": [{"id": "a", "pose": VEHICLE}], "vehicles": [VEHICLE], "views": 2},
        {"candidates": [{"id": "a", "pose": VEHICLE}], "vehicles": [VEHICLE], "terrain": TERRAIN},
        {"generator": {"kind": "orbit", "count": 2, "radius_m": 120.0, "height_m": 1.0}, "views": 2},
        {"generator": {"kind": "grid", "columns": 1, "rows": 1, "height_m": 120.0, "look": "down"}},
        {  # the volumes are those of rankings
            "generator": {"kind": "in-volume", "volume": VOLUMES[0], "count": 2, "aim": [0.0, 0.0, 0.0]},
            **{"safety_m": 3.0, "no_fly": [ZONE]},
        },
    ],
    "/v1/scenes/{scene_id}/forecasts": [
        {
            "candidates": [{"id": "a", "pose": FRAME}, {"id": "b", "pose": VEHICLE}],
            "after": [{"id": "a", "pose": FRAME}, {"id": "b", "pose": VEHICLE}],
        },
        {"generator": {"kind": "grid", "columns": 1, "rows": 1, "height_m": 9.0, "margin_m": 1.0}},
        {"surface": {"count": 2}},
    ],
    "/v1/scenes/{scene_id}/missions": [
        {
            "views": [{"id": "a", "pose": VEHICLE, "via": [VEHICLE]}, {"id": "b", "pose": FRAME}],
            "via_home": [FRAME],
        },
        {"views": [{"id": "a", "pose": VEHICLE}], "terrain": TERRAIN},
    ],
    "/v1/snapshots/{snapshot_id}/renders": [
        {"pose": FRAME, "long_side_px": 64, "format": "jpeg"},
        {"pose": VEHICLE, "long_side_px": 64},
    ],
}
OPTIONS: Mapping[str, Mapping[str, str]] = {
    "/v1/scenes/{scene_id}/missions": {
        **{"format": "geojson", "gimbal_highest_deg": "180"},
        **{"home_latitude_deg": "48.3", "home_longitude_deg": "7.25"},
    }
}
"""What a route needs in the query, beside its body."""
QUERIES: Mapping[str, list[dict[str, Any]]] = {
    "/v1/scenes/{scene_id}/images/sha256:{hexadecimal}": [
        {**VEHICLE, "altitude_datum": "sea-level", "attitude_sigma_deg": 2.0},
        {"x_m": 1.0, "y_m": 2.0, "z_m": 3.0, "yaw_deg": 0.0, "position_sigma_m": 0.1},
        {"name": "a.mp4", "every_s": 1.0},
    ]
}
TINY = "5e-324"
EXTREMES = (TINY, "-5e-324", "1e-300", "1e308", "-1e308", "1e400", "-1e400", "NaN", "9" * 5000)
OUTSIDE = tuple(text for text in EXTREMES if "e-" not in text)
WHOLE = ("0", "-0.0", "1.5", "4294967296", "9223372036854775808")

_NUMBER = "number at "


def _resolve(document: Mapping[str, Any], schema: Mapping[str, Any]) -> Mapping[str, Any]:
    while "$ref" in schema:
        schema = document["components"]["schemas"][schema["$ref"].rpartition("/")[2]]
    return schema


def _variants(document: Mapping[str, Any], schema: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    schema = _resolve(document, schema)
    if "properties" in schema:  # a model's own oneOf has conditions, not variants
        return [schema]
    inside = [*schema.get("anyOf", ()), *schema.get("oneOf", ()), *schema.get("allOf", ())]
    return [variant for one in inside for variant in _variants(document, one)] if inside else [schema]


def _declared(
    document: Mapping[str, Any], schema: Mapping[str, Any], name: str
) -> dict[str, Mapping[str, Any]]:
    """The numbers of a schema: the model's title and field → the field's schema."""
    found: dict[str, Mapping[str, Any]] = {}
    for variant in _variants(document, schema):
        if variant.get("type") in ("number", "integer"):
            found[name] = variant
        for field, inner in variant.get("properties", {}).items():
            found |= _declared(document, inner, f"{variant['title']}.{field}")
        for inner in (*variant.get("prefixItems", ()), *filter(None, [variant.get("items")])):
            if isinstance(inner, Mapping):
                found |= _declared(document, inner, name)
    return found


def _numbers(
    document: Mapping[str, Any], schema: Mapping[str, Any], value: Any, path: tuple[Any, ...], name: str
) -> Iterator[tuple[tuple[Any, ...], str, Mapping[str, Any]]]:
    """Path, name and schema of every number in a body."""
    for variant in _variants(document, schema):
        if isinstance(value, dict) and _fits(document, variant, value):
            for field, inner in value.items():
                yield from _numbers(
                    document,
                    variant["properties"][field],
                    inner,
                    (*path, field),
                    f"{variant['title']}.{field}",
                )
        elif isinstance(value, list) and variant.get("type") == "array":
            items = variant.get("prefixItems") or [variant["items"]] * len(value)
            for index, inner in enumerate(value):
                if index == 0 or items[index] != items[0] or isinstance(inner, dict):  # else it is the same
                    yield from _numbers(document, items[index], inner, (*path, index), name)
        elif isinstance(value, int | float) and variant.get("type") in ("number", "integer"):
            yield path, name, variant


def _fits(document: Mapping[str, Any], schema: Mapping[str, Any], value: Mapping[str, Any]) -> bool:
    properties = schema.get("properties", {})
    if not value.keys() <= properties.keys():
        return False
    consts = ((name, _resolve(document, inner).get("const")) for name, inner in properties.items())
    return all(const is None or value.get(name, const) == const for name, const in consts)


def _replaced(body: Any, path: tuple[Any, ...], text: str) -> str:
    """The body as JSON with ``text`` as the number at ``path``."""
    body = copy.deepcopy(body)
    inside = body
    for part in path[:-1]:
        inside = inside[part]
    inside[path[-1]] = _NUMBER
    return json.dumps(body).replace(f'"{_NUMBER}"', text)


def _limits(schema: Mapping[str, Any]) -> tuple[float, float]:
    low = schema.get("minimum", schema.get("exclusiveMinimum"))
    high = schema.get("maximum", schema.get("exclusiveMaximum"))
    assert low is not None, schema
    assert high is not None, schema
    return low, high


def _texts(schema: Mapping[str, Any]) -> list[str]:
    low, high = _limits(schema)
    past = [repr(low - 1), repr(high + 1), repr(low - 1e-9 * max(1.0, abs(low)))]
    ends = [repr(low), repr(high)]
    return [*ends, *past, *EXTREMES, *WHOLE]


def _means_something(text: str, schema: Mapping[str, Any]) -> bool:
    low, high = _limits(schema)
    if len(text) > 400 or not math.isfinite(float(text)) or not low <= float(text) <= high:
        return False
    return schema["type"] == "number" or float(text).is_integer()


def _names_before(document: Mapping[str, Any], path: str, request: Mapping[str, Any]) -> set[str]:
    """The names of the numbers in the requests above this one."""
    requests = [(path, request) for path, requests in REQUESTS.items() for request in requests]
    before = itertools.takewhile(lambda other: other != (path, request), requests)
    return {
        name
        for path, other in before
        for _, name, _ in _numbers(document, _body(document, path), other, (), "")
    }


def _body(document: Mapping[str, Any], path: str) -> Mapping[str, Any]:
    """The schema of a path's body."""
    content = document["paths"][path][_method(document, path)]["requestBody"]["content"]
    schema: Mapping[str, Any] = content["application/json"]["schema"]
    return schema


def _method(document: Mapping[str, Any], path: str) -> str:
    return next(method for method in ("post", "put") if method in document["paths"][path])


def _check(answer: Any, where: str, *, refused: bool, field: str) -> None:
    assert answer.status_code < 500, (where, answer.text)

    def fail(text: str) -> float:
        raise AssertionError((where, text))

    if answer.headers["Content-Type"].startswith("image/"):
        assert not refused, where
        return
    document = json.loads(answer.text, parse_constant=fail)
    assert all(map(math.isfinite, _floats(document))), where
    if refused:
        assert answer.status_code in (400, 422), (where, answer.text)
        named = [error["field"] for error in document.get("errors", ())]
        # Python reads no longer integers (and JSON has no NaN): then the body is not JSON.
        assert answer.status_code == 400 or field in named, (where, document)


def _floats(value: Any) -> Iterator[float]:
    if isinstance(value, dict | list):
        for inner in value.values() if isinstance(value, dict) else value:
            yield from _floats(inner)
    elif isinstance(value, float):
        yield value


async def _unrendered(request: RankViews) -> RankedViews:
    """All views ranked in their order."""
    ranked = tuple(
        RankedCandidate(rank, view.name, 0.0, CandidateStatus.RANKED, 1.0, request.distances.get(view.name))
        for rank, view in enumerate(request.views, start=1)
    )
    return RankedViews(snapshot_id=request.snapshot_id, iterations=7, gaussians=60, candidates=ranked)


@pytest.fixture(scope="module")
def gateway(running: Any, settings_of: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """A gateway with low limits: large counts would only make the tests slow."""
    limits = {"limits": {"candidates_per_ranking": 16, "open_jobs_per_tenant": 1_000}}
    with running(settings_of(tmp_path_factory.mktemp("numbers"), limits)) as gateway:
        yield gateway


@pytest.fixture(scope="module")
def document(gateway: Any) -> dict[str, Any]:
    return gateway.client.get("/openapi.json").json()


@pytest.fixture(scope="module")
def scenes(gateway: Any) -> dict[bool, str]:
    """A georeferenced scene with a model, and one with a local world (by whether it is georeferenced)."""
    georeferenced = gateway.scene(world={"kind": "enu", "origin": ORIGIN})
    gateway.model(georeferenced, alignment=Alignment(status=AlignmentStatus.ALIGNED, scale=30.0))
    return {True: georeferenced, False: gateway.scene(world={"kind": "local"})}


def test_every_number_of_a_request_has_a_range_and_a_request_that_tests_it(document: Any) -> None:
    declared: dict[str, Mapping[str, Any]] = {}
    tested: set[str] = set()
    for path, operations in document["paths"].items():
        for operation in operations.values():
            body = operation.get("requestBody", {}).get("content", {}).get("application/json")
            if body is not None:
                declared |= _declared(document, body["schema"], "")
                for request in REQUESTS.get(path, ()):
                    tested |= {name for _, name, _ in _numbers(document, body["schema"], request, (), "")}
            for parameter in operation.get("parameters", ()):
                for schema in _declared(document, parameter["schema"], parameter["name"]).values():
                    _limits(schema)
    for name, schema in declared.items():
        assert _limits(schema), name
    assert declared.keys() == tested
    assert len(tested) >= 30


@pytest.mark.parametrize("computed", [False, pytest.param(True, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("path", "request_"),
    [
        pytest.param(
            path, request, marks=pytest.mark.system if "volume" in request.get("generator", ()) else ()
        )
        for path, requests in REQUESTS.items()
        for request in requests
    ],
)
def test_extreme_numbers_in_bodies_are_refused_by_name_or_used(
    gateway: Any,
    document: Any,
    scenes: dict[bool, str],
    path: str,
    request_: dict[str, Any],
    computed: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if not computed:
        monkeypatch.setattr(gateway.runners, "rank", _unrendered)
    snapshot = gateway.client.get(f"/v1/scenes/{scenes[True]}").json()["snapshot_id"]
    address = path.format(scene_id=scenes[True], snapshot_id=snapshot)
    options = OPTIONS.get(path)
    method = _method(document, path)
    plain = gateway.client.request(method, address, json=request_, params=options)
    assert plain.status_code < 300, plain.text
    tried, names_before = 0, _names_before(document, path, request_)
    for where, name, schema in _numbers(document, _body(document, path), request_, (), ""):
        limits = [*map(repr, _limits(schema))]
        for text in dict.fromkeys(_texts(schema)):
            # What a field refuses does not depend on the others; its limits are used together with them.
            refused = not _means_something(text, schema)
            if (
                not computed
                and text not in limits
                and (name in names_before or not (refused or text == TINY))
            ):
                continue
            content = _replaced(request_, where, text)
            headers = {"Content-Type": "application/json"}
            answer = gateway.client.request(method, address, content=content, headers=headers, params=options)
            field = ".".join(map(str, where))
            _check(answer, f"{name} = {text[:40]}", refused=refused, field=field)
            tried += 1
    assert tried >= 6


def test_extreme_numbers_in_queries_are_refused_by_name_or_used(
    gateway: Any, document: Any, scenes: dict[bool, str], photograph: Any
) -> None:
    content, seed = photograph(), 0
    for path, queries in QUERIES.items():
        operation = document["paths"][path]["put"]
        schemas = {
            parameter["name"]: variant
            for parameter in operation["parameters"]
            for variant in _variants(document, parameter["schema"])
            if variant.get("type") in ("number", "integer")
        }
        assert schemas.keys() == {name for query in queries for name in query if name in schemas}
        for query in queries:
            scene = scenes["latitude_deg" in query]
            for name in query.keys() & schemas.keys():
                for text in (*map(repr, _limits(schemas[name])), *OUTSIDE, "1e-300"):
                    if _means_something(text, schemas[name]):
                        content, seed = photograph(seed=seed), seed + 1
                    answer = gateway.put(scene, content, **{**query, name: text})
                    where = f"{name} = {text[:40]}"
                    refused = not _means_something(text, schemas[name])
                    _check(answer, where, refused=refused, field=name)
            answer = gateway.client.get(f"/v1/scenes/{scene}/images").json()
            assert all(map(math.isfinite, _floats(answer)))


def test_extreme_numbers_of_pages_and_streams_are_refused(gateway: Any, scenes: dict[bool, str]) -> None:
    scene = scenes[True]
    for text in (*EXTREMES, "-1", "0", "1001", "1.5"):
        answer = gateway.client.get(f"/v1/scenes/{scene}/images", params={"limit": text})
        _check(answer, f"limit = {text[:40]}", refused=True, field="limit")
    for text in (*EXTREMES, "-1", "9223372036854775808", "1.5"):
        answer = gateway.client.get(f"/v1/scenes/{scene}/events", params={"after": text})
        _check(answer, f"after = {text[:40]}", refused=True, field="after")
        if text.isascii() and len(text) < 400:
            answer = gateway.client.get(f"/v1/scenes/{scene}/events", headers={"Last-Event-ID": text})
            _check(answer, f"Last-Event-ID = {text[:40]}", refused=True, field="Last-Event-ID")


def test_a_focal_length_fits_the_width_that_it_is_given_for(gateway: Any) -> None:
    for focal_length_px in (100.0, 100_000.0):  # within the range, but 169° and 2.3° at this width
        camera = {"focal_length_px": focal_length_px, "width_px": 4000}
        answer = gateway.client.post("/v1/scenes", json={"name": "camera", "camera": camera})
        assert answer.status_code == 422
        assert [error["field"] for error in answer.json()["errors"]] == ["camera.focal_length_px"]
